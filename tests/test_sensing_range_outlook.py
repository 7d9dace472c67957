"""Ranges of an uncertain target: moments against drawing them, closed forms, limits."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from trackfield.errors import InputError
from trackfield.sensing.range import RangeModel, columns, jacobian
from trackfield.sensing.range_outlook import gains, nearness, outlook, standing
from trackfield.types import Gaussian

PLAIN = RangeModel(sigma_m=0.1, max_range_m=1.4)


def drawn(model, sensor, position, count=400_000):
    rng = np.random.default_rng(3)
    p = rng.multivariate_normal(position.mean, position.covariance, count)
    r = np.linalg.norm(p - sensor, axis=1)
    noise = np.sqrt(model.sigma_m**2 + model.sigma_scale**2 * r**2)
    z = (1.0 + model.scale) * r + model.bias_m + noise * rng.standard_normal(count)
    return z.mean(), z.var()


@pytest.mark.parametrize("d", [2, 3])
def test_moments_are_those_of_drawn_readings(d):
    model = RangeModel(sigma_m=0.005, scale=0.1, bias_m=0.3, sigma_scale=0.002)
    axes, _ = np.linalg.qr(np.random.default_rng(d).standard_normal((d, d)))
    P = axes @ np.diag([1e-4, 0.02, 0.008][:d]) @ axes.T  # wide across, narrow along
    position = Gaussian(np.arange(1.0, d + 1), P)
    sensor = position.mean - 0.9 * axes[:, 0]
    seen = outlook(model, sensor[None], position=position)
    mean, variance = drawn(model, sensor, position)
    linear = (seen.slope[0] @ P) @ seen.slope[0]
    bend, spread = mean - 1.1 * seen.distance[0] - 0.3, variance - linear - 0.005**2
    assert bend > 0.01
    assert spread > 2e-4
    assert seen.expected[0] - 1.1 * seen.distance[0] - 0.3 == pytest.approx(bend, rel=0.05)
    assert seen.variance[0] - 0.005**2 == pytest.approx(spread, rel=0.1)


def test_in_the_plane_variance_is_that_of_noise_and_half_the_square_across():
    position = Gaussian(np.array([0.8, 0.0]), np.diag([0.02, 0.05]))
    seen = outlook(PLAIN, np.zeros((1, 2)), position=position)
    assert seen.variance[0] == pytest.approx(0.1**2 + (0.05 / 0.8) ** 2 / 2)
    assert seen.expected[0] == pytest.approx(0.8 + 0.05 / (2 * 0.8))
    assert (seen.along[0], seen.across[0]) == pytest.approx((0.02**0.5, 0.05**0.5))
    assert nearness(seen)[0] == pytest.approx(0.8 / 0.05**0.5)
    assert_allclose(gains(seen)[0], [seen.variance[0] ** -0.5, 0.0])


def test_a_known_place_is_an_ordinary_range():
    rng = np.random.default_rng(0)
    sensors, p = rng.uniform(0, 5, (6, 2)), np.array([1.0, 7.0])
    models = columns([RangeModel(scale=0.01 * k, sigma_m=0.1 + 0.01 * k) for k in range(6)])
    seen = outlook(models, sensors, position=Gaussian(p, np.zeros((2, 2))))
    assert_allclose(seen.slope, jacobian(models, sensors, positions=p))
    assert_allclose(seen.variance, models.sigma_m**2)


def test_leading_axes_belong_to_runs():
    rng = np.random.default_rng(0)
    sensors = rng.uniform(0, 5, (4, 6, 2))
    means = rng.uniform(0, 5, (3, 4, 2))
    P = np.broadcast_to(np.diag([0.1, 0.2]), (3, 4, 2, 2))
    whole = outlook(PLAIN, sensors, position=Gaussian(means, P))
    one = outlook(PLAIN, sensors[2], position=Gaussian(means[1, 2], P[1, 2]))
    for part, of in zip(whole, one, strict=True):
        assert_allclose(part[1, 2], of)


def test_a_target_at_the_sensor_has_no_direction_and_stays_finite():
    seen = outlook(PLAIN, np.ones((1, 2)), position=Gaussian(np.ones(2), 0.01 * np.eye(2)))
    assert all(np.isfinite(part).all() for part in seen)
    assert_allclose(seen.slope, 0.0)
    assert_allclose(gains(seen), 0.0)


def test_the_place_of_a_state_is_its_beginning():
    state = Gaussian(np.arange(4.0), np.arange(16.0).reshape(4, 4))
    mean, covariance = standing(state, 2)
    assert_allclose(mean, [0.0, 1.0])
    assert_allclose(covariance, [[0.0, 1.0], [4.0, 5.0]])


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="expected"):
        outlook(PLAIN, np.ones((3, 3)), position=Gaussian(np.ones(2), np.eye(2)))
