import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.filtering import kalman, smoothing
from trackfield.filtering.smoothing import Lag, Passed
from trackfield.motion import ConstantVelocity
from trackfield.types import Gaussian

MOTION, DT = ConstantVelocity(0.4), 0.3
H, R = np.array([[1.0, 0.2, 0.0, 0.0], [0.0, 1.0, 0.1, 0.3]]), np.diag([0.3, 0.1])
F, Q = MOTION.transition(DT), MOTION.noise(DT)


def filtered(seed, steps):
    """A run of the filter: prior, steps passed, beliefs, readings."""
    rng = np.random.default_rng(seed)
    prior = Gaussian(rng.standard_normal(4), np.diag([1.0, 2.0, 0.5, 0.3]))
    readings = rng.standard_normal((steps, 2))
    readings[steps // 2] = np.nan  # an outage
    beliefs, passed = [prior], []
    for z in readings:
        belief, info = kalman.step(
            beliefs[-1], z, sensor=kalman.Linear(H, R), motion=MOTION, dt_s=DT
        )
        passed.append(Passed(beliefs[-1], F, info.prior))
        beliefs.append(belief)
    return prior, passed, beliefs, readings


def dense(prior, readings):
    """The whole run as one Gaussian, its precision block-tridiagonal, solved outright."""
    K = len(readings)
    precision, vector = np.zeros((4 * K + 4, 4 * K + 4)), np.zeros(4 * K + 4)
    inverse = np.linalg.inv(prior.covariance)
    precision[:4, :4] += inverse
    vector[:4] += inverse @ prior.mean
    link = np.hstack([-F, np.eye(4)])
    for k, z in enumerate(readings):
        both, after = slice(4 * k, 4 * k + 8), slice(4 * k + 4, 4 * k + 8)
        precision[both, both] += link.T @ np.linalg.inv(Q) @ link
        if not np.isnan(z).any():
            precision[after, after] += H.T @ np.linalg.inv(R) @ H
            vector[after] += H.T @ np.linalg.inv(R) @ z
    P = np.linalg.inv(precision)
    mean = P @ vector
    blocks = [slice(4 * k, 4 * k + 4) for k in range(K + 1)]
    return [Gaussian(mean[b], P[b, b]) for b in blocks]


def same(a, b):
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-7, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), steps=st.integers(1, 9))
def test_smoothing_is_the_dense_gaussian(seed, steps):
    prior, passed, beliefs, readings = filtered(seed, steps)
    smoothed = smoothing.smooth(beliefs[-1], passed)
    exact = dense(prior, readings)
    assert len(smoothed) == len(exact) == steps + 1
    for a, b in zip(smoothed, exact, strict=True):
        same(a, b)


@pytest.mark.parametrize("lag", [0, 1, 3])
def test_fixed_lag_is_smoothing_with_what_was_known_then(lag):
    prior, passed, beliefs, readings = filtered(1, 7)
    state = Lag()
    for k, one in enumerate(passed, start=1):
        state, belief = smoothing.step(state, one, now=beliefs[k], lag=lag)
        if k < lag:
            assert belief is None
        else:
            same(belief, dense(prior, readings[:k])[k - lag])
    assert len(state.passed) == lag


def test_later_readings_never_make_a_state_less_certain():
    _, passed, beliefs, _ = filtered(2, 8)
    smoothed = smoothing.smooth(beliefs[-1], passed)
    for before, after in zip(beliefs, smoothed, strict=True):
        assert np.linalg.eigvalsh(before.covariance - after.covariance).min() > -1e-12


def test_many_at_once_is_one_by_one():
    runs = [filtered(seed, 4) for seed in range(3)]

    def stacked(of):
        return Gaussian(
            np.array([of(r).mean for r in runs]), np.array([of(r).covariance for r in runs])
        )

    passed = [
        Passed(stacked(lambda r, k=k: r[1][k].posterior), F, stacked(lambda r, k=k: r[1][k].prior))
        for k in range(4)
    ]
    together = smoothing.smooth(stacked(lambda r: r[2][-1]), passed)
    for i, (_, alone, beliefs, _) in enumerate(runs):
        for one, other in zip(together, smoothing.smooth(beliefs[-1], alone), strict=True):
            same(Gaussian(one.mean[i], one.covariance[i]), other)
