"""Bearings, rates and motion mixed: against the models of the kinds, and slopes by differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from angle_runs import site_of
from trackfield.errors import ConfigurationError, InputError
from trackfield.filtering import angle_readings
from trackfield.filtering.angle_readings import AngleReadings, Says
from trackfield.network.site import Target
from trackfield.sensing import angular_rate, bearing
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel

PLACES = np.array([[0.0, 0.0], [4.0, 1.0], [-2.0, 3.0], [1.0, -2.0], [3.0, 3.0]])
MODELS = (
    BearingModel(bias_rad=0.2),
    AngularRateModel(),
    MotionRateModel(),
    MotionRateModel(falloff=2.5),
    BearingModel(),
)
STATE = np.array([1.3, 0.7, -0.4, 0.9])


def of(models=MODELS, places=PLACES, **target):
    return angle_readings.of_site(site_of(models, places, Target(**target)))


def differences(sensors, state, after=None, step=1e-6):
    moved = state + step * np.vstack([np.eye(state.size), -np.eye(state.size)])
    h = angle_readings.expected(sensors, moved, after_s=after)
    return ((h[: state.size] - h[state.size :]) / (2 * step)).T


def test_readings_are_those_of_the_models_of_each_kind():
    sensors = of()
    h = angle_readings.expected(sensors, STATE)
    for i in (0, 4):
        exact = bearing.expected(MODELS[i], PLACES[i : i + 1], positions=STATE[:2])
        assert h[i] == pytest.approx(exact[0])
    rate = angular_rate.expected(MODELS[1], PLACES[1:2], states=STATE)
    assert h[1] == pytest.approx(rate[0])
    for i, falloff in ((2, 1.0), (3, 2.5)):  # the golden scalar, in other words: |v x r| / r^(p+1)
        x, y, vx, vy = STATE - np.concatenate([PLACES[i], [0, 0]])
        exact = abs(x * vy - y * vx) / np.hypot(x, y) ** (falloff + 1.0)
        assert h[i] == pytest.approx(exact)


@given(seed=st.integers(0, 2**32 - 1), space=st.booleans())
def test_slopes_are_those_of_differences(seed, space):
    rng = np.random.default_rng(seed)
    d = 3 if space else 2
    sensors = of(dimensions=d, places=rng.uniform(-5, 5, (5, 3)), height_m=None if space else 1.0)
    sensors = sensors._replace(velocity=rng.normal(size=(5, 3)))
    state = np.concatenate([rng.uniform(10, 15, d), rng.normal(size=d)])
    after = rng.uniform(-0.5, 0.5, 5)
    for told in (None, after):
        slope = angle_readings.slopes(sensors, state, after_s=told)
        numeric = differences(sensors, state, after=told)
        np.testing.assert_allclose(slope, numeric, atol=2e-4 * (1 + abs(slope).max()))


@given(seed=st.integers(0, 2**32 - 1))
def test_many_states_are_one_by_one(seed):
    rng = np.random.default_rng(seed)
    sensors, states = of(), rng.normal(size=(2, 3, 4))
    h, H = (f(sensors, states) for f in (angle_readings.expected, angle_readings.slopes))
    for i in np.ndindex(2, 3):
        np.testing.assert_allclose(h[i], angle_readings.expected(sensors, states[i]))
        np.testing.assert_allclose(H[i], angle_readings.slopes(sensors, states[i]))


def test_readings_of_other_times_are_those_of_the_target_gone_straight_on():
    sensors, after = of(), np.array([0.1, -0.2, 0.3, 0.0, -1.0])
    h = angle_readings.expected(sensors, STATE, after_s=after)
    for i, one in enumerate(after):
        then = STATE + np.array([*one * STATE[2:], 0.0, 0.0])
        assert h[i] == pytest.approx(angle_readings.expected(sensors, then)[i])


def test_a_sensor_that_moves_along_with_the_target_sees_nothing_turn():
    sensors = of()
    sensors = sensors._replace(velocity=np.tile([*STATE[2:], 0.0], (5, 1)))
    h = angle_readings.expected(sensors, STATE)
    np.testing.assert_allclose(h[1:4], 0.0, atol=1e-15)


def test_bearings_are_told_by_the_nearest_turn():
    sensors = angle_readings.chosen(of(), [4])
    sees = AngleReadings(sensors, np.array([3.1]))
    west = np.array([0.0, 2.9, 0.0, 0.0])  # a bearing of -3.108
    assert sees.value - sees.predict(west) == pytest.approx([3.1 + 3.1083 - 2 * np.pi], abs=1e-3)


def test_a_target_at_a_sensor_has_no_slope_and_no_rate():
    sensors = angle_readings.chosen(of(), [0, 1, 2])
    sensors = sensors._replace(place=np.zeros((3, 3)))
    at = np.array([0.0, 0.0, 1.0, 1.0])
    h, H = angle_readings.expected(sensors, at), angle_readings.slopes(sensors, at)
    assert (h[1:] == 0.0).all()
    assert np.isfinite(H).all()
    assert (H[:2] == 0.0).all()


def test_heights_matter_to_motion_sensors_where_the_height_of_targets_is_told():
    places = np.column_stack([PLACES, np.full(5, 3.0)])
    told, untold = of(places=places, height_m=1.0), of(places=places)
    np.testing.assert_array_equal(told.place[:, 2], 2.0)
    np.testing.assert_array_equal(untold.place[:, 2], 0.0)
    above, level = (angle_readings.expected(sensors, STATE) for sensors in (told, untold))
    np.testing.assert_allclose(above[[0, 1, 4]], level[[0, 1, 4]])
    assert (above[2:4] != level[2:4]).all()


def test_other_kinds_and_states_are_refused():
    with pytest.raises(ConfigurationError, match="kind 'range'"):
        of(models=(*MODELS[:4], RangeModel()))
    with pytest.raises(InputError, match="expected 4 or 6"):
        angle_readings.expected(of(), np.zeros(5))
    with pytest.raises(InputError, match="2 readings of 5"):
        angle_readings.require_readings(of(), np.zeros(2))
    with pytest.raises(InputError, match="finite"):
        angle_readings.require_readings(of(), np.full(5, np.nan))


def test_the_columns_are_those_of_the_models():
    sensors = of(
        models=(
            BearingModel(0.1, 0.2, 7.0),
            AngularRateModel(0.3, 8.0, 0.4),
            MotionRateModel(2.0, 0.5, 0.6, 9.0),
        ),
        places=PLACES[:3],
    )
    assert sensors.says.tolist() == [Says.BEARING, Says.RATE, Says.MOTION]
    assert sensors.sigma.tolist() == [0.1, 0.3, 0.5]
    assert sensors.bias.tolist() == [0.2, 0.0, 0.0]
    assert sensors.falloff.tolist() == [0.0, 1.0, 2.0]
    assert sensors.threshold.tolist() == [0.0, 0.4, 0.6]
    assert sensors.reach.tolist() == [7.0, 8.0, 9.0]
    own = angle_readings.chosen(sensors, [2, 0], np.array([np.nan, 0.9]))
    assert own.sigma.tolist() == [0.5, 0.9]
