"""The robot's rule and the car: least moves, exact arcs, manoeuvres that arrive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from trackfield.errors import InputError
from trackfield.robot import rule as robot
from trackfield.robot.car import Car, follow_legs, legs_to, moved, steer

PLACES = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)).map(np.array)
CAR = Car(max_speed_m_s=1.5, max_steering_rad=0.5, wheel_base_m=0.4)


@given(PLACES, PLACES, st.floats(0.01, 4.0))
def test_the_least_move_is_the_projection_that_an_optimizer_finds(place, target, reach):
    found = robot.least_move(place, target, reach_m=reach)
    away = float(np.linalg.norm(place - target))
    assert np.linalg.norm(found - place) == pytest.approx(max(0.0, away - reach), abs=1e-9)
    assert robot.beyond(found, target, reach_m=reach) == 0.0
    circle = minimize(
        lambda p: np.sum((p - place) ** 2),
        target,
        constraints={"type": "ineq", "fun": lambda p: reach**2 - np.sum((p - target) ** 2)},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert np.linalg.norm(circle.x - place) >= np.linalg.norm(found - place) - 1e-6
    assert_allclose(circle.x, found, atol=2e-3)


def test_least_moves_of_many_robots_and_reaches_are_those_of_each():
    rng = np.random.default_rng(0)
    places, targets = rng.normal(size=(2, 30, 2))
    reach = rng.uniform(0.1, 2.0, 30)
    together = robot.least_move(places, targets, reach_m=reach)
    alone = [
        robot.least_move(*pair, reach_m=r) for *pair, r in zip(places, targets, reach, strict=True)
    ]
    assert_allclose(together, alone)


def test_the_rule_keeps_the_hop_and_stands_still_inside():
    angle = np.linspace(0.0, 9.0, 80)
    track = np.column_stack([angle, 2.0 * np.sin(angle)])
    path = robot.rule_path(track[0], track, reach_m=0.6)
    gone = np.linalg.norm(path - track, axis=1)
    assert (gone <= 0.6 + 1e-12).all()
    steps = np.linalg.norm(np.diff(path, axis=0, prepend=track[:1]), axis=1)
    assert_allclose(gone[steps > 0.0], 0.6)  # it never goes in deeper than it must
    assert robot.path_length(track[0], path) == pytest.approx(steps.sum())
    assert_allclose(robot.rule_path(track[0], track, reach_m=20.0), track[:1].repeat(80, axis=0))


def test_beyond_says_how_far_the_hop_is_exceeded():
    assert_allclose(robot.beyond([[0, 3], [0, 1.0]], np.zeros((2, 2)), reach_m=1.0), [2.0, 0.0])


@pytest.mark.parametrize(
    ("radii", "word"),
    [
        ((2.0, 1.5, 0.5), "comm_m"),
        ((2.0, 1.5, -0.5), "error_m"),
        ((2.0, math.nan), "sensing_m"),
        ((math.inf, 1.0), "comm_m"),
    ],
)
def test_radii_that_leave_no_disc_are_refused(radii, word):
    with pytest.raises(InputError, match=word):
        robot.Link(*radii)


def test_reach_is_what_sensing_and_error_leave():
    assert robot.Link(2.5, 1.4, 0.1).reach_m == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("start", "targets"),
    [([0.0], np.zeros((3, 2))), ([0, 0], np.zeros((0, 2))), ([0, math.nan], np.zeros((3, 2)))],
)
def test_tracks_that_are_none_are_refused(start, targets):
    with pytest.raises(InputError):
        robot.checked_track(start, targets)


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.floats(-1.5, 1.5),
    st.floats(-0.5, 0.5),
    st.floats(0.0, 3.0),
)
def test_an_arc_is_what_integrating_the_car_gives(pose, speed, steering, t_s):
    def slope(_, q):
        pace = speed * math.cos(steering)
        turn = speed * math.sin(steering) / CAR.wheel_base_m
        return [pace * math.cos(q[2]), pace * math.sin(q[2]), turn]

    exact = moved(pose, CAR, speed_m_s=speed, steering_rad=steering, t_s=t_s)
    numeric = solve_ivp(slope, (0.0, t_s), pose, rtol=1e-10, atol=1e-12).y[:, -1]
    assert_allclose(exact, numeric, atol=1e-7)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), PLACES)
def test_a_manoeuvre_arrives_within_speed_and_steering(pose, goal):
    drive = steer(CAR, pose, goal, dt_s=60.0)
    assert_allclose(drive.pose[:2], goal, atol=1e-7)
    speed, steering, seconds = drive.controls.T
    assert (np.abs(speed) <= CAR.max_speed_m_s + 1e-12).all()
    assert (np.abs(steering) <= CAR.max_steering_rad + 1e-12).all()
    assert seconds.sum() <= 60.0
    replayed = np.array(pose)
    for v, phi, t in drive.controls:
        replayed = moved(replayed, CAR, speed_m_s=v, steering_rad=phi, t_s=t)
    assert_allclose(replayed, drive.pose, atol=1e-9)
    # in a straight line at best, and at most 1.1 turning radii more than that
    away = math.dist(pose[:2], goal)
    assert away - 1e-7 <= drive.way_m <= away + 1.1 * CAR.turning_radius_m


def test_no_manoeuvre_of_a_fine_grid_of_two_legs_is_shorter():
    R = CAR.turning_radius_m
    ways = np.linspace(-7.0 * R, 7.0 * R, 561)
    first, second = (grid.ravel() for grid in np.meshgrid(ways, ways))
    ends = [
        _arcs(second, after, _arcs(first, before / R, np.zeros((3, 1))))
        for before in (1.0, -1.0)
        for after in (0.0, -before / R)
    ]
    x, y = np.concatenate([pose[:2] for pose in ends], axis=1)
    total = np.tile(np.abs(first) + np.abs(second), 4)
    for goal in np.random.default_rng(1).uniform(-3.0, 3.0, (12, 2)):
        shortest = sum(abs(leg.way_m) for leg in legs_to(CAR, np.zeros(3), goal))
        near = np.hypot(x - goal[0], y - goal[1]) < 0.03
        assert near.any()
        assert total[near].min() == pytest.approx(shortest, abs=0.1)


def test_a_step_ends_with_its_time_and_with_its_way():
    ahead = np.array([9.0, 0.0])
    assert_allclose(steer(CAR, np.zeros(3), ahead, dt_s=2.0).pose, [3.0, 0.0, 0.0], atol=1e-12)
    legs = legs_to(CAR, np.zeros(3), [3.0, 4.0])
    short = follow_legs(CAR, np.zeros(3), legs, dt_s=60.0, most_m=1.0)
    assert short.way_m == pytest.approx(1.0)
    assert not legs_to(CAR, np.zeros(3), np.zeros(2))


def test_a_turn_costs_speed():
    """The front wheels are as fast as they may be, so that the centre is slower by cos(phi)."""
    aside = steer(CAR, np.zeros(3), [0.0, 5.0], dt_s=0.1)
    assert aside.way_m == pytest.approx(0.1 * 1.5 * math.cos(0.5))


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ((0.0,), "max_speed_m_s"),
        ((1.0, 0.0), "max_steering_rad"),
        ((1.0, 1.6), "max_steering_rad"),
        ((1.0, 0.5, -1.0), "wheel_base_m"),
    ],
)
def test_cars_that_cannot_drive_are_refused(values, word):
    with pytest.raises(InputError, match=word):
        Car(*values)


def _arcs(ways, curvature, poses):
    """Poses (3, n) after ways on circles, by the circle's centre: another form than the chord's."""
    x, y, heading = poses
    if curvature == 0.0:
        return np.array(
            [x + ways * np.cos(heading), y + ways * np.sin(heading), heading + 0 * ways]
        )
    turned = heading + ways * curvature
    x = x + (np.sin(turned) - np.sin(heading)) / curvature
    return np.array([x, y - (np.cos(turned) - np.cos(heading)) / curvature, turned])
