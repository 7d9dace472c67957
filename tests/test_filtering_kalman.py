import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from trackfield.filtering import kalman
from trackfield.motion import ConstantVelocity
from trackfield.types import Gaussian


def random_problem(seed, n=4, m=3):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n))
    noise = rng.standard_normal((m, m))
    prior = Gaussian(rng.standard_normal(n), root @ root.T + 0.1 * np.eye(n))
    R = noise @ noise.T + 0.1 * np.eye(m)
    return prior, rng.standard_normal(m), kalman.Linear(rng.standard_normal((m, n)), R)


@given(seed=st.integers(0, 2**32 - 1))
def test_update_is_the_conditional_of_the_joint_gaussian(seed):
    prior, z, (H, R) = random_problem(seed)
    updated = kalman.update(prior, z, kalman.Linear(H, R))
    information = np.linalg.inv(prior.covariance) + H.T @ np.linalg.inv(R) @ H
    vector = np.linalg.inv(prior.covariance) @ prior.mean + H.T @ np.linalg.inv(R) @ z
    np.testing.assert_allclose(
        updated.posterior.mean, np.linalg.solve(information, vector), rtol=1e-6, atol=1e-8
    )
    np.testing.assert_allclose(
        updated.posterior.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-8
    )
    S = H @ prior.covariance @ H.T + R
    expected = multivariate_normal(H @ prior.mean, S).logpdf(z)
    assert updated.log_likelihood == pytest.approx(expected, rel=1e-6)
    e = z - H @ prior.mean
    assert updated.distance2 == pytest.approx(e @ np.linalg.inv(S) @ e, rel=1e-6)
    assert updated.readings == 3


@given(seed=st.integers(0, 2**32 - 1), m=st.integers(1, 9))
def test_information_form_is_covariance_form(seed, m):
    prior, z, (H, R) = random_problem(seed, m=m)
    variance = np.diag(R)
    one = kalman.update(prior, z, kalman.Linear(H, np.diag(variance)))
    other = kalman.update_information(prior, z, H, variance=variance)
    for a, b in zip(one.posterior, other.posterior, strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-7, atol=1e-8)
    assert other.log_likelihood == pytest.approx(one.log_likelihood, rel=1e-7, abs=1e-7)
    assert other.distance2 == pytest.approx(one.distance2, rel=1e-7, abs=1e-7)
    assert other.readings == m


@pytest.mark.parametrize("form", ["covariance", "information"])
def test_a_reading_that_was_not_made_says_nothing(form):
    prior, z, (H, R) = random_problem(1)
    variance = np.diag(R)
    missing = np.array([z[0], np.nan, z[2]])

    def condition(z, H, variance):
        if form == "covariance":
            return kalman.update(prior, z, kalman.Linear(H, np.diag(variance)))
        return kalman.update_information(prior, z, H, variance=variance)

    some = condition(missing, H, variance)
    rest = condition(z[[0, 2]], H[[0, 2]], variance[[0, 2]])
    np.testing.assert_allclose(some.posterior.mean, rest.posterior.mean, rtol=1e-12)
    np.testing.assert_allclose(some.posterior.covariance, rest.posterior.covariance, rtol=1e-12)
    assert some.log_likelihood == pytest.approx(rest.log_likelihood, rel=1e-12)
    assert some.readings == 2

    none = condition(np.full(3, np.nan), H, variance)
    np.testing.assert_allclose(none.posterior.mean, prior.mean, rtol=1e-14)
    np.testing.assert_allclose(none.posterior.covariance, prior.covariance, rtol=1e-14)
    assert none.log_likelihood == 0.0
    assert none.distance2 == 0.0


@pytest.mark.parametrize("form", ["covariance", "information"])
def test_many_at_once_is_one_by_one(form):
    problems = [random_problem(seed) for seed in range(6)]
    mean = np.array([p[0].mean for p in problems]).reshape(2, 3, 4)
    P = np.array([p[0].covariance for p in problems]).reshape(2, 3, 4, 4)
    z = np.array([p[1] for p in problems]).reshape(2, 3, 3)
    H = np.array([p[2].H for p in problems]).reshape(2, 3, 3, 4)
    v = np.array([np.diag(p[2].R) for p in problems]).reshape(2, 3, 3)

    def condition(prior, z, H, v):
        if form == "covariance":
            return kalman.update(prior, z, kalman.Linear(H, v[..., None] * np.eye(3)))
        return kalman.update_information(prior, z, H, variance=v)

    together = condition(Gaussian(mean, P), z, H, v)
    for i in np.ndindex(2, 3):
        alone = condition(Gaussian(mean[i], P[i]), z[i], H[i], v[i])
        np.testing.assert_allclose(together.posterior.mean[i], alone.posterior.mean, rtol=1e-11)
        np.testing.assert_allclose(
            together.posterior.covariance[i], alone.posterior.covariance, rtol=1e-10, atol=1e-13
        )
        assert together.log_likelihood[i] == pytest.approx(alone.log_likelihood, rel=1e-11)
        assert together.distance2[i] == pytest.approx(alone.distance2, rel=1e-10)


def test_the_covariance_stays_positive_definite_when_readings_are_almost_exact():
    rng = np.random.default_rng(2)
    belief = Gaussian(np.zeros(4), 1e6 * np.eye(4))
    motion = ConstantVelocity(1e-6)
    for _ in range(200):
        belief, info = kalman.step(
            belief,
            rng.standard_normal(2),
            sensor=kalman.Linear(np.eye(2, 4), 1e-10 * np.eye(2)),
            motion=motion,
            dt_s=0.1,
        )
        assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
        np.testing.assert_array_equal(belief.covariance, belief.covariance.T)
    np.testing.assert_array_equal(info.update.posterior.mean, belief.mean)


def test_filter_is_the_last_block_of_the_dense_gaussian():
    rng = np.random.default_rng(3)
    motion, dt, K = ConstantVelocity(0.4), 0.3, 6
    H, R = rng.standard_normal((2, 4)), np.diag([0.3, 0.1])
    prior = Gaussian(rng.standard_normal(4), np.diag([1.0, 2.0, 0.5, 0.3]))
    readings = rng.standard_normal((K, 2))
    belief, total = prior, 0.0
    for z in readings:
        belief, info = kalman.step(belief, z, sensor=kalman.Linear(H, R), motion=motion, dt_s=dt)
        total += float(info.update.log_likelihood)

    # x_0, w_1..w_K are independent; every state is linear in them.
    F, Q = motion.transition(dt), motion.noise(dt)
    powers = [np.linalg.matrix_power(F, k) for k in range(K + 1)]
    maps = np.zeros((K + 1, 4, 4 * (K + 1)))
    for k in range(K + 1):
        for j in range(k + 1):
            maps[k, :, 4 * j : 4 * j + 4] = powers[k - j]
    spread = np.kron(np.eye(K + 1), Q)
    spread[:4, :4] = prior.covariance
    states = maps.reshape(-1, 4 * (K + 1))
    mean = np.concatenate([p @ prior.mean for p in powers])
    P = states @ spread @ states.T
    seen = np.kron(np.eye(K + 1)[1:], H)
    S = seen @ P @ seen.T + np.kron(np.eye(K), R)
    gain = P @ seen.T @ np.linalg.inv(S)
    dense_mean = mean + gain @ (readings.ravel() - seen @ mean)
    dense_P = P - gain @ seen @ P
    np.testing.assert_allclose(belief.mean, dense_mean[-4:], rtol=1e-9)
    np.testing.assert_allclose(belief.covariance, dense_P[-4:, -4:], rtol=1e-9, atol=1e-12)
    log_pdf = multivariate_normal(seen @ mean, S).logpdf(readings.ravel())
    assert total == pytest.approx(log_pdf, rel=1e-10)
