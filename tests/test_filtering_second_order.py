"""Updates with curvature: the tangent's where there is none, honest where there is much."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from trackfield.filtering import extended, second_order
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

MODEL = RangeModel(sigma_m=0.1)


def test_of_a_target_that_is_well_known_it_is_the_tangent_s_update():
    prior = Gaussian(np.array([3.0, 2.0, 0.1, -0.2]), 1e-6 * (np.eye(4) + 0.3))
    sensors = np.array([[0.0, 0.0], [5.0, 1.0], [2.0, 6.0]])
    z = np.array([3.7, 2.3, 4.0])
    ours = second_order.update(prior, z, sensors, models=MODEL)
    plain = extended.update(prior, z, extended.Ranges(sensors, MODEL))
    assert_allclose(ours.posterior.mean, plain.posterior.mean, atol=1e-7)
    assert_allclose(ours.posterior.covariance, plain.posterior.covariance, rtol=1e-4, atol=1e-12)
    assert_allclose(ours.distance2, plain.distance2, rtol=1e-5)


def test_one_range_without_iterations_by_hand():
    prior = Gaussian(np.array([0.8, 0.0, 1.0]), np.diag([0.02, 0.05, 1.0]))
    found = second_order.update(
        prior, np.array([0.7]), np.zeros((1, 2)), models=MODEL, iterations=0
    )
    variance = 0.01 + (0.05 / 0.8) ** 2 / 2
    gain = 0.02 / (0.02 + variance)
    innovation = 0.7 - 0.8 - 0.05 / (2 * 0.8)
    assert_allclose(found.posterior.mean, [0.8 + gain * innovation, 0.0, 1.0], atol=1e-12)
    assert_allclose(found.posterior.covariance, np.diag([0.02 * (1 - gain), 0.05, 1.0]))
    assert found.distance2 == pytest.approx(innovation**2 / (0.02 + variance))


def nees_of(update, *, draws=4000):
    """Errors against covariances, for targets drawn from a wide belief near two sensors."""
    rng = np.random.default_rng(5)
    P = np.diag([0.01, 0.09])
    sensors = np.array([[0.0, 0.0], [0.2, 0.3]])
    p = np.array([0.7, 0.0]) + rng.standard_normal((draws, 2)) * np.sqrt(np.diag(P))
    z = np.linalg.norm(p[:, None] - sensors, axis=-1) + 0.03 * rng.standard_normal((draws, 2))
    prior = Gaussian(np.tile([0.7, 0.0], (draws, 1)), np.tile(P, (draws, 1, 1)))
    after = update(prior, z, sensors, RangeModel(sigma_m=0.03)).posterior
    e = after.mean - p
    d2 = (e * np.linalg.solve(after.covariance, e[..., None])[..., 0]).sum(-1)
    return np.minimum(d2, 25.0).mean(), np.mean((e**2).sum(-1))


def test_where_ranges_are_curved_the_covariance_stays_honest():
    plain, _ = nees_of(lambda g, z, s, m: extended.update(g, z, extended.Ranges(s, m)))
    curved, error = nees_of(lambda g, z, s, m: second_order.update(g, z, s, models=m))
    once, coarse = nees_of(lambda g, z, s, m: second_order.update(g, z, s, models=m, iterations=0))
    assert plain > 3.5
    assert curved < 3.0
    assert once < 2.3
    assert error < coarse  # what the iterations are for


def test_a_reading_that_was_not_made_says_nothing_and_runs_stay_apart():
    rng = np.random.default_rng(2)
    prior = Gaussian(rng.uniform(1, 3, (3, 4)), np.tile(np.diag([0.1, 0.2, 1.0, 1.0]), (3, 1, 1)))
    sensors = rng.uniform(0, 4, (3, 2, 2))
    z = np.array([[1.0, np.nan], [np.nan, np.nan], [2.0, 1.5]])
    whole = second_order.update(prior, z, sensors, models=MODEL)
    assert_allclose(whole.readings, [1, 0, 2])
    assert_allclose(whole.posterior.mean[1], prior.mean[1])
    assert_allclose(whole.posterior.covariance[1], prior.covariance[1])
    first = Gaussian(prior.mean[0], prior.covariance[0])
    one = second_order.update(first, z[0, :1], sensors[0, :1], models=MODEL)
    assert_allclose(whole.posterior.mean[0], one.posterior.mean)
    assert_allclose(whole.posterior.covariance[0], one.posterior.covariance)
