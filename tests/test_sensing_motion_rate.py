"""Motion rates: the size of what moves across, its mean and slope under noise, silence."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from trackfield.errors import InputError
from trackfield.sensing import angular_rate, motion_rate
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.motion_rate import MotionRateModel

MIXED = (
    MotionRateModel(sigma=0.02),
    MotionRateModel(falloff=2.0, sigma=0.05),
    MotionRateModel(falloff=0.5, sigma=0.1, threshold=0.3, max_range_m=4.0),
)
SENSORS = np.array([[0.0, 0.0, 1.0], [4.0, 1.0, 2.0], [-1.0, 5.0, 0.0]])


@given(st.integers(0, 2**32 - 1))
def test_in_the_plane_it_is_the_size_of_the_angular_rate(seed):
    rng = np.random.default_rng(seed)
    sensors, states = rng.uniform(-5, 5, (3, 2)), rng.normal(size=(4, 4))
    found = motion_rate.strength(MotionRateModel(), sensors, states=states)
    rates = angular_rate.expected(AngularRateModel(), sensors, states=states)
    np.testing.assert_allclose(found, np.abs(rates), rtol=1e-9, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_it_is_the_paper_formula_whatever_the_falloff(seed, d):
    rng = np.random.default_rng(seed)
    sensors, p, v = rng.uniform(-5, 5, (3, d)), rng.uniform(-5, 5, d), rng.normal(size=d)
    models = motion_rate.columns(MIXED)
    found = motion_rate.strength(models, sensors, states=np.concatenate([p, v]))
    for sensor, model, value in zip(sensors, MIXED, found, strict=True):
        n = p - sensor
        square = n @ n * (v @ v) - (n @ v) ** 2
        wanted = math.sqrt(square) / np.linalg.norm(n) ** (model.falloff + 1.0)
        assert value == pytest.approx(wanted, rel=1e-7, abs=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3), st.floats(-4, 0))
def test_jacobian_is_the_slope_of_the_expected_reading(seed, d, speed):
    rng = np.random.default_rng(seed)
    state = rng.uniform(-5, 5, 2 * d)
    state[d:] *= 10.0**speed
    sensors = rng.uniform(-5, 5, (3, d))
    models = motion_rate.columns(MIXED)
    near = np.linalg.norm(state[:d] - sensors, axis=1).min()
    step = np.repeat([1e-4 * near, 1e-4 * 10.0**speed * near], d)

    def mean(at):
        return motion_rate.expected(models, sensors, states=at)

    slope = np.stack(
        [
            (mean(state + h * e) - mean(state - h * e)) / (2 * h)
            for h, e in zip(step, np.eye(2 * d), strict=True)
        ],
        axis=-1,
    )
    found = motion_rate.jacobian(models, sensors, states=state)
    np.testing.assert_allclose(found, slope, atol=1e-5 * np.abs(found).max())


@pytest.mark.parametrize("d", [2, 3])
def test_moments_are_those_of_the_folded_normal_and_of_rice(d):
    strengths = np.array([0.0, 0.02, 0.05, 0.1, 0.2, 1.0])
    model = MotionRateModel(sigma=0.05)
    u = strengths / model.sigma
    law = stats.foldnorm(u, scale=0.05) if d == 2 else stats.rice(u, scale=0.05)
    mean = motion_rate.mean(model, strengths, dimensions=d)
    variance = motion_rate.variance(model, strengths, dimensions=d)
    np.testing.assert_allclose(mean, law.mean(), rtol=1e-9)
    np.testing.assert_allclose(variance, law.var(), rtol=1e-7)
    silent = motion_rate.p_silent(
        MotionRateModel(sigma=0.05, threshold=0.08), strengths, dimensions=d
    )
    np.testing.assert_allclose(silent, law.cdf(0.08), rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_far_above_the_noise_it_is_plain_gaussian(d):
    strengths = np.array([10.0, 1e3, 1e8])
    model = MotionRateModel(sigma=0.01)
    np.testing.assert_allclose(
        motion_rate.mean(model, strengths, dimensions=d), strengths, atol=1e-5
    )
    np.testing.assert_allclose(
        motion_rate.variance(model, strengths, dimensions=d), 1e-4, rtol=1e-3
    )


@pytest.mark.parametrize("speed", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("d", [2, 3])
def test_draws_have_the_mean_and_variance_of_the_model(speed, d):
    models = motion_rate.columns(MIXED)
    state = np.array([1.0, 2.0, 0.5, -0.7, 0.4, 0.1]).reshape(2, 3)[:, :d] * [[1.0], [speed]]
    path = np.broadcast_to(state.ravel(), (40_000, 1, 2 * d))
    rng = np.random.default_rng(4)
    drawn = motion_rate.simulate(models, SENSORS[:, :d], path=path, rng=rng)
    z = drawn.value[:, 0]
    error = z - motion_rate.expected(models, SENSORS[:, :d], states=path[0, 0])
    h = motion_rate.strength(models, SENSORS[:, :d], states=path[0, 0])
    variance = motion_rate.variance(models, h, dimensions=d)
    assert (z >= 0.0).all()
    assert (np.abs(error.mean(axis=0)) / np.sqrt(variance / len(z))).max() < 3.5
    np.testing.assert_allclose(error.var(axis=0) / variance, 1.0, atol=4 * math.sqrt(3 / len(z)))
    near = np.linalg.norm(state[0] - SENSORS[2, :d]) <= 4.0
    silent = motion_rate.p_silent(models, h, dimensions=d)
    heard = (1.0 - silent) * [True, True, near]
    np.testing.assert_allclose(drawn.heard[:, 0].mean(axis=0), heard, atol=0.01)


def test_a_target_at_rest_or_on_the_line_of_sight_or_at_the_sensor_says_nothing_of_a_slope():
    sensors = np.array([[0.0, 0.0], [1.0, 0.0]])
    states = np.array(
        [[3.0, 0.0, 0.0, 0.0], [3.0, 0.0, 1.5, 0.0], [0.0, 0.0, 0.0, 1.0], [1e-7, 0.0, 0.0, 1.0]]
    )
    strength = motion_rate.strength(MotionRateModel(), sensors, states=states)
    slope = motion_rate.jacobian(MotionRateModel(), sensors, states=states)
    np.testing.assert_array_equal(strength[:, 0], 0.0)
    np.testing.assert_array_equal(slope[:, 0], 0.0)
    np.testing.assert_allclose(strength[:, 1], [0.0, 0.0, 1.0, 1.0], rtol=1e-6)
    flat = motion_rate.strength(MotionRateModel(falloff=0.0), sensors, states=states)
    np.testing.assert_array_equal(flat[2], [0.0, 1.0])


@pytest.mark.parametrize("shapes", [((3, 2), (2,)), ((3,), (4,)), ((3, 4), (8,)), ((3, 2), ())])
def test_shapes_that_do_not_fit_are_refused(shapes):
    sensors, states = (np.zeros(shape) for shape in shapes)
    with pytest.raises(InputError, match="positions and velocities"):
        motion_rate.expected(MotionRateModel(), sensors, states=states)
