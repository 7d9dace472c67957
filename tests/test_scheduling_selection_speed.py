"""Speed of selections as ratios in one process, and their bounds on seeds used for nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from benches import load

pytestmark = pytest.mark.speed
SLACK = 1.5
FASTER = 4.0  # than NumPy that looks at all sets at once


@pytest.mark.parametrize("field", ["ranges, equal noise", "ranges, growing noise"])
def test_three_of_24_are_the_best_and_come_faster_than_from_numpy(root: Path, field: str) -> None:
    bench = load(root / "benchmarks" / "bench_selection.py")
    found = bench.small(field, seed=310_000, runs=50)
    assert found.ratio <= 1.0 + 1e-9
    assert found.numpy_us / found.ours_us > FASTER / SLACK


def test_six_of_2000_are_near_the_bound_and_cost_a_few_dozen_small_ones(root: Path) -> None:
    bench = load(root / "benchmarks" / "bench_selection.py")
    found = bench.large("ranges, growing noise", seed=310_000, runs=20)
    assert found.worst <= 1.03
    assert found.proved == 1.0
    small = bench.small("ranges, equal noise", seed=310_000, runs=20)
    assert 1e3 * found.mean_ms / small.numpy_us < 6.0 * SLACK
