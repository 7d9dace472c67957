import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from trackfield.errors import ConfigurationError
from trackfield.filtering import extended, interacting, kalman
from trackfield.filtering.interacting import Bank, Modes
from trackfield.motion import ConstantVelocity, CoordinatedTurn, StraightLeg, UnknownTurn
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

H, R = np.eye(2, 4), 0.04 * np.eye(2)
DT = 0.5
BANK = Bank(
    (ConstantVelocity(0.02), CoordinatedTurn(0.8, 0.1), CoordinatedTurn(-0.8, 0.1)),
    (8.0, 2.0, 3.0),
)
START = Gaussian(np.array([0.0, 0.0, 1.0, 0.5]), np.diag([0.5, 0.4, 0.3, 0.2]))
READINGS = np.array([[0.6, 0.3], [1.0, 0.9]])


def linear(prior, z):
    return kalman.update(prior, z, kalman.Linear(H, R))


def condition(belief, motion, z):
    """One motion and one reading, in one line of linear algebra each."""
    F, Q = motion.transition(DT), motion.noise(DT)
    m, P = F @ belief.mean, F @ belief.covariance @ F.T + Q
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    posterior = Gaussian(m + K @ (z - H @ m), P - K @ H @ P)
    return Gaussian(m, P), posterior, multivariate_normal(H @ m, S).pdf(z)


def moments(weights, beliefs):
    mean = sum(w * b.mean for w, b in zip(weights, beliefs, strict=True))
    covariance = sum(
        w * (b.covariance + np.outer(b.mean - mean, b.mean - mean))
        for w, b in zip(weights, beliefs, strict=True)
    )
    return Gaussian(mean, covariance)


def same(a, b, tolerance=1e-9):
    np.testing.assert_allclose(a.mean, b.mean, atol=tolerance)
    np.testing.assert_allclose(a.covariance, b.covariance, atol=tolerance)


def test_one_mode_is_the_kalman_filter():
    bank = Bank((BANK.motions[0],), (1.0,))
    modes, belief = interacting.init(START, (1.0,)), START
    for z in READINGS:
        modes, info = interacting.step(modes, z, rule=linear, bank=bank, dt_s=DT)
        belief, alone = kalman.step(
            belief, z, sensor=kalman.Linear(H, R), motion=bank.motions[0], dt_s=DT
        )
        same(interacting.combined(modes), belief)
        assert info.log_likelihood == pytest.approx(alone.update.log_likelihood)
        assert modes.weights == pytest.approx([1.0])


def test_two_steps_are_the_enumeration_of_all_mode_sequences():
    shares, T = np.array([0.5, 0.3, 0.2]), BANK.switching(DT)
    modes = interacting.init(START, shares)
    first, info = interacting.step(modes, READINGS[0], rule=linear, bank=BANK, dt_s=DT)
    exact = [condition(START, motion, READINGS[0]) for motion in BANK.motions]
    joint = (shares @ T) * [likelihood for *_, likelihood in exact]
    np.testing.assert_allclose(first.weights, joint / joint.sum(), rtol=1e-9)
    assert info.log_likelihood == pytest.approx(np.log(joint.sum()), rel=1e-9)
    for j, (_, posterior, _) in enumerate(exact):
        same(interacting.belief_of(first, j), posterior)

    # Before the second reading each mode's moments are those of the sequences that end in it.
    second = interacting.predict(first, BANK, dt_s=DT)
    for j, motion in enumerate(BANK.motions):
        weights = first.weights * T[:, j]
        assert second.weights[j] == pytest.approx(weights.sum(), rel=1e-9)
        carried = [condition(posterior, motion, READINGS[1])[0] for _, posterior, _ in exact]
        same(interacting.belief_of(second, j), moments(weights / weights.sum(), carried))
    sequences = list(itertools.product(range(3), range(3)))
    weights = np.array([first.weights[i] * T[i, j] for i, j in sequences])
    carried = [condition(exact[i][1], BANK.motions[j], READINGS[1])[0] for i, j in sequences]
    same(interacting.combined(second), moments(weights, carried))


@given(seed=st.integers(0, 2**32 - 1))
def test_mixing_keeps_the_moments_of_the_whole(seed):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((3, 4, 4))
    modes = Modes(
        rng.dirichlet(np.ones(3)),
        Gaussian(rng.standard_normal((3, 4)), root @ np.swapaxes(root, -1, -2)),
    )
    switching = rng.dirichlet(np.ones(3), size=3)
    mixed = interacting.mix(modes, switching)
    same(interacting.combined(mixed), interacting.combined(modes))
    np.testing.assert_allclose(mixed.weights, modes.weights @ switching, atol=1e-12)
    beliefs = [interacting.belief_of(modes, j) for j in range(3)]
    same(interacting.combined(modes), moments(modes.weights, beliefs))


@given(dt=st.floats(0.0, 100.0))
def test_chances_to_switch(dt):
    chances = BANK.switching(dt)
    np.testing.assert_allclose(chances.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.diag(chances), np.exp(-dt / np.array(BANK.stay_s)))
    assert chances[0, 1] == chances[0, 2] >= 0.0


def test_many_at_once_is_one_by_one():
    rng = np.random.default_rng(3)
    mean = START.mean + rng.standard_normal((4, 4))
    belief = Gaussian(mean, np.broadcast_to(START.covariance, (4, 4, 4)))
    z = rng.standard_normal((4, 2))
    z[2] = np.nan
    together, info = interacting.step(
        interacting.init(belief, (0.5, 0.3, 0.2)), z, rule=linear, bank=BANK, dt_s=DT
    )
    for i in range(4):
        alone, alone_info = interacting.step(
            interacting.init(Gaussian(mean[i], START.covariance), (0.5, 0.3, 0.2)),
            z[i],
            rule=linear,
            bank=BANK,
            dt_s=DT,
        )
        np.testing.assert_allclose(together.weights[i], alone.weights, rtol=1e-10)
        np.testing.assert_allclose(together.beliefs.mean[i], alone.beliefs.mean, rtol=1e-9)
        assert info.log_likelihood[i] == pytest.approx(alone_info.log_likelihood, abs=1e-9)


def test_a_reading_beyond_all_belief_leaves_finite_weights():
    modes = interacting.init(START, (0.5, 0.3, 0.2))
    after, _ = interacting.step(modes, np.array([1e100, 0.0]), rule=linear, bank=BANK, dt_s=DT)
    assert np.isfinite(after.weights).all()
    assert after.weights.sum() == pytest.approx(1.0)


def test_a_bank_of_straight_and_turning_learns_which_it_is():
    """Ranges of a target that goes straight, then turns: weights and rate follow."""
    rng = np.random.default_rng(4)
    sensors = np.array([[-5.0, -5.0], [25.0, -5.0], [25.0, 15.0], [-5.0, 15.0]])
    sensor = extended.Ranges(sensors, RangeModel(sigma_m=0.05))
    bank = Bank((StraightLeg(0.002, 0.5), UnknownTurn(0.002, 0.02)), (10.0, 10.0))
    P = np.diag([0.1, 0.1, 0.1, 0.1, 0.25])
    modes = interacting.init(Gaussian(np.array([0.0, 0.0, 1.0, 0.0, 0.0]), P), (0.5, 0.5))
    truth, rates, turning = np.array([0.0, 0.0, 1.0, 0.0, 0.0]), [], []
    move = UnknownTurn(0.0, 0.0)
    for k in range(160):
        truth[4] = 0.0 if k < 80 else 0.6
        truth = move.move(truth, 0.1)
        z = np.linalg.norm(truth[:2] - sensors, axis=1) + 0.05 * rng.standard_normal(4)
        modes, _ = interacting.step(
            modes, z, rule=lambda p, y: extended.update(p, y, sensor), bank=bank, dt_s=0.1
        )
        rates.append(interacting.combined(modes).mean[4])
        turning.append(modes.weights[1])
    assert np.mean(turning[40:80]) < 0.35
    assert np.mean(turning[120:]) > 0.9
    assert np.mean(rates[120:]) == pytest.approx(0.6, abs=0.15)
    assert np.hypot(*(interacting.combined(modes).mean - truth)[:2]) < 0.1


def test_a_bank_needs_a_stay_for_each_motion():
    with pytest.raises(ConfigurationError, match="2 motions and 1 stays"):
        Bank((ConstantVelocity(1.0), ConstantVelocity(2.0)), (1.0,))
