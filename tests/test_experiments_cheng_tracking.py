"""Passes, switching and silence: the paper's ways fall behind, and the numbers are those told."""

import numpy as np
import pytest

from trackfield.experiments import cheng_pass, cheng_switching, cheng_tracking
from trackfield.experiments.cheng_pass import ALONE, FIELD, IEKF, OBSERVER, TOLD


@pytest.fixture(scope="module")
def quick():
    parts = []
    found = cheng_tracking.run(
        np.random.default_rng(3), quick=True, tick=lambda: parts.append(None)
    )
    assert len(parts) == cheng_tracking.TICKS
    return found


def test_the_filter_reaches_the_bound_and_the_observer_keeps_its_start_error():
    found = cheng_pass.passes(FIELD, 40, tracked=1, rng=np.random.default_rng(8))
    assert found.rmse(IEKF) < 0.006
    assert 0.8 < found.efficiency(IEKF) < 1.5
    assert found.rmse(OBSERVER) > 0.08
    assert found.lost(ALONE) > 0.5
    assert found.lost(IEKF) == found.lost(TOLD) == 0.0


def test_sensors_that_are_switched_see_more_than_those_that_stay():
    found = cheng_switching.switched(12, np.random.default_rng(9))
    stays, paper, _, informed, all_of_them = (found.rmse(rule) for rule in cheng_switching.RULES)
    assert stays > 2.0 * paper > 2.0 * all_of_them
    assert informed < paper


def test_sensors_stand_round_the_field():
    places = cheng_switching.places()
    assert places.shape == (12, 2)
    assert len(np.unique(places.round(6), axis=0)) == 12
    on_edge = (np.abs(places[:, 0]) == 3.0) | (np.abs(places[:, 1]) == 2.0)
    assert on_edge.all()
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=1e-12)


def test_tables_findings_and_figures_tell_what_was_found(quick):
    tables = cheng_tracking.tables(quick)
    assert [len(table.rows) for table in tables] == [6, 6, 5, 2]
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
    cells = dict(zip(tables[0].columns, tables[0].rows[2], strict=True))
    assert cells["RMSE [mm]"] == f"{1e3 * quick.field.rmse(IEKF):.2f}"
    told = cheng_tracking.findings(quick)
    assert f"{quick.field.rmse(OBSERVER):.3f} m off" in told[0]
    assert set(cheng_tracking.figures(quick)) == {"passes", "switching"}


def test_errors_over_time_are_told_once_most_runs_show_a_track(quick):
    error = quick.field.over_time(TOLD)
    shown = np.isfinite(quick.field.error_m[TOLD]).mean(axis=0) >= 0.5
    np.testing.assert_array_equal(np.isfinite(error), shown)
    last = quick.field.error_m[TOLD][:, -1]
    assert error[-1] == pytest.approx(np.sqrt(np.mean(last**2)))
