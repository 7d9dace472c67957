"""Motion sensors in n dimensions: outputs, angles and their rates, residuals, all slopes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import angular_rate, bearing, motion_rate, motion_vector
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel

SEEDS = st.integers(0, 2**32 - 1)
DIMENSIONS = st.integers(2, 5)
FALLOFF = st.sampled_from([0.5, 1.0, 2.0, 2.5])


def scene(seed, n, sensors=4):
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(-1, 1, (sensors, n)),
        rng.uniform(-1, 1, 2 * n),
        rng.normal(size=(sensors, n)),
    )


def differences(function, state, h=1e-6):
    """Slopes (..., 2 n) of a function by central differences."""
    return np.stack(
        [(function(state + h * e) - function(state - h * e)) / (2 * h) for e in np.eye(state.size)],
        axis=-1,
    )


def near(found, wanted):
    size = max(np.abs(wanted).max(), 1e-9)
    np.testing.assert_allclose(found / size, wanted / size, atol=1e-4)


@given(SEEDS, DIMENSIONS, FALLOFF)
def test_the_output_is_what_projection_leaves_over_the_distance(seed, n, falloff):
    sensors, state, _ = scene(seed, n)
    y = motion_vector.vector_output(motion_vector.sighting(sensors, state), falloff=falloff)
    for sensor, output in zip(sensors, y, strict=True):
        o, v = state[:n] - sensor, state[n:]
        r = np.linalg.norm(o)
        projector = np.eye(n) - np.outer(o, o) / r**2
        np.testing.assert_allclose(output, projector @ v / r**falloff, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("n", [2, 3])
def test_in_plane_and_space_it_agrees_with_the_models_of_sensors(n):
    sensors, state, _ = scene(7, n)
    seen = motion_vector.sighting(sensors, state)
    size = motion_rate.strength(MotionRateModel(falloff=2.0), sensors, states=state)
    np.testing.assert_allclose(motion_vector.scalar_output(seen, falloff=2.0), size, rtol=1e-12)
    rate = angular_rate.expected(AngularRateModel(), sensors, states=state)
    np.testing.assert_allclose(motion_vector.angular_rates(seen)[:, 0], rate, rtol=1e-12)
    angle = bearing.expected(BearingModel(), sensors, positions=state[:n])
    np.testing.assert_allclose(motion_vector.polar_angles(seen.offsets)[:, 0], angle, rtol=1e-12)


@given(SEEDS, DIMENSIONS)
def test_polar_angles_are_those_of_the_papers_coordinates(seed, n):
    rng = np.random.default_rng(seed)
    a = rng.uniform(-math.pi / 2, math.pi / 2, n - 1)
    a[0] = rng.uniform(-math.pi, math.pi)
    x = np.empty(n)  # Cheng (25)
    for k in range(n):
        x[k] = 2.0 * (math.sin(a[k - 1]) if k else 1.0) * np.prod(np.cos(a[k:]))
    np.testing.assert_allclose(motion_vector.polar_angles(x), a, atol=1e-9)


@given(SEEDS, DIMENSIONS)
def test_angular_rates_are_how_fast_the_angles_turn_of_sensors_that_move_too(seed, n):
    sensors, state, drift = scene(seed, n)
    h = 1e-6

    def angles(t):
        return motion_vector.polar_angles(state[:n] + t * state[n:] - sensors - t * drift)

    turned = (angles(h) - angles(-h) + math.pi) % (2 * math.pi) - math.pi
    seen = motion_vector.sighting(sensors, state, velocities=drift)
    near(motion_vector.angular_rates(seen), turned / (2 * h))


@given(SEEDS, DIMENSIONS)
def test_rows_of_the_observer_hold_for_the_true_velocity_and_give_it_back(seed, n):
    sensors, state, drift = scene(seed, n)
    seen = motion_vector.sighting(sensors, state, velocities=drift)
    rates = motion_vector.angular_rates(seen)
    rows = motion_vector.rate_rows(sensors, state[:n], rates, drift)
    np.testing.assert_allclose(rows.E @ state[n:], rows.B, atol=1e-9)
    E, B = rows.E.reshape(-1, n), rows.B.ravel()
    v = np.linalg.lstsq(E, B, rcond=None)[0]
    np.testing.assert_allclose(v, state[n:], atol=1e-5)


@given(SEEDS, DIMENSIONS, FALLOFF)
def test_the_residual_is_zero_for_true_readings_and_its_slopes_are_slopes(seed, n, falloff):
    sensors, state, drift = scene(seed, n)
    seen = motion_vector.sighting(sensors, state, velocities=drift)
    b = motion_vector.scalar_output(seen, falloff=falloff)
    exact = motion_vector.scalar_residual(seen, b, falloff=falloff)
    np.testing.assert_allclose(exact.value, 0.0, atol=1e-12)

    def residual(x):
        there = motion_vector.sighting(sensors, x, velocities=drift)
        return motion_vector.scalar_residual(there, 0.7 * b, falloff=falloff)

    at = residual(state)
    slope = differences(lambda x: residual(x).value, state)
    near(np.concatenate([at.place, at.velocity], axis=-1), slope)


@pytest.mark.parametrize("kind", ["motion", "vector", "angular_rate", "bearing"])
@given(seed=SEEDS, n=DIMENSIONS, falloff=FALLOFF)
def test_slopes_of_outputs_are_slopes(kind, seed, n, falloff):
    sensors, state, drift = scene(seed, n)

    def output(x):
        there = motion_vector.sighting(sensors, x, velocities=drift)
        match kind:
            case "motion":
                return motion_vector.scalar_output(there, falloff=falloff)
            case "vector":
                return motion_vector.vector_output(there, falloff=falloff).ravel()
            case "angular_rate":
                return motion_vector.angular_rates(there).ravel()
            case _:
                # azimuths count whole turns: compare by sine and cosine of the differences
                here = motion_vector.polar_angles(motion_vector.sighting(sensors, state).offsets)
                turned = motion_vector.polar_angles(there.offsets) - here
                return ((turned + math.pi) % (2 * math.pi) - math.pi).ravel()

    seen = motion_vector.sighting(sensors, state, velocities=drift)
    found = motion_vector.output_slope(seen, kind, falloff=falloff)
    near(np.concatenate(found, axis=-1), differences(output, state))


def test_at_a_sensor_and_at_rest_there_is_nothing_and_no_nan():
    sensors = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    for state in (np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0]), np.array([0.5, 0.5, 0.5, 0, 0, 0.0])):
        seen = motion_vector.sighting(sensors, state)
        for kind in ("motion", "vector", "angular_rate", "bearing"):
            for slope in motion_vector.output_slope(seen, kind, falloff=2.0):
                assert np.isfinite(slope).all()
        assert motion_vector.scalar_output(seen)[0] == 0.0
    F = motion_vector.scalar_residual(seen, np.array([0.2, 0.3]))
    assert (F.velocity == 0.0).all()  # the trap: whatever was read
    assert (F.place != 0.0).any()


@pytest.mark.parametrize(
    ("sensors", "state", "message"),
    [
        (np.zeros((3, 1)), np.zeros(2), "n >= 2"),
        (np.zeros((3, 2)), np.zeros(3), "n >= 2"),
        (np.zeros(2), np.zeros(4), "n >= 2"),
        (np.full((3, 2), math.nan), np.zeros(4), "finite"),
    ],
)
def test_shapes_and_numbers_that_do_not_fit_are_refused(sensors, state, message):
    with pytest.raises(InputError, match=message):
        motion_vector.sighting(sensors, state)


def test_unknown_kinds_are_refused():
    seen = motion_vector.sighting(np.zeros((1, 2)), np.ones(4))
    with pytest.raises(InputError, match="found readings of kind 'range'"):
        motion_vector.output_slope(seen, "range")
