"""Angular rates: the bearing's own change, its slope, noise, and draws that have them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import angular_rate, bearing
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel

MIXED = (
    AngularRateModel(sigma_rad_s=0.02),
    AngularRateModel(sigma_rad_s=0.05),
    AngularRateModel(sigma_rad_s=0.1, max_range_m=4.0),
)
SENSORS = np.array([[0.0, 0.0, 1.0], [4.0, 1.0, 2.0], [-1.0, 5.0, 0.0]])


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_a_rate_is_how_fast_the_bearing_turns(seed, d):
    rng = np.random.default_rng(seed)
    sensors, p, v = rng.uniform(-5, 5, (3, d)), rng.uniform(-5, 5, d), rng.normal(size=d)
    near = np.linalg.norm((p - sensors)[:, :2], axis=1).min()
    h = 1e-4 * near

    def seen(t):
        return bearing.expected(BearingModel(), sensors, positions=p + t * v)

    turned = bearing.residual(seen(h), seen(-h)) / (2 * h)
    found = angular_rate.expected(
        angular_rate.columns(MIXED), sensors, states=np.concatenate([p, v])
    )
    np.testing.assert_allclose(found, turned, atol=1e-6 * np.linalg.norm(v) ** 3 / near)


def test_a_target_that_circles_the_sensor_turns_at_its_speed_over_the_radius():
    states = np.array([[3.0, 0.0, 0.0, 1.5], [0.0, 3.0, 1.5, 0.0], [3.0, 0.0, 1.5, 0.0]])
    found = angular_rate.expected(AngularRateModel(), np.zeros((1, 2)), states=states)
    np.testing.assert_allclose(found[:, 0], [0.5, -0.5, 0.0], atol=1e-15)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_jacobian_is_the_slope_of_the_expected_rate_in_place_and_velocity(seed, d):
    rng = np.random.default_rng(seed)
    sensors, state = rng.uniform(-5, 5, (3, d)), rng.uniform(-5, 5, 2 * d)
    near = np.linalg.norm((state[:d] - sensors)[:, :2], axis=1).min()
    h = 1e-4 * min(near, 1.0)
    models = angular_rate.columns(MIXED)

    def mean(at):
        return angular_rate.expected(models, sensors, states=at)

    slope = np.stack(
        [(mean(state + h * e) - mean(state - h * e)) / (2 * h) for e in np.eye(2 * d)], axis=-1
    )
    found = angular_rate.jacobian(models, sensors, states=state)
    scale = np.abs(found).max()
    np.testing.assert_allclose(found, slope, atol=1e-6 * scale)
    if d == 3:
        assert (found[:, [2, 5]] == 0.0).all()


def test_at_the_sensor_nothing_turns_and_nothing_is_nan():
    states = np.array([[0.0, 0.0, 1.0, 2.0], [1e-7, 0.0, 1.0, 2.0]])
    sensors = np.array([[0.0, 0.0], [1.0, 0.0]])
    rate = angular_rate.expected(AngularRateModel(), sensors, states=states)
    slope = angular_rate.jacobian(AngularRateModel(), sensors, states=states)
    assert (rate[:, 0] == 0.0).all()
    assert (slope[:, 0] == 0.0).all()
    np.testing.assert_allclose(rate[:, 1], -2.0, rtol=1e-6)
    np.testing.assert_allclose(slope[0, 1], [2.0 - 4.0, -1.0, 0.0, -1.0])


@pytest.mark.parametrize("models", [MIXED[1], angular_rate.columns(MIXED)])
def test_draws_have_the_mean_and_variance_of_the_model(models):
    path = np.broadcast_to([1.0, 2.0, 0.5, -0.7, 0.4, 0.1], (40_000, 1, 6))
    rng = np.random.default_rng(4)
    z = angular_rate.simulate(models, SENSORS, path=path, rng=rng).value[:, 0]
    error = z - angular_rate.expected(models, SENSORS, states=path[0, 0])
    variance = angular_rate.variance(models, np.ones(3))
    assert (np.abs(error.mean(axis=0)) / np.sqrt(variance / len(z))).max() < 3.5
    np.testing.assert_allclose(error.var(axis=0) / variance, 1.0, atol=4 * math.sqrt(2 / len(z)))


def test_only_targets_within_reach_are_heard_and_height_counts():
    path = np.zeros((3, 6))
    path[:, :3] = [[-1.0, 5.0, 3.9], [-1.0, 5.0, 4.0], [-1.0, 5.0, 4.1]]
    models = angular_rate.columns(MIXED)
    drawn = angular_rate.simulate(models, SENSORS, path=path, rng=np.random.default_rng(8))
    assert drawn.heard[:, 2].tolist() == [True, True, False]
    assert drawn.heard[:, :2].all()


@pytest.mark.parametrize("shapes", [((3, 2), (2,)), ((3,), (4,)), ((3, 4), (8,)), ((3, 2), ())])
def test_shapes_that_do_not_fit_are_refused(shapes):
    sensors, states = (np.zeros(shape) for shape in shapes)
    with pytest.raises(InputError, match="positions and velocities"):
        angular_rate.expected(AngularRateModel(), sensors, states=states)
