import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec

from trackfield.motion import (
    ConstantVelocity,
    CoordinatedTurn,
    CurvedMotion,
    RandomWalk,
    SteppedAcceleration,
    StraightLeg,
    UnknownTurn,
)

SECONDS = st.floats(0.0, 5.0)
RATES = st.floats(-3.0, 3.0)
CONTINUOUS = [
    ConstantVelocity(0.3),
    ConstantVelocity(0.3, 3),
    RandomWalk(0.2),
    CoordinatedTurn(0.7, 0.3),
    CoordinatedTurn(0.001, 0.3),
]


@pytest.mark.parametrize("motion", CONTINUOUS, ids=repr)
@given(a=SECONDS, b=SECONDS)
def test_two_steps_are_one_step(motion, a, b):
    F, Q = motion.transition, motion.noise
    np.testing.assert_allclose(F(b) @ F(a), F(a + b), atol=1e-12)
    np.testing.assert_allclose(F(b) @ Q(a) @ F(b).T + Q(b), Q(a + b), atol=1e-11)


@pytest.mark.parametrize("motion", CONTINUOUS[:2] + CONTINUOUS[3:], ids=repr)
def test_noise_is_the_integral_of_white_acceleration(motion):
    n = motion.transition(0.0).shape[0]
    white = np.diag([0.0] * (n // 2) + [0.3] * (n // 2))
    exact, _ = quad_vec(lambda s: motion.transition(s) @ white @ motion.transition(s).T, 0.0, 1.7)
    np.testing.assert_allclose(motion.noise(1.7), exact, rtol=1e-12, atol=1e-14)


def test_stepped_acceleration_is_wangs_model():
    # Wang (1), written out in his order [x, vx, y, vy], then put into ours.
    dt, qx, qy = 0.2, 0.025, 0.01
    F = np.array([[1, dt, 0, 0], [0, 1, 0, 0], [0, 0, 1, dt], [0, 0, 0, 1]])
    G = np.array([[dt**2 / 2, 0], [dt, 0], [0, dt**2 / 2], [0, dt]])
    ours = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
    motion = SteppedAcceleration((qx, qy))
    np.testing.assert_allclose(motion.transition(dt), F[ours], atol=0)
    np.testing.assert_allclose(motion.noise(dt), (G @ np.diag([qx, qy]) @ G.T)[ours], atol=1e-18)


@given(rate=RATES, dt=SECONDS)
def test_a_turn_keeps_the_speed_and_the_circle(rate, dt):
    state = np.array([1.0, -2.0, 3.0, 0.5])
    after = CoordinatedTurn(rate, 0.1).transition(dt) @ state
    assert np.hypot(*after[2:]) == pytest.approx(np.hypot(3.0, 0.5), rel=1e-12)
    if abs(rate) > 1e-3:
        to_centre = np.array([-state[3], state[2]]) / rate
        to_centre_after = np.array([-after[3], after[2]]) / rate
        np.testing.assert_allclose(after[:2] + to_centre_after, state[:2] + to_centre, atol=1e-9)


@given(rate=RATES, dt=st.floats(0.01, 3.0))
def test_an_unknown_turn_moves_like_a_known_one(rate, dt):
    state = np.array([1.0, -2.0, 3.0, 0.5])
    moved = UnknownTurn(0.1, 0.1).move(np.append(state, rate), dt)
    known = CoordinatedTurn(rate, 0.1).transition(dt) @ state
    np.testing.assert_allclose(moved, np.append(known, rate), atol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 1e-4, 0.0124, 0.0126, 0.5, -2.0])
def test_the_jacobian_of_an_unknown_turn_is_its_slope(rate):
    motion, dt, h = UnknownTurn(0.1, 0.1), 0.8, 1e-5
    state = np.array([1.0, -2.0, 3.0, 0.5, rate])
    slope = [
        (motion.move(state + h * e, dt) - motion.move(state - h * e, dt)) / (2 * h)
        for e in np.eye(5)
    ]
    np.testing.assert_allclose(motion.jacobian(state, dt), np.stack(slope, -1), atol=1e-8)


def test_an_unknown_turn_takes_many_states_at_once():
    motion = UnknownTurn(0.1, 0.2)
    states = np.random.default_rng(0).standard_normal((2, 3, 5))
    assert isinstance(motion, CurvedMotion)
    for i in np.ndindex(2, 3):
        np.testing.assert_array_equal(motion.move(states, 0.3)[i], motion.move(states[i], 0.3))
        one = motion.jacobian(states[i], 0.3)
        np.testing.assert_array_equal(motion.jacobian(states, 0.3)[i], one)
    np.testing.assert_allclose(motion.noise(0.3)[:4, :4], ConstantVelocity(0.1).noise(0.3))
    assert motion.noise(0.3)[4, 4] == pytest.approx(0.06)


def test_a_straight_leg_forgets_the_turn():
    leg = StraightLeg(0.1, 0.4)
    after = leg.transition(0.5) @ np.array([0.0, 0.0, 1.0, 2.0, 9.0])
    np.testing.assert_allclose(after, [0.5, 1.0, 1.0, 2.0, 0.0])
    assert leg.noise(0.5)[4, 4] == pytest.approx(0.16)
    np.testing.assert_array_equal(leg.noise(0.5)[:4, :4], ConstantVelocity(0.1).noise(0.5))
    assert not isinstance(leg, CurvedMotion)
