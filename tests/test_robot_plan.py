"""A robot led after a track in a vehicle: what it keeps, what it loses, and that it says so."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from robot_tracks import FIELD, sinusoid
from trackfield.errors import InputError
from trackfield.robot.car import Car
from trackfield.robot.horizon import Horizon, horizon_path
from trackfield.robot.obstacles import Obstacles
from trackfield.robot.plan import Mission, needed_speed, plan
from trackfield.robot.rule import Link, path_length, rule_path
from trackfield.robot.vehicle import Disc, Vehicle, move

LINK = Link(2.5, 1.4)
TRACK = sinusoid(64, 2.0, 2.5)
T_S = 0.5 * np.arange(65.0)
AHEAD = Horizon(region=FIELD)


def planned(track=TRACK, start=None, *, horizon=AHEAD, link=LINK, **vehicle):
    mission = Mission(link, Vehicle(**vehicle), horizon)
    start = track[0] if start is None else start
    return plan(mission, 0.5 * np.arange(float(len(track))), track, start=start)


def test_a_free_robot_goes_the_ways_of_horizon_and_rule():
    found = planned()
    path = horizon_path(TRACK[0], TRACK, t_s=T_S, reach_m=LINK.reach_m, horizon=AHEAD)
    assert_allclose(found.path.place, path)
    assert found.length_m == pytest.approx(path_length(TRACK[0], path))
    rule = rule_path(TRACK[0], TRACK, reach_m=LINK.reach_m)
    assert found.rule_m == pytest.approx(path_length(TRACK[0], rule))
    assert_allclose(planned(horizon=None).path.place, rule)
    assert found.bound_m <= found.optimum_m <= found.length_m <= 1.03 * found.optimum_m
    assert (found.hop_kept, found.lost_s, found.longest_lost_s) == (1.0, 0.0, 0.0)
    assert not len(found.late_steps)
    assert not found.too_slow


def test_a_robot_as_fast_as_the_target_never_loses_it():
    speed = float(np.linalg.norm(np.diff(TRACK, axis=0), axis=1).max() / 0.5)
    found = planned(max_speed_m_s=speed)
    assert found.hop_kept == 1.0
    assert (found.path.way_m <= 0.5 * speed + 1e-9).all()


def test_a_slow_robot_says_what_it_loses():
    found = planned(max_speed_m_s=0.25)
    assert found.too_slow
    assert found.needed_speed_m_s > 0.25
    assert found.hop_kept < 1.0
    away = np.linalg.norm(found.path.place - TRACK, axis=1)
    late = away > LINK.reach_m * (1.0 + 1e-9)
    assert np.array_equal(found.late_steps, np.flatnonzero(late))
    assert_allclose(found.path.behind_m, np.where(late, away - LINK.reach_m, 0.0))
    assert found.lost_s == pytest.approx(0.5 * late.sum())
    runs = "".join("x" if out else " " for out in late).split()
    assert found.longest_lost_s == pytest.approx(0.5 * max(map(len, runs)))
    assert (found.path.way_m <= 0.125 + 1e-9).all()


def test_no_robot_is_slower_than_the_needed_speed_and_keeps_the_hop():
    needed = needed_speed(T_S, TRACK, start=TRACK[0], reach_m=LINK.reach_m)
    kept = planned(max_speed_m_s=4.0 * needed)
    assert kept.hop_kept == 1.0
    assert planned(max_speed_m_s=0.9 * needed).hop_kept < 1.0
    # a straight line: from the start G less in all, later 2 G less between two places
    line = np.column_stack([np.arange(11.0), np.zeros(11)])
    assert needed_speed(np.arange(11.0), line, start=line[0], reach_m=1.0) == pytest.approx(0.9)
    far = needed_speed(np.arange(11.0), line, start=np.array([-5.0, 0.0]), reach_m=1.0)
    assert far == math.inf


def test_a_car_stays_within_its_limits():
    car = Car(max_speed_m_s=3.0, max_steering_rad=0.6, wheel_base_m=0.2)
    found = planned(car=car)
    assert found.hop_kept >= 0.95
    turned = np.abs(np.diff(found.path.heading_rad, prepend=0.0))
    assert (turned <= found.path.way_m / car.turning_radius_m + 1e-9).all()
    steps = np.linalg.norm(np.diff(found.path.place, axis=0, prepend=TRACK[:1]), axis=1)
    assert (steps <= found.path.way_m + 1e-9).all()
    assert (found.path.way_m <= 1.5 + 1e-9).all()


def test_obstacles_are_gone_around():
    wall = Obstacles([[[4.0, 2.0], [4.4, 2.0], [4.4, 8.0], [4.0, 8.0]]], margin_m=0.1)
    line = np.column_stack([np.linspace(1.0, 9.0, 60), np.full(60, 5.0)])
    for horizon in (AHEAD, None):
        found = planned(line, line[0], horizon=horizon, obstacles=wall)
        places = np.vstack([line[:1], found.path.place])
        assert wall.free(places).all()
        moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert (found.path.way_m >= moved - 1e-9).all()
        assert found.length_m > found.optimum_m
        assert found.path.reachable.all()
        assert found.hop_kept == 1.0


def test_a_car_stops_before_an_obstacle():
    wall = Obstacles([[[2.0, -5.0], [2.2, -5.0], [2.2, 5.0], [2.0, 5.0]]])
    car = Vehicle(car=Car(max_speed_m_s=10.0), obstacles=wall)
    target = np.array([4.0, 0.0])
    at, heading = np.zeros(2), 0.0
    for _ in range(30):
        went = move(car, at, heading, wanted=target, disc=Disc(target, 0.5), dt_s=0.3)
        assert wall.free(went.place)
        assert wall.clear(at, went.place)
        at, heading = went.place, went.heading_rad
    inside = move(car, target, 0.0, wanted=target, disc=Disc(target, 0.5), dt_s=0.3)
    assert inside.way_m == 0.0


def test_what_cannot_be_reached_is_said():
    box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    ring = [box * 3 + k for k in ([4, 0], [-4, 0], [0, 4], [0, -4])]  # a closed court about 0, 0
    court = Obstacles([0.5 * q for q in ring])
    track = np.array([[0.0, 0.0], [5.0, 0.0], [9.0, 9.0]])
    for car in (None, Car(max_speed_m_s=1.0)):
        found = planned(track, np.zeros(2), horizon=None, obstacles=court, car=car)
        assert found.path.reachable.tolist() == [True, False, False]
        assert found.late_steps.tolist() == [1, 2]
        assert_allclose(found.path.place, 0.0)


@pytest.mark.parametrize(
    ("times", "start", "word"),
    [
        (T_S[:5], (0, 5), "t_s"),
        (T_S[::-1], (0, 5), "t_s"),
        (np.full(65, np.nan), (0, 5), "t_s"),
        (T_S, (0, 5, 1), "start"),
        (T_S, (5.0, 5.0), "obstacle"),
    ],
)
def test_bad_input_is_refused(times, start, word):
    block = Obstacles([[[4, 4], [6, 4], [6, 6], [4, 6]]])
    with pytest.raises(InputError, match=word):
        plan(Mission(LINK, Vehicle(obstacles=block)), times, TRACK, start=np.array(start))
    with pytest.raises(InputError, match="max_speed_m_s"):
        Vehicle(max_speed_m_s=0.0)
