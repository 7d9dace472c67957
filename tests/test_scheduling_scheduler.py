"""The scheduler step by step: who sleeps, wakes, senses and is master, and what is said of it."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from scheduling_fields import SIDE_M, positions, scheduler, sighted
from trackfield.association.contract import Estimates
from trackfield.errors import InputError, StateError
from trackfield.raster import Region
from trackfield.scheduling.scheduler_state import (
    decode,
    encode,
    joined,
    nobody,
    sighted_estimates,
)
from trackfield.scheduling.watch import watch_border
from trackfield.types import Mode, Status

NODES = len(positions())


def walk(plan, states, *, steps, dt_s=1.0, residual=None):
    """Steps of tracks that move as they are believed to; what each one told."""
    state, every = plan.initial(), []
    x = np.array(states, float)
    for k in range(steps):
        now = x.copy()
        now[:, :2] += k * dt_s * x[:, 2:]
        state, told = plan.step(state, k * dt_s, sighted=sighted(k * dt_s, now), residual=residual)
        every.append(told)
    return state, every


@examples(max_examples=25)
@given(
    st.integers(0, 1000),
    st.sampled_from(["accuracy", "nearest", "soft", "all"]),
    st.integers(1, 5),
    st.integers(0, 4),
)
def test_commands_are_whole_and_the_dead_are_told_nothing(seed, policy, sensors, targets):
    rng = np.random.default_rng(seed)
    states = np.hstack([rng.uniform(0, SIDE_M, (targets, 2)), rng.normal(0, 0.5, (targets, 2))])
    residual = np.where(rng.random(NODES) < 0.3, 0.0, rng.random(NODES))
    plan = scheduler(policy=policy, sensors=sensors)
    state, every = walk(plan, states, steps=4, residual=residual)
    before = np.zeros(NODES, np.int8)
    for told in every:
        np.testing.assert_array_equal(told.changed, np.flatnonzero(told.modes != before))
        assert (told.modes[residual == 0.0] == Mode.SLEEPING).all()
        measuring = set(np.flatnonzero(told.modes >= Mode.SENSING).tolist())
        assert [service.track for service in told.services] == list(range(1, targets + 1))
        for service in told.services:
            assert set(service.sensors.tolist()) <= measuring
            assert service.master == -1 or told.modes[service.master] == Mode.MASTER
            assert service.trace_m2 <= 0.5
        before = told.modes
    assert encode(decode(encode(state), nodes=NODES)) == encode(state)


def test_nodes_wake_before_they_are_needed():
    _, every = walk(scheduler(), [[2.0, 10.0, 0.4, 0.1], [17.0, 5.0, -0.3, 0.2]], steps=30)
    assert sum(told.late for told in every[1:]) == 0
    for earlier, later in pairwise(every):
        assert (earlier.modes[later.modes >= Mode.SENSING] >= Mode.ACTIVE).all()
    awake = np.mean([np.count_nonzero(told.modes) for told in every])
    assert awake < 30  # of 400


def test_who_will_be_near_is_awake_as_long_before_as_was_asked_for():
    fast = [[1.0, 10.0, 1.5, 0.0]]
    for ahead_s in (0.0, None, 3.0):
        _, every = walk(scheduler(ahead_s=ahead_s), fast, steps=9)
        lead = 1.0 if ahead_s is None else ahead_s
        for k, told in enumerate(every):
            there = np.hypot(*(positions() - [1.0 + 1.5 * (k + lead), 10.0]).T)
            assert (told.modes[np.argsort(there)[:3]] >= Mode.ACTIVE).all()


def test_two_targets_side_by_side_share_their_sensors():
    _, apart = walk(scheduler(), [[5.0, 5.0, 0.1, 0.0], [15.0, 15.0, 0.1, 0.0]], steps=2)
    _, near = walk(scheduler(), [[10.0, 10.0, 0.1, 0.0], [10.5, 10.0, 0.1, 0.0]], steps=2)
    counts = [
        np.unique(np.concatenate([s.sensors for s in run[-1].services])).size
        for run in (apart, near)
    ]
    assert counts[0] == 8
    assert counts[1] < 6


def test_a_missed_target_is_looked_for_wider_and_wider_and_given_up_at_last():
    plan = scheduler()
    state, every = walk(plan, [[10.0, 10.0, 0.1, 0.0]], steps=3)
    asked = [every[-1].services[0].sensors.size]
    for k in range(3, 40):
        state, told = plan.step(state, float(k), sighted=nobody())
        if not told.services:
            break
        assert told.services[0].missed == k - 2
        asked.append(told.services[0].sensors.size)
    assert asked[:2] == [4, 8]
    assert asked[2] > 20  # all that may hear it
    assert asked[2:] == sorted(asked[2:])
    assert asked[-1] == NODES
    assert told.lost == (1,)
    assert not state.tracks
    assert not told.modes.any()


def test_a_reading_ends_the_search():
    plan = scheduler()
    state, _ = walk(plan, [[10.0, 10.0, 0.1, 0.0]], steps=3)
    for k in (3, 4, 5):
        state, told = plan.step(state, float(k), sighted=nobody())
    assert "look for it" in told.services[0].trouble[0]
    state, told = plan.step(state, 6.0, sighted=sighted(5.5, [[10.4, 10.0, 0.1, 0.0]]))
    assert (told.services[0].missed, told.services[0].sensors.size) == (0, 4)
    coasting = sighted(6.9, [[10.5, 10.0, 0.1, 0.0]], Status.COASTING)
    _, told = plan.step(state, 7.0, sighted=coasting)
    assert (told.services[0].missed, told.services[0].sensors.size) == (1, 8)


def test_readings_that_contradict_what_was_believed_bring_more_sensors():
    odd = sighted(0.0, [[10.0, 10.0, 0.1, 0.0]])._replace(odd=np.array([True]))
    plan = scheduler()
    _, told = plan.step(plan.initial(), 0.0, sighted=odd)
    assert told.services[0].sensors.size == 8


def test_a_track_that_is_known_well_enough_is_left_alone_and_not_missed():
    plan = scheduler(policy="soft", bound_m2=0.2)
    state, told = plan.step(plan.initial(), 0.0, sighted=sighted(0.0, [[10.0, 10.0, 0.1, 0.0]]))
    assert told.services[0].sensors.size == 0
    asked = 0
    for k in range(1, 6):
        state, told = plan.step(state, float(k), sighted=nobody())
        if asked == 0:
            assert told.services[0].missed == 0
        asked += told.services[0].sensors.size
    assert asked > 0  # its doubt grows beyond the bound


def test_all_sense_when_a_run_begins_and_when_a_track_ends_in_the_middle():
    plan = scheduler(sweep_s=2.0)
    state, told = plan.step(plan.initial(), 0.0, sighted=nobody())
    assert told.sweeping
    assert (told.modes == Mode.SENSING).all()
    state, told = plan.step(state, 1.0, sighted=sighted(1.0, [[10.0, 10.0, 0.0, 0.0]]))
    assert told.sweeping
    state, told = plan.step(state, 2.0, sighted=nobody())
    assert not told.sweeping
    ended = sighted(3.0, [[10.0, 10.0, 0.0, 0.0]], Status.ENDED)
    assert plan.step(state, 3.0, sighted=ended)[1].sweeping
    near, _ = plan.step(state, 3.0, sighted=sighted(3.0, [[0.5, 10.0, 0.0, 0.0]]))
    ended = sighted(4.0, [[0.3, 10.0, 0.0, 0.0]], Status.ENDED)
    _, told = plan.step(near, 4.0, sighted=ended)
    assert not told.sweeping  # it may have left
    assert not told.services


def watched(**settings):
    """A scheduler with a watch of the border."""
    plan = scheduler(**settings)
    region = Region(0.0, 0.0, SIDE_M, SIDE_M)
    watch = watch_border(
        plan.sensors.nodes, region, reach_m=plan.sensors.reach_m, depth_m=1.0, most=30
    )
    return dataclasses.replace(plan, watch=watch)


def border_seen(told, count):
    """Whether that many nodes sense every place of the border."""
    along = np.linspace(0.0, SIDE_M, 81)
    edges = [np.column_stack([along, np.full(81, y)]) for y in (0.0, SIDE_M)]
    border = np.concatenate([*edges, *(edge[:, ::-1] for edge in edges)])
    senses = positions()[told.modes == Mode.SENSING]
    near = np.hypot(*(border[:, None] - senses[None]).T) <= 4.0
    return bool((near.sum(axis=0) >= count).all())


def test_the_border_is_watched_while_nobody_is_inside():
    inside = sighted(0.0, [[10.0, 10.0, 0.0, 0.0]])
    for when, empty, busy in (("empty", True, False), ("always", True, True)):
        plan = watched(watch=when)
        state, told = plan.step(plan.initial(), 0.0, sighted=nobody())
        assert told.watching == empty
        assert border_seen(told, 3)
        assert 20 < np.count_nonzero(told.modes) < 150
        _, told = plan.step(state, 1.0, sighted=inside)
        assert told.watching == busy
        assert border_seen(told, 3) == busy
    shifts = [plan.step(plan.initial(), t, sighted=nobody())[1].modes for t in (0.0, 59.0, 61.0)]
    np.testing.assert_array_equal(shifts[0], shifts[1])
    assert (shifts[0] != shifts[2]).any()


def test_watchers_that_died_are_replaced_and_a_border_that_nobody_sees_is_said():
    plan = watched()
    _, before = plan.step(plan.initial(), 0.0, sighted=nobody())
    residual = np.ones(NODES)
    residual[np.flatnonzero(before.modes)[:3]] = 0.0
    _, told = plan.step(plan.initial(), 0.0, sighted=nobody(), residual=residual)
    assert border_seen(told, 3)
    _, told = plan.step(plan.initial(), 0.0, sighted=nobody(), residual=np.zeros(NODES))
    assert told.trouble == ("no node that lives sees the border",)
    assert not told.modes.any()


def test_a_master_stays_with_hysteresis_and_is_among_those_near():
    moves = [[2.0, 10.0, 0.5, 0.0]]
    changes = []
    for hysteresis in (0.0, 0.4):
        _, every = walk(scheduler(hysteresis=hysteresis), moves, steps=30)
        changes.append(sum(told.handovers for told in every))
        for k, told in enumerate(every):
            (service,) = told.services
            place = np.array([2.0 + 0.5 * k, 10.0])
            assert np.hypot(*(positions()[service.master] - place)) < 4.0
    assert changes[0] > changes[1] > 0


def test_a_master_whose_energy_is_gone_hands_over():
    plan = scheduler()
    state, told = plan.step(plan.initial(), 0.0, sighted=sighted(0.0, [[10.0, 10.0, 0.0, 0.0]]))
    residual = np.ones(NODES)
    residual[told.services[0].master] = 0.0
    _, after = plan.step(
        state, 1.0, sighted=sighted(1.0, [[10.0, 10.0, 0.0, 0.0]]), residual=residual
    )
    assert after.services[0].master not in (-1, told.services[0].master)
    assert after.handovers == 1


def test_where_nobody_hears_a_track_it_has_no_master_and_that_is_said():
    plan = scheduler()
    far = sighted(0.0, [[90.0, 90.0, 0.0, 0.0]])
    _, told = plan.step(plan.initial(), 0.0, sighted=far)
    (service,) = told.services
    assert (service.master, service.trouble) == (-1, ("no sensor is in range",))


def test_rows_that_are_no_numbers_are_left_out_and_said():
    rows = sighted(0.0, [[10.0, 10.0, 0.0, 0.0], [math.nan, 3.0, 0.0, 0.0]])
    plan = scheduler()
    _, told = plan.step(plan.initial(), 0.0, sighted=rows)
    assert [service.track for service in told.services] == [1]
    assert told.trouble == ("track 2: found a row that is not finite, and left it out",)


def test_a_newer_belief_counts_in_whatever_order_rows_come():
    old, new = (sighted(t, [[x, 10.0, 0.0, 0.0]]) for t, x in ((0.0, 5.0), (0.5, 15.0)))
    plan = scheduler()
    states = [
        plan.step(plan.initial(), 1.0, sighted=joined(*pair))[0]
        for pair in ((old, new), (new, old))
    ]
    assert [state.tracks[1].belief.mean[0] for state in states] == [15.0, 15.0]
    later = sighted(2.0, [[5.0, 10.0, 0.0, 0.0]])
    assert not plan.step(plan.initial(), 1.0, sighted=later)[0].tracks  # not known by then


def test_what_a_tracker_of_unknown_targets_shows_is_taken():
    known = Estimates(
        2.0,
        np.array([4, 5, 6], np.int32),
        np.array([0.9, 0.8, 0.1]),
        np.array([[1.0, 2.0, 0.0, 0.0]] * 3),
        np.tile(np.eye(4), (3, 1, 1)),
        np.zeros(3),
        np.array([True, False, True]),
        np.array([True, True, False]),
    )
    rows = sighted_estimates(known)
    assert rows.track.tolist() == [4, 5]
    assert rows.status.tolist() == [Status.CONFIRMED, Status.COASTING]
    assert rows.t_s.tolist() == [2.0, 2.0]


def test_times_and_residuals_that_cannot_be_are_refused():
    plan = scheduler()
    state, _ = plan.step(plan.initial(), 1.0, sighted=nobody())
    for t_s in (1.0, 0.5, math.nan):
        with pytest.raises(InputError, match="after those for"):
            plan.step(state, t_s, sighted=nobody())
    for residual in (np.ones(3), np.full(NODES, 1.5), np.full(NODES, math.nan)):
        with pytest.raises(InputError, match="residuals of shape"):
            plan.step(state, 2.0, sighted=nobody(), residual=residual)


def test_bytes_of_something_else_are_refused():
    plan = scheduler()
    state, _ = plan.step(plan.initial(), 1.0, sighted=nobody())
    data = encode(state)
    with pytest.raises(StateError, match="another scheduler"):
        decode(data, nodes=NODES + 1)
    with pytest.raises(StateError, match="another scheduler"):
        decode(data.replace(b'"version": 1', b'"version": 9'), nodes=NODES)
    with pytest.raises(StateError, match="modes that there are not"):
        decode(data[:-1] + b"\x07", nodes=NODES)
    with pytest.raises(StateError):
        decode(b"nonsense", nodes=NODES)


def test_readings_that_contradict_a_track_again_and_again_make_all_sense_that_may_hear_it():
    plan = scheduler()
    state, asked = plan.initial(), []
    for k in range(5):
        rows = sighted(float(k), [[10.0, 10.0, 0.0, 0.0]])._replace(odd=np.array([0 < k < 4]))
        state, told = plan.step(state, float(k), sighted=rows)
        asked.append(told.services[0].sensors.size)
    assert asked[:2] == [4, 8]
    assert 30 < asked[2] < asked[3]
    assert asked[4] == 4
