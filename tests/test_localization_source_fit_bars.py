"""What the fusion of signals is known to reach, on draws that no setting was chosen by."""

import pytest

from benches import load
from conftest import ROOT
from source_scenes import OH, ROUGH

bench = load(ROOT / "benchmarks" / "bench_fusion.py")


def test_exact_sensors_locate_all_targets_to_millimetres_and_nothing_else():
    field = bench.Field(OH)
    row = bench.measure(field, bench.fit(field), scans=25, seed=1)
    assert row.error_m <= 0.008
    assert row.coverage >= 0.99
    assert row.false <= 0.02
    assert 1.6 <= row.nis <= 2.4  # 350 targets: one standard error is .11
    rule = bench.measure(field, bench.rule, scans=5, seed=1)
    assert rule.coverage < 0.5  # why the paper's rule is not the default


def test_rough_sensors_that_are_told_of_it_do_too():
    field = bench.Field(ROUGH)
    row = bench.measure(field, bench.fit(field), scans=25, seed=1)
    assert row.error_m <= 0.06
    assert row.coverage >= 0.99
    assert row.false <= 0.05
    assert 1.4 <= row.nis_clipped <= 2.4


@pytest.mark.speed
def test_the_time_of_a_scan_grows_no_faster_than_the_number_of_targets():
    """By the ratio of scans of 400 and 25 targets in one process, with slack for a busy machine."""
    assert bench.growth(sides=(100, 400), scans=3) <= 1.1 + 0.15


@pytest.mark.speed
def test_a_scan_takes_a_fraction_of_the_paper_rule():
    field = bench.Field(OH)
    ours = bench.measure(field, bench.fit(field), scans=15, seed=2)
    rule = bench.measure(field, bench.rule, scans=15, seed=2)
    assert ours.least_ms <= 0.6 * rule.least_ms  # about a fifth
