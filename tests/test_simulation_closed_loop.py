"""Closed loops: who is heard, what is spent, and that tracks live on what was asked for."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from scheduling_fields import MODEL, positions, site
from trackfield.errors import InputError
from trackfield.metrics.error import match
from trackfield.network.energy import Energy, mode_powers
from trackfield.network.node_index import NodeIndex
from trackfield.pipeline.tagged import Tracker
from trackfield.simulation.closed_loop import closed_loop, measuring, nothing, outcome, tallied
from trackfield.simulation.commanded import WorldSenses, run_commanded
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.on_demand import RangesOnDemand
from trackfield.simulation.scenario_file import scenario_from_toml
from trackfield.simulation.tagged import to_truth
from trackfield.simulation.world import make_world
from trackfield.types import Mode, Status, join_rows, select_rows

STEPS = 80


def path(x=4.0, y=6.0, vx=0.12, vy=0.08, steps=STEPS):
    """A straight way."""
    k = np.arange(steps)
    return np.column_stack([x + vx * k, y + vy * k])


def loop(paths=None, *, energy=None, seed=0, **settings):
    """A run with one place a second."""
    paths = path()[None] if paths is None else paths
    place = site(**{"watch": "never", **settings})
    place = dataclasses.replace(place, energy=energy or Energy())
    rng = np.random.default_rng(seed)
    burst = place.scheduling.burst
    senses = RangesOnDemand(NodeIndex(positions()), MODEL, paths, 1.0, rng, burst)
    tracker = Tracker(place)
    return place, list(closed_loop(place, senses, tracker, duration_s=float(paths.shape[1])))


def rmse(turns, paths, from_s=10.0):
    names = tuple(f"tag{i}" for i in range(len(paths)))
    truth = to_truth(np.arange(paths.shape[1], dtype=float), paths, names)
    tracks = join_rows([turn.tracks for turn in turns])
    found = match(truth, select_rows(tracks, tracks.t_s >= from_s))
    return math.sqrt(np.mean(np.sum(found.error[:, :2] ** 2, axis=1))), found.row.size


def test_only_those_are_heard_who_were_told_to_sense():
    _, turns = loop()
    modes = np.zeros(400, int)
    for k, turn in enumerate(turns):
        modes[turn.commands.sensor] = turn.commands.mode  # a node stays in its mode
        np.testing.assert_array_equal(turn.told.modes, modes)
        assert set(turn.readings.t_s.tolist()) <= {float(k)}
        assert (modes[turn.readings.sensor] >= Mode.SENSING).all()
        place = path()[k]
        near = np.hypot(*(positions()[turn.readings.sensor] - place).T)
        assert (near <= MODEL.max_range_m).all()
        told = measuring(turn.told)
        reached = np.hypot(*(positions() - place).T) <= MODEL.max_range_m
        assert len(turn.readings) == np.count_nonzero(told & reached)
    assert np.mean([len(turn.readings) for turn in turns[10:]]) < 5


def test_energy_is_that_of_the_modes_told():
    place, turns = loop()
    spent = np.zeros(400)
    for turn in turns:
        sensing = int((turn.told.modes == Mode.SENSING).sum())
        masters = max(int((turn.told.modes == Mode.MASTER).sum()), 1)
        spent += 1e-3 * mode_powers(place.energy, sensing / masters)[turn.told.modes]
        np.testing.assert_allclose(turn.meter.spent_j.sum(axis=1), spent, rtol=1e-12)
    found = outcome(turns, place)
    assert found.spent_j == pytest.approx(spent.sum())
    assert found.above_sleep_j == pytest.approx(spent.sum() - 0.13 * 400 * STEPS)
    assert found.in_mode_s.sum() == pytest.approx(400 * STEPS)
    shown = sum(bool((turn.tracks.status == Status.CONFIRMED).any()) for turn in turns)
    assert found.tracked_s == shown
    assert found.per_tracked_s == pytest.approx(found.above_sleep_j / shown)
    assert found.counts["commands"] == sum(len(turn.commands) for turn in turns)
    assert nothing().per_tracked_s == 0.0
    half = outcome(turns[:40], place)
    for turn in turns[40:]:
        half = tallied(half, turn, place)
    assert half.spent_j == pytest.approx(found.spent_j)
    assert half.troubles == found.troubles


def test_few_sensors_that_measure_often_are_as_good_as_all_for_a_fraction_of_the_energy():
    """All in range sense, against four that measure as often as all of them together."""
    errors, energies = {}, {}
    for name, settings in {
        "all": {"policy": "all"},
        "four": {},
        "often": {"burst": 12},
    }.items():
        squares, spent = [], []
        for seed in (1, 2, 3):
            place, turns = loop(seed=seed, **settings)
            error, count = rmse(turns, path()[None])
            assert count == STEPS - 10
            squares.append(error**2)
            spent.append(outcome(turns[10:], place).per_tracked_s)
        errors[name], energies[name] = math.sqrt(np.mean(squares)), np.mean(spent)
    assert errors["four"] < 0.25
    assert errors["often"] < 1.25 * errors["all"]
    assert energies["four"] < energies["all"] / 5
    assert energies["often"] < energies["all"] / 5


@pytest.mark.parametrize("policy", ["accuracy", "nearest", "soft", "all"])
def test_every_policy_keeps_its_targets(policy):
    paths = np.stack([path(), path(16.0, 15.0, -0.1, -0.1), path(4.0, 6.5)])
    place, turns = loop(paths, policy=policy)
    error, count = rmse(turns, paths)
    assert error < 0.35
    assert count > 0.97 * 3 * (STEPS - 10)
    assert outcome(turns, place).counts["lost"] == 0


def test_nodes_that_are_exhausted_in_a_pass_fall_silent_and_others_take_over():
    still = np.tile([[[10.0, 10.0]]], (1, STEPS, 1))
    place, turns = loop(still, energy=Energy(battery_j=80.0), energy_weight=2.0)
    dead = ~turns[-1].meter.alive
    assert dead.sum() > 3
    for turn in turns[1:]:
        assert not turn.told.modes[turn.meter.exhausted_s <= turn.told.t_s].any()
    assert outcome(turns, place).counts["exhausted"] == dead.sum()
    error, count = rmse(turns, still)
    assert count > 60
    assert error < 0.4


def test_a_target_that_leaves_is_given_up_and_one_that_comes_is_found():
    leaving = path(18.0, 10.0, 0.3, 0.0, 60)
    coming = path(-6.0, 10.0, 0.3, 0.0, 60)
    place, turns = loop(np.stack([leaving, coming]), watch="empty", sweep_s=3.0)
    lost = [turn.told.t_s for turn in turns if turn.told.lost]
    assert lost
    watching = [turn.told.t_s for turn in turns if turn.told.watching]
    assert watching
    last = turns[-1].tracks
    assert last.target_ids[int(last.target[0])] == "tag1"
    assert np.hypot(*(last.position[0, :2] - coming[-1])) < 1.0
    assert outcome(turns, place).tracked_s > 30


def test_ranges_on_demand_have_the_moments_of_their_model():
    nodes = np.array([[0.0, 0.0], [3.0, 0.0], [50.0, 0.0]])
    model = dataclasses.replace(MODEL, bias_m=0.5, sigma_scale=0.05)
    paths = np.tile([[[0.0, 2.0]]], (1, 20_000, 1))
    senses = RangesOnDemand(NodeIndex(nodes), model, paths, 0.5, np.random.default_rng(0), 4)
    found = senses.hear(0.0, 10_000.0, sensing=np.array([True, True, True]))
    assert set(found.sensor.tolist()) == {0, 1}
    for node, r in ((0, 2.0), (1, math.sqrt(13.0))):
        rows = found.sensor == node
        sigma = math.sqrt((0.2**2 + 0.05**2 * r**2) / 4.0)
        assert found.value[rows].mean() == pytest.approx(r + 0.5, abs=5 * sigma / 141)
        assert found.value[rows].std() == pytest.approx(sigma, rel=0.03)
        np.testing.assert_allclose(found.sigma[rows], sigma)
    part = senses.hear(10.0, 12.0, sensing=np.array([True, False, False]))
    assert part.t_s.tolist() == [10.0, 10.5, 11.0, 11.5]


WORLD = """
duration_s = 40
step_s = 0.5
region = [0, 0, 20, 20]
seed = 3
[sensors]
spacing_m = 2
{sensing}
[[targets]]
count = 1
at_start = 1
border = "bounce"
inset_m = 4
accel_sigma_m_s2 = 0.1
speed_m_s = [0.5, 0.8]
{more}
[scheduling]
{scheduling}
"""


def world_of(sensing, scheduling="", more=""):
    text = WORLD.format(sensing=sensing, scheduling=scheduling, more=more)
    return make_world(scenario_from_toml(text, "w.toml"))


def turns_of(world):
    settings = world.scenario.scheduling
    return list(run_commanded(world, WorldSenses(world, settings)))


def keys(readings):
    names = [readings.target_ids[i] if i >= 0 else "" for i in readings.target]
    return set(zip(readings.t_s, readings.sensor, names, readings.value, strict=True))


def test_a_world_says_the_same_whoever_is_listened_to():
    ranges = "[range]\nsigma_m = 0.2\nmax_range_m = 6"
    for interval in ("interval_s = 0.5", "interval_s = 1.25"):
        world = world_of(ranges, interval)
        every, _ = all_of(hear_readings(world))
        turns = turns_of(world)
        heard = keys(join_rows([turn.readings for turn in turns]))
        assert heard <= keys(every)
        assert 0 < len(heard) < len(every) / 2
        sensing = {turn.told.t_s: measuring(turn.told) for turn in turns}
        times = np.array(sorted(sensing))
        expected = {
            key
            for key in keys(every)
            if sensing[times[np.searchsorted(times, key[0], side="right") - 1]][key[1]]
        }
        assert heard == expected


def test_bursts_of_a_world_are_less_noisy_and_say_so():
    ranges = "[range]\nsigma_m = 0.2\nmax_range_m = 6"
    world = world_of(ranges, "burst = 16\npolicy = 'all'")
    readings = join_rows([turn.readings for turn in turns_of(world)])
    np.testing.assert_allclose(readings.sigma, 0.05)
    truth = world.truth
    place = truth.position[np.searchsorted(truth.t_s, readings.t_s), :2]
    r = np.hypot(*(place - world.deployment.told[readings.sensor]).T)
    assert np.std(readings.value - r) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize(
    ("sensing", "scheduling"),
    [
        ("[detection]\nradius_m = 5\np_detection = 0.95\np_false = 0.01", "sensors = 12"),
        ("[signal]\namplitude = 195\nmax_range_m = 8", "sensors = 10"),
    ],
)
def test_unknown_targets_are_tracked_by_those_that_are_awake(sensing, scheduling):
    world = world_of(sensing, f"interval_s = 0.5\nsweep_s = 8\n{scheduling}")
    turns = turns_of(world)
    after = [turn for turn in turns if turn.told.t_s >= 12.0]
    errors = []
    for turn in after:
        place = world.truth.position[np.argmin(np.abs(world.truth.t_s - turn.told.t_s)), :2]
        shown = np.isin(turn.tracks.status, (Status.CONFIRMED, Status.COASTING))
        gaps = np.hypot(*(turn.tracks.position[shown, :2] - place).T)
        errors.append(gaps.min() if gaps.size else np.inf)
    assert np.median(errors) < 1.0
    assert np.mean(np.array(errors) < 3.0) > 0.9
    sensing_nodes = np.mean([measuring(turn.told).sum() for turn in after])
    assert sensing_nodes < 40  # of 100
    if world.scenario.detection is not None:
        first = turns[0].readings
        assert len(first) == 100  # all sense, and all say 0 or 1
        assert set(first.value.tolist()) <= {0.0, 1.0}


def test_messages_of_nodes_that_sense_travel_the_network():
    network = "\n[network]\nhop_m = 5\np_delay = 0.3\ndelay_step_s = 0.5"
    group = "\n[[groups]]\nid = 'g'\nx_m = 10\ny_m = 10"
    world = world_of("[range]\nsigma_m = 0.2\nmax_range_m = 6" + network + group)
    senses = WorldSenses(world, world.scenario.scheduling)
    turns = list(run_commanded(world, senses))
    readings = join_rows([turn.readings for turn in turns])
    assert senses.passed.delayed > 0
    assert len(readings) <= senses.passed.sent
    assert (np.diff(readings.arrival_s) >= 0).all()
    senses.hear(40.0, 41.0, sensing=np.ones(100, bool))  # what was still on its way
    with pytest.raises(InputError, match="nothing more to hear"):
        senses.hear(41.0, 42.0, sensing=np.ones(100, bool))
