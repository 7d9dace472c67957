"""Ranges, Wang (2): mean, slope, noise, and draws that have them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import range as ranging
from trackfield.sensing.range import Nlos, RangeModel

MIXED = (
    RangeModel(bias_m=0.3, scale=-0.1, sigma_m=0.05),
    RangeModel(bias_m=-0.2, scale=0.05, sigma_m=0.1, sigma_scale=0.02),
    RangeModel(sigma_m=0.2, correlated_sigma_m=0.3, correlation_length_m=2.0, max_range_m=4.0),
)
SENSORS = np.array([[0.0, 0.0, 1.0], [4.0, 1.0, 2.0], [-1.0, 5.0, 0.0]])


def test_expected_range_and_variance_by_hand_for_each_sensor():
    models = ranging.columns(MIXED)
    r = np.array([2.0, 3.0, 4.0])
    np.testing.assert_allclose(ranging.expected(models, r), [2.1, 2.95, 4.0])
    np.testing.assert_allclose(ranging.variance(models, r), [0.0025, 0.01 + 0.0036, 0.13])
    np.testing.assert_allclose(ranging.corrected(models, ranging.expected(models, r)), r)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_jacobian_is_the_slope_of_the_expected_range(seed, d):
    rng = np.random.default_rng(seed)
    sensors, p = rng.uniform(-5, 5, (3, d)), rng.uniform(-5, 5, d)
    models = ranging.columns(MIXED)
    h = 1e-6

    def mean(position):
        return ranging.expected(models, ranging.distance(sensors, position))

    slope = np.stack([(mean(p + h * e) - mean(p - h * e)) / (2 * h) for e in np.eye(d)], axis=-1)
    found = ranging.jacobian(models, sensors, positions=p)
    near = ranging.distance(sensors, p).min()
    np.testing.assert_allclose(found, slope, atol=1e-8 + 1e-12 / max(near, 1e-6) ** 2)


def test_a_target_at_a_sensor_has_no_direction_and_no_nan():
    r, u = ranging.directions(SENSORS, SENSORS[0])
    assert r[0] == 0.0
    assert (u[0] == 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(u[1:], axis=1), 1.0)


def test_shapes_follow_the_positions():
    positions = np.zeros((5, 4, 3))
    assert ranging.distance(SENSORS, positions).shape == (5, 4, 3)
    models = ranging.columns(MIXED)
    assert ranging.jacobian(models, SENSORS, positions=positions).shape == (5, 4, 3, 3)
    with pytest.raises(InputError, match="same d"):
        ranging.distance(SENSORS, np.zeros(2))


@pytest.mark.parametrize("models", [MIXED[1], ranging.columns(MIXED)])
def test_draws_have_the_mean_and_variance_of_the_model(models):
    path = np.broadcast_to([2.0, 2.0, 0.5], (40_000, 1, 3))
    z = ranging.simulate(models, SENSORS, path=path, rng=np.random.default_rng(4)).value[:, 0]
    r = ranging.distance(SENSORS, path[0, 0])
    variance = ranging.variance(models, r)
    error = (z.mean(axis=0) - ranging.expected(models, r)) / np.sqrt(variance / len(z))
    assert np.abs(error).max() < 3.5
    np.testing.assert_allclose(z.var(axis=0) / variance, 1.0, atol=4 * math.sqrt(2 / len(z)))


def test_correlated_errors_are_alike_over_the_length_at_any_spacing():
    model = RangeModel(correlated_sigma_m=0.4, correlation_length_m=1.5)
    way = np.broadcast_to([0.0, 0.0, 0.2, 1.0, 4.0, 4.5], (50_000, 6))
    rng = np.random.default_rng(5)
    errors = ranging.correlated_errors(model, way, sensors=2, rng=rng)
    expected = 0.16 * np.exp(-np.abs(way[0][:, None] - way[0]) / 1.5)
    for sensor in range(2):
        found = errors[..., sensor].T @ errors[..., sensor] / len(errors)
        np.testing.assert_allclose(found, expected, atol=0.16 * 4 / math.sqrt(len(errors)))
    assert np.abs((errors[..., 0] * errors[..., 1]).mean(axis=0)).max() < 0.16 * 0.02
    np.testing.assert_array_equal(errors[:, 0], errors[:, 1])  # who stands still keeps his error


def test_a_zero_and_an_endless_correlation_length_are_the_two_limits():
    way = np.broadcast_to(np.arange(4.0), (20_000, 4))
    for length, expected in ((0.0, np.eye(4)), (math.inf, np.ones((4, 4)))):
        model = RangeModel(correlated_sigma_m=1.0, correlation_length_m=length)
        rng = np.random.default_rng(6)
        errors = ranging.correlated_errors(model, way, sensors=1, rng=rng)[..., 0]
        np.testing.assert_allclose(np.corrcoef(errors.T), expected, atol=0.03)


def test_simulated_paths_carry_the_correlated_error_over_the_way_travelled():
    model = RangeModel(sigma_m=0.0, correlated_sigma_m=0.2, correlation_length_m=5.0)
    path = np.zeros((20_000, 3, 2))
    path[:, 1, 0], path[:, 2, 0] = 3.0, 0.0  # there and back: a way of 6 m
    sensors = np.array([[0.0, 10.0]])
    z = ranging.simulate(model, sensors, path=path, rng=np.random.default_rng(7)).value
    errors = (z - ranging.distance(sensors, path))[..., 0]
    found = np.mean(errors[:, 0] * errors[:, 2]) / 0.04
    assert found == pytest.approx(math.exp(-6.0 / 5.0), abs=0.03)


def test_only_targets_within_reach_are_heard():
    path = np.array([[-1.0, 5.0, 3.9], [-1.0, 5.0, 4.0], [-1.0, 5.0, 4.1]])
    models = ranging.columns(MIXED)
    drawn = ranging.simulate(models, SENSORS, path=path, rng=np.random.default_rng(8))
    assert drawn.heard[:, 2].tolist() == [True, True, False]
    assert drawn.heard[:, :2].all()
    assert np.isfinite(drawn.value).all()
    assert not drawn.late.any()


def test_blocked_readings_are_late_by_the_exponential():
    model = RangeModel(sigma_m=0.01)
    path = np.broadcast_to([3.0, 0.0, 1.0], (30_000, 3))
    rng = np.random.default_rng(9)
    drawn = ranging.simulate(model, SENSORS[:1], path=path, rng=rng, nlos=Nlos(0.2, 2.0))
    late = drawn.late[:, 0]
    assert late.mean() == pytest.approx(0.2, abs=0.01)
    excess = drawn.value[:, 0] - 3.0
    assert np.abs(excess[~late]).max() < 0.06
    assert excess[late].mean() == pytest.approx(2.0, abs=0.1)
    assert excess[late].std() == pytest.approx(2.0, abs=0.15)


def test_a_reading_is_never_negative_and_a_seed_repeats_it():
    model = RangeModel(sigma_m=1.0)
    path = np.zeros((100, 2)) + 0.1
    sensors = np.zeros((1, 2))
    first, again = (
        ranging.simulate(model, sensors, path=path, rng=np.random.default_rng(10)).value
        for _ in range(2)
    )
    assert first.min() == 0.0
    np.testing.assert_array_equal(first, again)
