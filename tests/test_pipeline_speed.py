"""The tracker's speed, as ratios in one process; bounds leave half as much again for noise."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from benches import load
from trackfield.pipeline.tagged import track

pytestmark = pytest.mark.speed
NUMPY_RATIO = 8.0
SLACK = 1.5


def test_a_scan_against_a_plain_numpy_filter(root: Path) -> None:
    bench = load(root / "benchmarks" / "bench_scan.py")
    given = bench.drive()
    steps = {"ours": bench.ours(given), "numpy": bench.numpy_ekf(given)}
    found = bench.compare(steps, given)
    assert found["numpy"][0] / found["ours"][0] > NUMPY_RATIO / SLACK
    # As good as the filter that knows where the target starts.
    assert found["ours"][1] < 1.1 * found["numpy"][1]


def test_time_grows_with_the_readings_and_no_faster(root: Path) -> None:
    bench = load(root / "benchmarks" / "bench_batch.py")
    used = []
    for steps in (100, 200, 100, 200, 100, 200):
        readings, _ = bench.batch(200, steps)
        before = time.process_time()
        track(bench.site("imm"), readings)
        used.append(time.process_time() - before)
    assert min(used[1::2]) / min(used[::2]) < 2.0 * SLACK
