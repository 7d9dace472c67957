"""Who senses one target: against all sets, plain sorting, and what cannot be had."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from scheduling_fields import MODEL, able, field, positions
from trackfield.network.site import SchedulingSettings
from trackfield.scheduling.serving import choose, sensors_of
from trackfield.scheduling.soft_bound import Care
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

P = np.array([[0.02, 0.005], [0.005, 0.01]])


def plain_information(place, covariance, node):
    """Information of one range, by hand: u u' over noise and what the doubt across bends."""
    offset = place - node
    r = np.hypot(*offset)
    u = offset / r
    across = covariance.trace() - u @ covariance @ u
    return np.outer(u, u) / (MODEL.sigma_m**2 + 0.5 * (across / r) ** 2)


def candidates(places, place, covariance):
    """Nodes that surely reach the target and are not too near, the nearest first."""
    found = []
    for i, node in enumerate(places):
        offset = place - node
        r = np.hypot(*offset)
        u = offset / r
        along = np.sqrt(u @ covariance @ u)
        across = np.sqrt(covariance.trace() - along**2)
        if r + 2.0 * along <= MODEL.max_range_m and r >= 2.5 * across:
            found.append((r, i))
    return [i for _, i in sorted(found)]


@examples(max_examples=10)
@given(st.integers(0, 10_000))
def test_the_sensors_leave_the_least_trace_of_all_sets_of_the_nearest(seed):
    rng = np.random.default_rng(seed)
    places, place = positions(seed=seed), rng.uniform(4.0, 16.0, 2)
    settings = SchedulingSettings(sensors=2)
    found = choose(
        field(places), Gaussian(place, P), settings=settings, able=able(len(places)), wanted=2
    )
    pool = candidates(places, place, P)[:24]
    traces = {
        pair: np.linalg.inv(
            np.linalg.inv(P) + sum(plain_information(place, P, places[i]) for i in pair)
        ).trace()
        for pair in combinations(sorted(pool), 2)
    }
    assert found.trace_m2 == pytest.approx(min(traces.values()), rel=1e-9)
    assert traces[tuple(sorted(found.sensors.tolist()))] == pytest.approx(found.trace_m2)
    assert found.late == 0
    assert all("in one line" in one for one in found.trouble)  # the prior may make that the best


@examples(max_examples=20)
@given(st.integers(0, 10_000), st.integers(1, 8))
def test_the_nearest_are_those_that_can_tell_and_hear(seed, count):
    places = positions(seed=seed)
    settings = SchedulingSettings(policy="nearest")
    target = Gaussian(np.array([9.0, 11.0]), P)
    found = choose(field(places), target, settings=settings, able=able(len(places)), wanted=count)
    assert found.sensors.tolist() == candidates(places, target.mean, P)[:count]


def test_all_in_reach_sense_and_none_beyond():
    places = positions()
    settings = SchedulingSettings(policy="all")
    target = Gaussian(np.array([9.0, 11.0]), P)
    found = choose(field(places), target, settings=settings, able=able(len(places)), wanted=3)
    inside = np.flatnonzero(np.hypot(*(places - target.mean).T) <= MODEL.max_range_m)
    assert sorted(found.sensors.tolist()) == inside.tolist()


@examples(max_examples=8)
@given(st.integers(0, 1000), st.floats(0.5, 8.0))
def test_soft_takes_no_sensor_more_than_its_bound_needs(seed, share):
    places, place = positions(seed=seed), np.array([10.0, 10.0])
    bound = share * MODEL.sigma_m**2
    settings = SchedulingSettings(policy="soft", bound_m2=bound)
    wide = 4.0 * P
    found = choose(
        field(places), Gaussian(place, wide), settings=settings, able=able(len(places)), wanted=3
    )
    pool = candidates(places, place, wide)[:24]
    least = {}
    for k in range(4):
        least[k] = min(
            np.linalg.inv(
                np.linalg.inv(wide)
                + sum((plain_information(place, wide, places[i]) for i in s), np.zeros((2, 2)))
            ).trace()
            for s in combinations(pool, k)
        )
    enough = [k for k in range(4) if least[k] <= Care().aim * bound]
    assert found.sensors.size == (min(enough) if enough else 3)
    if not enough:
        assert found.trace_m2 == pytest.approx(least[3])
    assert bool(found.trouble) == (found.trace_m2 > bound)


def test_who_senses_anyway_serves_first_and_costs_nothing():
    places = positions()
    target = Gaussian(np.array([10.0, 10.0]), P)
    free = able(len(places))
    near = candidates(places, target.mean, P)
    free.taken[near[20:23]] = True
    found = choose(
        field(places), target, settings=SchedulingSettings(sensors=4), able=free, wanted=4
    )
    assert set(near[20:23]) <= set(found.sensors.tolist())
    assert found.sensors.size == 4


def test_who_is_awake_goes_before_who_sleeps_and_the_dead_never():
    places = positions()
    target = Gaussian(np.array([10.0, 10.0]), P)
    near = candidates(places, target.mean, P)
    some = able(len(places), ready=False)
    some.ready[near[10:15]] = True
    settings = SchedulingSettings()
    found = choose(field(places), target, settings=settings, able=some, wanted=4)
    assert set(found.sensors.tolist()) <= set(near[10:15])
    assert found.late == 0
    some.alive[near[10:13]] = False
    found = choose(field(places), target, settings=settings, able=some, wanted=4)
    assert not set(found.sensors.tolist()) & set(near[10:13])
    assert found.late > 0  # two that are awake do not do


def test_a_spent_node_is_spared():
    places = positions()
    target = Gaussian(np.array([10.0, 10.0]), P)
    everyone = able(len(places))
    settings = SchedulingSettings()
    before = choose(field(places), target, settings=settings, able=everyone, wanted=4)
    everyone.residual[before.sensors[0]] = 0.05
    after = choose(field(places), target, settings=settings, able=everyone, wanted=4)
    assert before.sensors[0] not in after.sensors
    assert after.trace_m2 >= before.trace_m2  # what it costs is told as it is


@pytest.mark.parametrize(
    ("places", "settings", "said"),
    [
        ([[90.0, 90.0], [91.0, 90.0]], {}, "no sensor is in range"),
        ([[9.0, 10.0], [10.0, 11.0], [90.0, 90.0]], {}, "2 sensors are in range, 4 were asked for"),
        ([[8.0, 10.0], [7.0, 10.0], [12.0, 10.0], [13.0, 10.0]], {}, "its sensors are in one line"),
        (
            [[8.0, 10.0], [10.0, 8.0]],
            {"policy": "soft", "bound_m2": 1e-4},
            "m^2 is the best trace, 0.0001 were asked for",
        ),
    ],
)
def test_what_cannot_be_had_is_said_with_the_best_there_is(places, settings, said):
    nodes = np.array(places)
    target = Gaussian(np.array([10.0, 10.0]), P)
    found = choose(
        field(nodes),
        target,
        settings=SchedulingSettings(**settings),
        able=able(len(nodes)),
        wanted=4,
    )
    assert any(said in line for line in found.trouble)
    assert found.sensors.size == min(np.sum(np.hypot(*(nodes - 10.0).T) < 3.5), 4)
    assert 0.0 < found.trace_m2 <= P.trace() + 1e-12


def test_detectors_whose_answer_does_not_change_with_the_place_are_taken_by_distance():
    places = positions()
    detectors = (DetectionModel(radius_m=3.0),) * len(places)
    sensors = sensors_of(places, detectors, np.full(len(places), 3.0))
    target = Gaussian(np.array([10.0, 10.0]), P)
    found = choose(sensors, target, settings=SchedulingSettings(), able=able(len(places)), wanted=3)
    order = np.argsort(np.hypot(*(places - 10.0).T))
    assert found.sensors.tolist() == order[:3].tolist()


def test_a_reach_without_limit_is_the_field():
    model = RangeModel(sigma_m=0.2)
    sensors = sensors_of(positions(), (model,) * 400, np.full(400, np.inf))
    assert sensors.farthest_m < 100.0
    target = Gaussian(np.array([10.0, 10.0]), P)
    settings = SchedulingSettings(policy="all")
    assert choose(sensors, target, settings=settings, able=able(400), wanted=1).sensors.size == 400
