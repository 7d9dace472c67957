"""Bearings: mean, slope, noise, draws that have them, and the seam at half a turn."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import bearing
from trackfield.sensing.bearing import BearingModel

MIXED = (
    BearingModel(sigma_rad=0.02),
    BearingModel(sigma_rad=0.05, bias_rad=0.3),
    BearingModel(sigma_rad=0.1, bias_rad=-0.1, max_range_m=4.0),
)
SENSORS = np.array([[0.0, 0.0, 1.0], [4.0, 1.0, 2.0], [-1.0, 5.0, 0.0]])


def test_expected_bearing_by_hand():
    sensors = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 3.0]])
    models = bearing.columns(MIXED)
    found = bearing.expected(models, sensors, positions=np.array([[0.0, 1.0], [1.0, 2.0]]))
    corner = math.atan2(2.0, 1.0)
    expected = [
        [math.pi / 2, -math.pi + 0.3, -math.pi / 2 - 0.1],
        [corner, math.pi / 2 + 0.3, -math.pi / 4 - 0.1],
    ]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(bearing.variance(models, np.ones((5, 3)))[2], [4e-4, 25e-4, 1e-2])
    assert bearing.variance(MIXED[0], np.ones((5, 3))).shape == (5, 3)


def test_a_bearing_beyond_half_a_turn_comes_back_on_the_other_side():
    model = BearingModel(bias_rad=0.5)
    sensor = np.zeros((1, 2))
    found = bearing.expected(model, sensor, positions=np.array([-1.0, 0.1]))
    assert found == pytest.approx(math.pi - math.atan(0.1) + 0.5 - 2 * math.pi)
    assert bearing.residual(np.array(3.1), np.array(-3.1)) == pytest.approx(6.2 - 2 * math.pi)
    assert bearing.residual(np.array(0.2), np.array(-0.3)) == pytest.approx(0.5)


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_a_residual_is_the_short_way_round(a, b):
    found = float(bearing.residual(np.array(a), np.array(b)))
    assert -math.pi <= found < math.pi + 1e-12
    assert math.cos(found) == pytest.approx(math.cos(a - b), abs=1e-9)
    assert math.sin(found) == pytest.approx(math.sin(a - b), abs=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_jacobian_is_the_slope_of_the_expected_bearing(seed, d):
    rng = np.random.default_rng(seed)
    sensors = rng.uniform(-5, 5, (3, d))
    p = rng.uniform(-5, 5, d)
    near = np.linalg.norm((p - sensors)[:, :2], axis=1).min()
    h = 1e-4 * near
    models = bearing.columns(MIXED)

    def mean(position):
        return bearing.expected(models, sensors, positions=position)

    slope = np.stack(
        [bearing.residual(mean(p + h * e), mean(p - h * e)) / (2 * h) for e in np.eye(d)], axis=-1
    )
    found = bearing.jacobian(models, sensors, positions=p)
    np.testing.assert_allclose(found, slope, atol=1e-7 / near)
    if d == 3:
        assert (found[:, 2] == 0.0).all()


def test_at_the_sensor_there_is_no_slope_and_no_nan():
    model = BearingModel()
    places = SENSORS[0] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1e-7, 0.0, 0.0]])
    found = bearing.jacobian(model, SENSORS, positions=places)
    assert (found[:, 0] == 0.0).all()
    assert (found[:, 1:, :2] != 0.0).any(axis=-1).all()
    assert np.isfinite(bearing.expected(model, SENSORS, positions=places)).all()
    close = bearing.jacobian(model, SENSORS, positions=SENSORS[0] + np.array([2e-6, 0.0, 0.0]))
    np.testing.assert_allclose(close[0], [0.0, 5e5, 0.0])


@pytest.mark.parametrize("models", [MIXED[1], bearing.columns(MIXED)])
def test_draws_have_the_mean_and_variance_of_the_model(models):
    path = np.broadcast_to([-3.0, 0.05, 0.5], (40_000, 1, 3))  # near the seam for the first sensor
    z = bearing.simulate(models, SENSORS, path=path, rng=np.random.default_rng(4)).value[:, 0]
    error = bearing.residual(z, bearing.expected(models, SENSORS, positions=path[0, 0]))
    variance = bearing.variance(models, np.ones(3))
    assert (np.abs(error.mean(axis=0)) / np.sqrt(variance / len(z))).max() < 3.5
    np.testing.assert_allclose(error.var(axis=0) / variance, 1.0, atol=4 * math.sqrt(2 / len(z)))
    assert z.min() >= -math.pi
    assert z.max() < math.pi


def test_only_targets_within_reach_are_heard_and_height_counts():
    path = np.array([[-1.0, 5.0, 3.9], [-1.0, 5.0, 4.0], [-1.0, 5.0, 4.1]])
    drawn = bearing.simulate(
        bearing.columns(MIXED), SENSORS, path=path, rng=np.random.default_rng(8)
    )
    assert drawn.heard[:, 2].tolist() == [True, True, False]
    assert drawn.heard[:, :2].all()


@pytest.mark.parametrize("shapes", [((3, 2), (3,)), ((3,), (3,)), ((3, 4), (4,)), ((3, 2), ())])
def test_shapes_that_do_not_fit_are_refused(shapes):
    sensors, positions = (np.zeros(shape) for shape in shapes)
    with pytest.raises(InputError, match="same d"):
        bearing.expected(BearingModel(), sensors, positions=positions)
