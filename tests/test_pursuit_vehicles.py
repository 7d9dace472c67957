"""Vehicles of pursuit: what they promise of time, they keep by moving."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError
from trackfield.pursuit.steering import time_to_capture
from trackfield.pursuit.vehicles import Aims, Runner, Thruster, certain
from trackfield.pursuit.wheeled import Wheels
from trackfield.robot.car import Car

STEP = 0.5
PLACES = st.floats(-20.0, 20.0)
SPEEDS = st.floats(-1.5, 1.5)


def chase(vehicle, state, evader, *, steps, step_s=STEP):
    """States (steps + 1, k) of a pursuer, and of its evader (steps + 1, 4)."""
    states, evaders = [np.asarray(state, float)], [np.asarray(evader, float)]
    for _ in range(steps):
        here, there = states[-1][None], evaders[-1][None]
        commands = vehicle.commands(here, certain(there), step_s=step_s)
        states.append(vehicle.moved(here, commands, step_s=step_s)[0])
        evaders.append(evaders[-1] + step_s * np.array([*evaders[-1][2:], 0.0, 0.0]))
    return np.array(states), np.array(evaders)


@given(PLACES, PLACES, SPEEDS, SPEEDS)
def test_without_a_top_speed_the_time_is_ohs(x, y, vx, vy):
    states, evaders = np.array([[x, y, vx, vy], [0.0, 1.0, 0.0, 0.0]]), np.array([[3.0, 2, 1, -1]])
    found = Thruster(1.3).times(states, evaders)
    expected = time_to_capture(
        states[:, :2] - evaders[0, :2], states[:, 2:] - evaders[0, 2:], limit_m_s2=1.3
    )
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-12, atol=1e-12)


def simulated_time(x, v, top, evader):
    """Time of bang, coast, bang on one axis, by small steps of the obvious rule."""
    dt, t, U = 1e-3, 0.0, 1.0
    pursuer = v
    while t < 200.0:
        rel = pursuer - evader
        if abs(x) < 5e-3 and abs(rel) < 5e-3:
            return t
        s = 2.0 * U * x + rel * abs(rel)
        u = -U if s > 0.0 else U
        new = float(np.clip(pursuer + u * dt, -top, top))
        x += dt * (0.5 * (pursuer + new) - evader)
        pursuer, t = new, t + dt
    return np.inf


@pytest.mark.parametrize(
    ("x", "v", "evader"),
    [(-10.0, 0.0, 0.0), (-10.0, -1.0, 0.5), (8.0, 0.3, -0.7), (-1.0, 0.0, 0.2), (6.0, 1.4, 1.0)],
)
def test_with_a_top_speed_the_time_is_that_of_a_plain_simulation(x, v, evader):
    found = Thruster(1.0, speed_m_s=1.5).times(
        np.array([[x, 0.0, v, 0.0]]), np.array([[0.0, 0.0, evader, 0.0]])
    )
    assert found[0, 0] == pytest.approx(simulated_time(x, v, 1.5, evader), abs=0.03)


def test_thrusters_come_to_rest_at_their_evader_and_brake_without_one():
    vehicle = Thruster(1.0, speed_m_s=3.0)
    states, evaders = chase(vehicle, [8.0, -5.0, 0.0, 1.0], [0.0, 0.0, 0.5, -0.3], steps=40)
    np.testing.assert_allclose(states[-1], evaders[-1], atol=1e-8)
    assert np.abs(states[:, 2:]).max() <= 3.0
    nothing = certain(np.full((1, 4), np.nan))
    state = np.array([[0.0, 0.0, 2.0, -0.2]])
    for _ in range(4):
        state = vehicle.moved(state, vehicle.commands(state, nothing, step_s=STEP), step_s=STEP)
    assert (state[0, 2:] == 0.0).all()


def test_doubt_makes_a_thruster_brake_earlier():
    vehicle, state, aim = Thruster(), np.array([[-2.1, 0.0, 2.0, 0.0]]), np.zeros((1, 4))
    sure = vehicle.commands(state, certain(aim), step_s=STEP)
    doubtful = Aims(aim, np.full((1, 4), 0.5), np.array([0.3]))
    assert vehicle.commands(state, doubtful, step_s=STEP)[0, 0] < sure[0, 0]


def test_what_runs_away_faster_is_never_caught():
    evaders = np.array([[5.0, 0.0, 2.0, 0.0], [5.0, 0.0, -2.0, 0.0]])
    assert np.isinf(Thruster(1.0, speed_m_s=1.5).times(np.zeros((1, 4)), evaders)).all()
    times = Runner(1.0).times(np.zeros((1, 2)), evaders)[0]
    assert np.isinf(times[0])
    assert times[1] == pytest.approx(5.0 / 3.0)  # it comes by
    wheels = Wheels(Car(1.0)).times(np.zeros((1, 3)), evaders)[0]
    assert np.isinf(wheels[0])
    np.testing.assert_array_equal(
        Runner(1.0).commands(np.zeros((1, 2)), certain(evaders[:1]), step_s=STEP), 0.0
    )
    home = Wheels(Car(1.0)).commands(np.zeros((1, 3)), certain(evaders[:1]), step_s=STEP)
    np.testing.assert_array_equal(home, 0.0)


@given(PLACES, PLACES, SPEEDS, SPEEDS)
def test_runners_meet_when_they_say_and_no_sooner(x, y, vx, vy):
    vehicle, evader = Runner(1.6), np.array([[x, y, vx, vy]])
    time = float(vehicle.times(np.zeros((1, 2)), evader)[0, 0])
    if not np.isfinite(time):
        assert np.hypot(vx, vy) >= 1.6
        return
    assert np.hypot(x + time * vx, y + time * vy) == pytest.approx(1.6 * time, abs=1e-6)
    sooner = time * np.linspace(0.0, 0.999, 50)[:, None]
    gap = np.linalg.norm(evader[:, :2] + sooner * evader[:, 2:], axis=1) - 1.6 * sooner[:, 0]
    assert (gap >= -1e-9).all()
    steps = int(time / STEP) + 1
    if steps < 200 and np.hypot(vx, vy) <= 1.6:  # who is faster is met, but not followed
        states, evaders = chase(vehicle, [0.0, 0.0], evader[0], steps=steps)
        assert np.linalg.norm(states[-1] - evaders[-1, :2]) < 1e-6 * (1.0 + time)


def test_a_runner_as_fast_as_its_evader_meets_it_if_it_comes_nearer():
    found = Runner(1.0).times(np.zeros((1, 2)), np.array([[4.0, 0, -1.0, 0], [0, 0, 1, 0]]))
    np.testing.assert_allclose(found, [[2.0, 0.0]])


def test_wheels_meet_when_they_say():
    rng = np.random.default_rng(4)
    vehicle = Wheels(Car(2.0))
    for _ in range(20):
        pose = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        evader = np.array([*rng.uniform(-10.0, 10.0, 2), *rng.uniform(-0.8, 0.8, 2)])
        time = float(vehicle.times(pose[None], evader[None])[0, 0])
        assert time >= Runner(2.0).times(pose[None, :2], evader[None])[0, 0]
        goal = evader[:2] + time * evader[2:]
        parts = 20  # towards the same place, piece by piece
        for _ in range(parts):
            pose = vehicle.moved(pose[None], goal[None], step_s=time / parts)[0]
        assert np.linalg.norm(pose[:2] - goal) < 1e-4 * (1.0 + time)
    states, evaders = chase(vehicle, [0.0, 0.0, 2.0], [6.0, 3.0, 0.5, 0.4], steps=40)
    assert np.linalg.norm(states[-1, :2] - evaders[-1, :2]) < 0.3


@pytest.mark.parametrize(
    "make", [lambda: Thruster(0.0), lambda: Thruster(1.0, np.nan), lambda: Runner(np.inf)]
)
def test_vehicles_that_cannot_move_are_refused(make):
    with pytest.raises(ConfigurationError, match=r"expected a (finite )?number above 0"):
        make()
