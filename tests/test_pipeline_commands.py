"""Tracks in, commands out: against a scheduler stepped by hand, and under any cutting."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from scheduling_fields import MODEL, site, tracks
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.network.channel import Channel
from trackfield.network.site import Group, ReportSettings, SchedulingSettings, Site
from trackfield.pipeline.commands import Commander
from trackfield.pipeline.scheduled import reach_of, scheduler_of
from trackfield.scheduling.scheduler_state import sighted_rows
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.types import Commands, Mode, Status, join_rows, select_rows


def crossing(seed=0, rows=120, step_s=0.3, targets=2):
    """Rows of targets that cross the field, some of them out of order."""
    rng = np.random.default_rng(seed)
    t_s = step_s * np.sort(rng.integers(0, rows // targets, rows)) + 0.1
    track = rng.integers(1, targets + 1, rows)
    start = rng.uniform(3.0, 17.0, (targets, 2))
    velocity = rng.normal(0.0, 0.3, (targets, 2))
    where = start[track - 1] + t_s[:, None] * velocity[track - 1]
    late = rng.random(rows) < 0.1
    t_s = np.where(late, np.maximum(t_s - 1.0, 0.0), t_s)
    status = np.where(rng.random(rows) < 0.2, Status.COASTING, Status.CONFIRMED)
    status[-1:] = Status.ENDED
    return tracks(t_s, track, np.hstack([where, velocity[track - 1]]), status)


def whole(place, rows):
    """All commands of a run."""
    commander = Commander(place)
    return commander.process(rows), commander


def same(a: Commands, b: Commands):
    assert a.sensor_ids == b.sensor_ids
    for name in ("t_s", "sensor", "mode"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_commands_are_those_of_a_scheduler_that_is_told_what_was_shown_by_then():
    place, rows = site(sweep_s=1.0), crossing()
    commands, _ = whole(place, rows)
    plan = scheduler_of(place)
    state, modes, found, taken = plan.initial(), np.zeros(400, int), [], 0
    newest = np.maximum.accumulate(rows.t_s)
    for k in range(math.floor(newest[-1]) + 1):
        upto = int((newest < k).sum())
        sighted = sighted_rows(select_rows(rows, slice(taken, upto)), 0.01)
        state, told = plan.step(state, float(k), sighted=sighted)
        found += [(k, int(i), int(told.modes[i])) for i in np.flatnonzero(told.modes != modes)]
        modes, taken = told.modes, upto
    told = zip(commands.t_s, commands.sensor, commands.mode, strict=True)
    assert [(int(t), int(i), int(m)) for t, i, m in told] == found
    assert len(found) > 100


@examples(max_examples=10)
@given(st.integers(0, 100), st.lists(st.integers(0, 120), max_size=8), st.booleans())
def test_commands_do_not_depend_on_cuts_or_on_being_put_down_and_taken_up(seed, cuts, restarts):
    place, rows = site(), crossing(seed)
    expected, one = whole(place, rows)
    commander, parts = Commander(place), []
    for start, stop in zip([0, *sorted(cuts)], [*sorted(cuts), 120], strict=True):
        parts.append(commander.process(select_rows(rows, slice(start, stop))))
        if restarts:
            data = commander.snapshot()
            commander = Commander(place)
            commander.restore(data)
            assert commander.snapshot() == data
    same(join_rows(parts), expected)
    assert commander.counts == one.counts
    np.testing.assert_array_equal(commander.modes, one.modes)


def test_a_watermark_settles_what_no_row_can_change_any_more():
    place = site(interval_s=0.5, sweep_s=1.0)
    commander = Commander(place)
    first = commander.process(crossing(rows=0), watermark_s=0.0)
    assert len(first) == 400
    assert set(first.mode.tolist()) == {Mode.SENSING}
    assert not len(commander.process(crossing(rows=0), watermark_s=0.4))
    assert commander.told == ()
    rows = tracks([0.45], [1], np.array([[10.0, 10.0, 0.0, 0.0]]))
    assert not len(commander.process(rows))
    master = commander.process(crossing(rows=0), watermark_s=0.5)  # all others sense already
    assert master.mode.tolist() == [Mode.MASTER]
    assert commander.told[0].services[0].track == 1
    after = commander.process(crossing(rows=0), watermark_s=1.0)
    assert set(after.t_s.tolist()) == {1.0}
    assert np.count_nonzero(commander.modes) < 30
    assert commander.counts["intervals"] == 3
    assert commander.counts["commands"] == 401 + len(after)


def test_a_row_at_the_time_of_commands_counts_for_the_next():
    rows = tracks([1.0, 2.0], [1, 2], np.array([[10.0, 10.0, 0.0, 0.0], [4.0, 4.0, 0.0, 0.0]]))
    commander = Commander(site(sweep_s=0.0))
    commander.process(rows, watermark_s=3.0)
    told = [[service.track for service in told.services] for told in commander.told]
    assert told == [[], [1], [1, 2]]


def test_an_absurd_pause_costs_bounded_work():
    rows = tracks([0.5, 1e7], [1, 2], np.array([[10.0, 10.0, 0.0, 0.0]] * 2))
    commander = Commander(site(watch="never"))
    commands = commander.process(rows, watermark_s=1e7 + 1.0)
    assert commands.t_s.max() == 1e7 + 1.0
    assert commander.counts["intervals"] < 2_200
    assert commander.counts["lost"] == 1


def test_rows_without_a_time_are_passed_over():
    rows = tracks([math.nan, 0.5, math.nan], [1, 2, 3], np.array([[10.0, 10.0, 0.0, 0.0]] * 3))
    commander = Commander(site())
    commander.process(rows, watermark_s=1.0)
    assert [service.track for service in commander.told[-1].services] == [2]
    assert "track 3" in commander.told[-1].trouble[0]


def test_who_is_cut_off_and_who_has_no_energy_is_told_nothing():
    spots = np.array([[2.0, 2.0], [3.0, 2.0], [3.0, 3.0], [2.0, 4.0], [18.0, 18.0]])
    place = dataclasses.replace(
        site(spots, sweep_s=10.0),
        network=Channel(hop_m=3.0),
        groups=(Group("g", 1.0, 1.0),),
        reports=ReportSettings(),
    )
    commander = Commander(place)
    commands = commander.process(crossing(rows=0), watermark_s=0.0)
    assert commands.sensor.tolist() == [0, 1, 2, 3]
    commander.tell_energy(np.array([1.0, 0.5, 0.0, 1.0, 1.0]))
    commands = commander.process(crossing(rows=0), watermark_s=1.0)
    assert (commands.sensor.tolist(), commands.mode.tolist()) == ([2], [Mode.SLEEPING])
    for wrong in (np.ones(4), np.array([1.0, 1.0, 1.0, 1.0, math.nan])):
        with pytest.raises(InputError, match="from 0 to 1"):
            commander.tell_energy(wrong)


def test_snapshots_of_another_site_are_refused():
    data = Commander(site()).snapshot()
    with pytest.raises(StateError, match="another site"):
        Commander(site(sensors=2)).restore(data)
    with pytest.raises(StateError):
        Commander(site()).restore(b"nothing")


def test_a_site_says_what_its_scheduler_is():
    plan = scheduler_of(site(reach_m=2.5, watch="never"))
    assert plan.watch is None
    assert plan.sensors.farthest_m == 2.5
    assert scheduler_of(site()).sensors.farthest_m == MODEL.max_range_m
    line = scheduler_of(site(np.array([[1.0, 1.0], [2.0, 1.0], [3.0, 1.0]])))
    assert line.region == (-3.0, -3.0, 7.0, 5.0)
    assert reach_of(DetectionModel(radius_m=3.0, edge_m=1.0)) == 3.5
    assert reach_of(BearingModel()) == math.inf
    assert reach_of(EnergyMessageModel()) == math.inf
    with pytest.raises(ConfigurationError, match="no sensors that could be scheduled"):
        scheduler_of(Site("empty", (), np.zeros((0, 3)), ()))


@pytest.mark.parametrize("spots", [[[10.0, 10.0]], [[10.0, 10.0]] * 3])
def test_a_single_sensor_and_several_at_one_place_do_what_they_can(spots):
    commander = Commander(site(np.array(spots), sweep_s=0.0))
    rows = tracks([0.5], [1], np.array([[11.0, 10.0, 0.0, 0.0]]))
    commands = commander.process(rows, watermark_s=1.0)
    assert np.isfinite(commands.t_s).all()
    (service,) = commander.told[-1].services
    assert service.sensors.size == len(spots)
    assert service.master in range(len(spots))
    assert f"{len(spots)} sensors are in range, 4 were asked for" in service.trouble


@pytest.mark.parametrize("key", [f.name for f in dataclasses.fields(SchedulingSettings)])
def test_every_setting_makes_a_difference(key):
    other = {
        "policy": "nearest",
        "sensors": 2,
        "bound_m2": 0.02,
        "interval_s": 0.7,
        "burst": 50,
        "reach_m": 1.5,
        "near": 2.0,
        "far": 3.0,
        "alpha_deg": 120.0,
        "ahead_s": 3.0,
        "watch": "always",
        "sweep_s": 1.0,
        "hysteresis": 0.0,
        "energy_weight": 0.0,
    }
    base = {"policy": "soft"} if key in ("bound_m2", "burst") else {}
    energy = np.random.default_rng(0).uniform(0.01, 1.0, 400)

    def run(**settings):
        commander = Commander(site(**settings))
        commander.tell_energy(energy)
        return commander.process(crossing())

    usual, changed = run(**base), run(**base, **{key: other[key]})
    columns = [(c.t_s.tolist(), c.sensor.tolist(), c.mode.tolist()) for c in (usual, changed)]
    assert columns[0] != columns[1]
