"""Speed of trackers of reports, as ratios in one process; bounds leave half as much for noise."""

from __future__ import annotations

from pathlib import Path

import pytest

from benches import load

pytestmark = pytest.mark.speed
NEAREST_RATIO = 9.0
SLACK = 1.5


def test_nearest_neighbours_against_stone_soup(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(root / "benchmarks"))
    bench = load(root / "benchmarks" / "bench_trackers.py")
    makers = {name: bench.trackers()[name] for name in ("gnn", bench.THEIRS)}
    found = bench.compare(makers, [bench.draw(seed) for seed in (0, 1)])
    ours, theirs = found["gnn"], found[bench.THEIRS]
    assert theirs.mean_ms / ours.mean_ms > NEAREST_RATIO / SLACK
    assert ours.gospa_m < theirs.gospa_m
    assert ours.switches < theirs.switches
