"""The trackers of beacons and of angles behind the operator: what it promises holds for both."""

from itertools import pairwise

import numpy as np
import pytest

from trackfield.pipeline.dispatch import family_of, tracker_of
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.scenario_file import scenario_from_toml
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import make_world
from trackfield.types import Tracks, join_rows, select_rows

COLUMNS = ("t_s", "position", "velocity", "covariance", "status", "nis", "track", "target")
HEAD = """
duration_s = 7
step_s = 0.25
region = [0, 0, 12, 9]
[sensors]
layout = "listed"
positions = [[0, 0], [12, 0], [12, 9], [0, 9], [6, -1]]
[[targets]]
motion = "walk"
count = 2
inset_m = 2
"""
KINDS = {
    "angle": "[bearing]\nsigma_rad = 0.03\n[angular_rate]\nsigma_rad_s = 0.02\n",
    "rssi": "[rssi]\nsigma_db = 3\nmin_dbm = -84\n",
}
OUTPUTS = ({}, {"lag_s": 1.0}, {"lag_steps": 4, "every_s": 0.5})


@pytest.fixture(scope="module", params=KINDS)
def run(request):
    """A site, its readings as they come when some are up to .9 s late, and doubles among them."""
    world = make_world(scenario_from_toml(HEAD + KINDS[request.param]), seed=4)
    readings, _ = all_of(hear_readings(world))
    rng = np.random.default_rng(1)
    waits = rng.random(len(readings)) < 0.05
    arrival = readings.t_s + waits * rng.uniform(0.0, 0.9, len(readings))
    late = select_rows(readings, np.argsort(arrival, kind="stable"))
    double = np.sort(np.concatenate([np.arange(len(late)), rng.integers(len(late), size=5)]))
    return site_of(world), readings, select_rows(late, double)


def made(run, **asked):
    site, readings, _ = run
    return tracker_of(site, family_of(readings), **asked)


def same(a: Tracks, b: Tracks) -> None:
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.parametrize("asked", OUTPUTS, ids=("live", "lag", "thin"))
def test_cuts_change_nothing(run, asked):
    late = run[2]
    whole = made(run, **asked)
    rows = join_rows([whole.process(late), whole.finish()])
    assert {*rows.target.tolist()} == {0, 1}
    cut = made(run, **asked)
    edges = [0, 1, 2, 50, 51, 90, len(late)]
    parts = [cut.process(select_rows(late, slice(a, b))) for a, b in pairwise(edges)]
    same(join_rows([*parts, cut.finish()]), rows)
    assert cut.counts == whole.counts
    assert whole.counts["duplicate"] == 5


@pytest.mark.parametrize("asked", OUTPUTS, ids=("live", "lag", "thin"))
def test_a_restored_run_goes_on_bit_by_bit(run, asked):
    late = run[2]
    half = len(late) // 2
    first, second = made(run, **asked), made(run, **asked)
    first.process(select_rows(late, slice(half)))
    second.restore(first.snapshot())
    rest = select_rows(late, slice(half, None))
    same(first.process(rest), second.process(rest))
    same(first.finish(), second.finish())
    assert first.snapshot() == second.snapshot()


def test_late_readings_lead_to_the_state_of_punctual_ones(run):
    _, punctual, late = run
    a, b = made(run), made(run)
    a.process(late)
    b.process(punctual)
    shown = a.finish(), b.finish()
    states = [
        {
            name: t._filter.pack(s.life.state)
            for name, s in zip(t._numbering.targets, t._streams, strict=True)
        }
        for t in (a, b)
    ]
    assert states[0] == states[1]
    assert a.counts["late"] == 0
    assert all(len(rows) for rows in shown)


def test_hindsight_is_better(run):
    """On the whole: the same target, seen from a second later."""
    _, readings, _ = run
    live, lagged = made(run), made(run, lag_s=1.5)
    rows = [join_rows([t.process(readings), t.finish()]) for t in (live, lagged)]
    np.testing.assert_array_equal(rows[0].target_ids, rows[1].target_ids)
    spread = [np.mean(one.covariance[:, [0, 2]]) for one in rows]
    assert spread[1] < spread[0]
