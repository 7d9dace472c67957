"""Steps of a closed loop on a large field, as ratios; bounds leave half as much again for noise."""

from __future__ import annotations

from pathlib import Path

import pytest

from benches import load

pytestmark = pytest.mark.speed
SLACK = 1.5
SCANS = 120.0  # updates of a plain NumPy filter by 19 ranges: 5 ms where one takes 42 us


def test_a_step_of_a_large_field_costs_as_much_as_a_hundred_filters(root: Path) -> None:
    bench, scan = (
        load(root / "benchmarks" / f"bench_{name}.py") for name in ("scheduling", "scan")
    )
    given = scan.drive()
    filters, steps, small = [], [], []
    for _ in range(3):
        filters.append(scan.compare({"numpy": scan.numpy_ekf(given)}, given)["numpy"][0])
        steps.append(bench.seconds_a_step(bench.World(10_000, 3, 150)))
        small.append(bench.seconds_a_step(bench.World(1000, 3, 150)))
    assert min(steps) < SCANS * SLACK * min(filters)
    assert min(steps) < 2.0 * SLACK * min(small)  # who sleeps costs next to nothing
