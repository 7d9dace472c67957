import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.filtering import extended, kalman, unscented
from trackfield.filtering.extended import Ranges
from trackfield.filtering.matrices import apply
from trackfield.filtering.unscented import Spread
from trackfield.motion import CoordinatedTurn, UnknownTurn
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

SPREADS = [Spread(), Spread(0.5, 2.0, 1.0), Spread(1.0, 0.0, 2.0)]
SENSORS = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])


def belief(seed, shape=()):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((*shape, 4, 4))
    P = root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(4)
    return Gaussian(rng.standard_normal((*shape, 4)), P)


class Plane:
    H = np.array([[1.0, 0.5, 0.0, 0.1], [0.0, 1.0, 0.3, 0.0], [0.2, 0.0, 0.0, 1.0]])

    def predict(self, state):
        return apply(self.H, state)

    def jacobian(self, state):
        return np.broadcast_to(self.H, (*state.shape[:-1], 3, 4))

    def variance(self, reading):
        return np.broadcast_to([0.1, 0.2, 0.3], reading.shape)


class Drift:
    """A linear motion under the contract of curved ones."""

    F, Q = CoordinatedTurn(0.3, 0.1).transition(0.5), CoordinatedTurn(0.3, 0.1).noise(0.5)

    def move(self, state, dt_s):
        return apply(self.F, state)

    def jacobian(self, state, dt_s):
        return self.F

    def noise(self, dt_s):
        return self.Q


@pytest.mark.parametrize("spread", SPREADS, ids=str)
@given(seed=st.integers(0, 2**32 - 1))
def test_sigma_points_have_the_moments_of_the_belief(spread, seed):
    given_ = belief(seed)
    points = unscented.sigma_points(given_, spread=spread)
    mean = points.for_mean @ points.at
    apart = points.at - mean
    np.testing.assert_allclose(mean, given_.mean, atol=1e-9)
    np.testing.assert_allclose(
        (points.for_covariance[:, None] * apart).T @ apart, given_.covariance, atol=1e-9
    )
    assert points.for_mean.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("spread", SPREADS, ids=str)
def test_on_a_linear_model_it_is_the_kalman_filter(spread):
    prior, z = belief(1), np.array([0.3, np.nan, 2.0])
    exact = kalman.update(prior, z, kalman.Linear(Plane.H, np.diag([0.1, 0.2, 0.3])))
    updated = unscented.update(prior, z, Plane(), spread=spread)
    np.testing.assert_allclose(updated.posterior.mean, exact.posterior.mean, rtol=1e-8)
    np.testing.assert_allclose(
        updated.posterior.covariance, exact.posterior.covariance, rtol=1e-7, atol=1e-9
    )
    assert updated.log_likelihood == pytest.approx(exact.log_likelihood, rel=1e-8)
    moved = unscented.predict(prior, Drift(), dt_s=0.5, spread=spread)
    linear = kalman.predict(prior, Drift.F, Drift.Q)
    np.testing.assert_allclose(moved.mean, linear.mean, rtol=1e-9)
    np.testing.assert_allclose(moved.covariance, linear.covariance, rtol=1e-8, atol=1e-9)


def test_weights_are_those_of_the_scaled_transform():
    points = unscented.sigma_points(belief(7), spread=Spread(0.5, 2.0, 1.0))
    scale = 0.25 * (4 + 1.0) - 4  # lambda
    other = 0.5 / (4 + scale)
    first = scale / (4 + scale)
    np.testing.assert_allclose(points.for_mean, [first, *[other] * 8])
    np.testing.assert_allclose(points.for_covariance, [first + 1 - 0.25 + 2.0, *[other] * 8])


def test_update_is_the_textbook_one():
    prior = belief(2)
    sensor = Ranges(SENSORS, RangeModel(sigma_m=0.2))
    z = np.array([1.0, 3.0, 2.5])
    points = unscented.sigma_points(prior)
    y = np.array([sensor.predict(x) for x in points.at])
    mean = points.for_mean @ y
    dy, dx = y - mean, points.at - prior.mean
    S = sum(
        w * np.outer(a, a) for w, a in zip(points.for_covariance, dy, strict=True)
    ) + 0.04 * np.eye(3)
    C = sum(w * np.outer(a, b) for w, a, b in zip(points.for_covariance, dx, dy, strict=True))
    K = C @ np.linalg.inv(S)
    updated = unscented.update(prior, z, sensor)
    np.testing.assert_allclose(updated.posterior.mean, prior.mean + K @ (z - mean), rtol=1e-9)
    np.testing.assert_allclose(
        updated.posterior.covariance, prior.covariance - K @ S @ K.T, rtol=1e-8, atol=1e-10
    )
    assert updated.distance2 == pytest.approx((z - mean) @ np.linalg.inv(S) @ (z - mean))


def test_with_little_doubt_it_is_the_extended_filter():
    prior = Gaussian(np.array([1.0, 1.5, 0.2, 0.1]), 1e-6 * belief(3).covariance)
    sensor, z = Ranges(SENSORS, RangeModel(sigma_m=0.001)), np.array([1.803, 3.355, 1.803])
    one, other = unscented.update(prior, z, sensor), extended.update(prior, z, sensor)
    np.testing.assert_allclose(one.posterior.mean, other.posterior.mean, atol=1e-5)
    np.testing.assert_allclose(one.posterior.covariance, other.posterior.covariance, atol=1e-9)


def test_moments_of_a_curved_motion_are_nearer_the_truth_than_a_tangent():
    motion = UnknownTurn(0.0, 0.0)
    mean = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    start = Gaussian(mean, np.diag([1e-6, 1e-6, 1e-4, 1e-4, 0.3]))
    draws = np.random.default_rng(0).multivariate_normal(mean, start.covariance, 40_000)
    truth = motion.move(draws, 2.0).mean(axis=0)
    by_points = unscented.predict(start, motion, dt_s=2.0).mean
    by_tangent = extended.predict(start, motion, dt_s=2.0).mean
    assert np.abs(by_points - truth)[:2].max() < 0.05
    assert np.abs(by_tangent - truth)[:2].max() > 0.2


def test_many_at_once_is_one_by_one():
    many = belief(4, (2, 3))
    z = np.random.default_rng(5).uniform(1, 4, (2, 3, 3))
    z[0, 0, 1] = np.nan
    sensor = Ranges(SENSORS, RangeModel(sigma_m=0.2, sigma_scale=0.1))
    together = unscented.update(many, z, sensor)
    for i in np.ndindex(2, 3):
        made = ~np.isnan(z[i])
        alone = unscented.update(
            Gaussian(many.mean[i], many.covariance[i]),
            z[i][made],
            Ranges(SENSORS[made], sensor.models),
        )
        np.testing.assert_allclose(together.posterior.mean[i], alone.posterior.mean, rtol=1e-8)
        assert together.log_likelihood[i] == pytest.approx(alone.log_likelihood, rel=1e-8)


def test_step_predicts_first():
    prior, z = belief(6), np.array([0.3, 1.0, 2.0])
    posterior, info = unscented.step(prior, z, sensor=Plane(), motion=Drift(), dt_s=0.5)
    moved = unscented.predict(prior, Drift(), dt_s=0.5)
    np.testing.assert_array_equal(info.prior.mean, moved.mean)
    np.testing.assert_array_equal(
        posterior.mean, unscented.update(moved, z, Plane()).posterior.mean
    )
