"""Profiles of a pass: the shape, its slopes, its information, and what a path looks like."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import amplitude, profile
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.amplitude_likelihood import misfit
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import Profile

T = np.arange(25.0)
PASS = Profile(1.3, 11.4, 4.2)
seeds = st.integers(0, 2**32 - 1)
exponents = st.floats(0.5, 4.0)
MODELS = [
    AmplitudeModel(1.5, 0.1),
    AmplitudeModel(1.5, 0.1, "rayleigh"),
    AmplitudeModel(1.5, 0.1, saturation=0.9),
    AmplitudeModel(1.5, 0.1, "rayleigh", saturation=0.9),
]


def some(seed, *shape):
    rng = np.random.default_rng(seed)
    return Profile(
        rng.uniform(0.2, 3.0, shape), rng.uniform(0.0, 24.0, shape), rng.uniform(1.0, 9.0, shape)
    )


@given(seeds, exponents)
def test_half_the_amplitude_is_left_a_width_from_the_maximum(seed, exponent):
    at = some(seed)
    t_s = at.t_max_s + np.array([0.0, -at.width_s, at.width_s])
    found = profile.expected(at, t_s, exponent=exponent)
    np.testing.assert_allclose(found, at.a_max * np.array([1.0, 0.5, 0.5]), rtol=1e-12)


@given(seeds, exponents)
def test_a_straight_pass_looks_like_its_profile(seed, exponent):
    rng = np.random.default_rng(seed)
    theta = np.concatenate([rng.uniform(0.5, 3, 1), rng.uniform(-3, 3, 2), rng.normal(0, 0.3, 2)])
    sensors = rng.uniform(-2, 2, (4, 2))
    seen = predict(theta, sensors, exponent=exponent)
    path = theta[1:3] + T[:, None] * theta[3:]
    model = AmplitudeModel(exponent)
    heard = amplitude.expected(model, sensors, positions=path, power=theta[0])
    np.testing.assert_allclose(profile.expected(seen, T, exponent=exponent), heard.T, rtol=1e-7)


@given(seeds, exponents)
def test_the_gradient_is_the_slope_of_the_shape(seed, exponent):
    at = some(seed).array()
    h = 1e-6

    def shape(numbers):
        return profile.expected(profile.profile_of(numbers), T, exponent=exponent)

    slope = np.stack([(shape(at + h * e) - shape(at - h * e)) / (2 * h) for e in np.eye(3)], -1)
    found = profile.gradient(profile.profile_of(at), T, exponent=exponent)
    np.testing.assert_allclose(found, slope, atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("model", MODELS)
def test_the_information_is_the_covariance_of_the_score(model):
    rng = np.random.default_rng(3)
    mean = profile.expected(PASS, T, exponent=model.exponent)
    values = amplitude.noisy(model, np.broadcast_to(mean, (40_000, 25)), rng=rng)
    slope = misfit(model, values, mean=mean).slope
    score = slope @ profile.gradient(PASS, T, exponent=model.exponent)
    J = profile.information(PASS, T, model)
    whole = np.linalg.cholesky(np.linalg.inv(J))
    np.testing.assert_allclose(whole.T @ np.cov(score.T) @ whole, np.eye(3), atol=0.05)
    assert np.abs(score.mean(axis=0) / score.std(axis=0)).max() < 4 / math.sqrt(len(values))


@pytest.mark.parametrize("model", MODELS)
def test_leading_axes_are_profiles_of_their_own(model):
    many = some(1, 2, 3)
    rng = np.random.default_rng(2)
    values = amplitude.noisy(model, profile.expected(many, T, exponent=1.5), rng=rng)
    J = profile.information(many, T, model)
    cost = profile.negative_log_likelihood(many, T, values, models=model)
    for i, j in np.ndindex(2, 3):
        one = Profile(*(part[i, j] for part in many))
        np.testing.assert_allclose(J[i, j], profile.information(one, T, model), rtol=1e-12)
        alone = profile.negative_log_likelihood(one, T, values[i, j], models=model)
        assert cost[i, j] == pytest.approx(alone, rel=1e-12)


def test_columns_give_each_profile_its_sensors_model():
    models = [replace(MODELS[0], sigma=s, exponent=e) for s, e in ((0.1, 1.0), (0.3, 2.0))]
    both = some(4, 2)
    table = amplitude.columns(models)
    values = np.linspace(0.1, 1.0, 50).reshape(2, 25)
    J = profile.information(both, T, table)
    cost = profile.negative_log_likelihood(both, T, values, models=table)
    for i, model in enumerate(models):
        one = Profile(*(part[i] for part in both))
        np.testing.assert_allclose(J[i], profile.information(one, T, model), rtol=1e-12)
        alone = profile.negative_log_likelihood(one, T, values[i], models=model)
        assert cost[i] == pytest.approx(alone, rel=1e-12)


def test_numbers_and_profiles_go_both_ways():
    at = some(5, 2, 3)
    for part, back in zip(at, profile.profile_of(at.array()), strict=True):
        np.testing.assert_array_equal(part, back)
    assert PASS.array().tolist() == [1.3, 11.4, 4.2]


def test_a_source_at_rest_has_a_flat_profile():
    seen = predict(np.array([4.0, 3.0, 4.0, 0.0, 0.0]), np.zeros((1, 2)))
    np.testing.assert_allclose(profile.expected(seen, T), 2.0 / 5.0)
    assert (profile.gradient(seen, T)[..., 1:] == 0.0).all()
    assert seen.width_s[0] == np.inf


def test_a_sensor_on_the_line_is_passed_closely_and_in_no_time():
    seen = predict(np.array([1.0, -2.0, 0.0, 1.0, 0.0]), np.array([[0.0, 0.0], [1.0, 0.0]]))
    np.testing.assert_allclose(seen.t_max_s, [2.0, 3.0])
    assert np.isfinite(seen.array()).all()
    assert (seen.width_s > 0.0).all()


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="passes"):
        predict(np.zeros(4), np.zeros((3, 2)))
    with pytest.raises(InputError, match="passes"):
        predict(np.zeros(5), np.zeros((3, 3)))
    with pytest.raises(InputError, match="samples"):
        profile.negative_log_likelihood(PASS, T, np.ones(24), models=MODELS[0])
