"""Signal strength: the law of distance, slopes, moments of the draws, limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import signal
from trackfield.sensing.signal import SignalModel

OH = SignalModel(amplitude=195.0, sigma_gain=0.0)
ROUGH = SignalModel(
    amplitude=50.0, falloff=0.7, exponent=2.6, sigma=0.5, sigma_gain=0.1, placement_sigma_m=0.05
)
seeds = st.integers(0, 2**32 - 1)


def scene(seed, *, n=6, k=3):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 6, (n, 2)), rng.uniform(0, 6, (k, 2)), rng.uniform(0.5, 2.0, k)


def alone(model, sensor, target, factor):
    """Oh (1) for one sensor and one target, as printed."""
    r = math.hypot(*(sensor - target))
    return (
        factor * model.amplitude / (1 + model.falloff * r**model.exponent)
        if r <= model.max_range_m
        else 0.0
    )


@given(seeds, st.sampled_from(["sum", "max"]))
def test_several_targets_add_up_or_the_strongest_hides_the_others(seed, combination):
    sensors, targets, factors = scene(seed)
    model = replace(ROUGH, combination=combination, max_range_m=4.0)
    join = sum if combination == "sum" else max
    each = [
        join(alone(model, s, t, f) for t, f in zip(targets, factors, strict=True)) for s in sensors
    ]
    found = signal.expected(model, sensors, targets=targets, factors=factors)
    np.testing.assert_allclose(found, each, rtol=1e-12)


@given(seeds, st.sampled_from(["sum", "max"]))
def test_the_jacobian_is_the_slope_of_the_expected_reading(seed, combination):
    sensors, targets, factors = scene(seed)
    model = replace(ROUGH, combination=combination, max_range_m=math.inf)
    J = signal.jacobian(model, sensors, targets=targets, factors=factors)
    h = 1e-6
    for k in range(3):
        for axis in range(2):
            step = np.zeros((3, 2))
            step[k, axis] = h
            up, down = (
                signal.expected(model, sensors, targets=targets + sign * step, factors=factors)
                for sign in (1, -1)
            )
            np.testing.assert_allclose(J[:, k, axis], (up - down) / (2 * h), atol=2e-4)


def test_leading_axes_are_scenes_of_their_own():
    sensors, targets, factors = scene(1)
    many = np.stack([targets, targets[::-1] + 1.0])[:, None]
    weights = np.stack([factors, factors[::-1]])[:, None]
    for quantity in (signal.expected, signal.jacobian, signal.variance):
        together = quantity(ROUGH, sensors, targets=many, factors=weights)
        for i in range(2):
            single = quantity(ROUGH, sensors, targets=many[i, 0], factors=weights[i, 0])
            np.testing.assert_array_equal(together[i, 0], single)


def test_columns_say_for_each_sensor_what_its_model_says():
    sensors, targets, factors = scene(2, n=2)
    models = [ROUGH, replace(ROUGH, amplitude=80.0, exponent=1.5, sigma_gain=0.2, sigma=2.0)]
    table = signal.columns(models)
    for quantity in (signal.expected, signal.jacobian, signal.variance):
        together = quantity(table, sensors, targets=targets, factors=factors)
        for i, model in enumerate(models):
            one = quantity(model, sensors[i : i + 1], targets=targets, factors=factors)
            np.testing.assert_allclose(together[i], one[0], rtol=1e-14)


def test_sensors_of_one_field_agree_in_what_belongs_to_the_field():
    with pytest.raises(InputError, match="combination"):
        signal.columns([OH, replace(OH, combination="max")])


def test_a_target_at_nan_is_not_there():
    sensors, targets, _ = scene(3)
    gone = targets.copy()
    gone[1] = math.nan
    with_two = signal.expected(ROUGH, sensors, targets=targets[[0, 2]])
    np.testing.assert_allclose(signal.expected(ROUGH, sensors, targets=gone), with_two)
    assert not signal.expected(ROUGH, sensors, targets=np.full((1, 2), math.nan)).any()
    for combination in ("sum", "max"):
        model = replace(ROUGH, combination=combination)
        assert not signal.expected(model, sensors, targets=np.empty((0, 2))).any()
        v = signal.variance(model, sensors, targets=np.empty((0, 2)))
        np.testing.assert_allclose(v, np.full(6, 0.25))


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="expected"):
        signal.expected(OH, np.zeros((4, 3)), targets=np.zeros((1, 2)))
    with pytest.raises(InputError, match="expected"):
        signal.expected(OH, np.zeros((4, 2)), targets=np.zeros(2))


def test_the_sensor_hears_its_amplitude_at_its_place_and_nothing_beyond_its_range():
    sensors = np.array([[0.0, 0.0], [8.0, 0.0], [8.001, 0.0]])
    z = signal.expected(OH, sensors, targets=np.zeros((1, 2)))
    np.testing.assert_allclose(z, [195.0, 3.0, 0.0])
    J = signal.jacobian(OH, sensors, targets=np.zeros((1, 2)))
    np.testing.assert_array_equal(J[[0, 2]], 0.0)


@pytest.mark.parametrize("combination", ["sum", "max"])
def test_draws_have_the_mean_and_the_variance_of_the_model(combination):
    sensors = np.array([[0.0, 0.0], [3.0, 0.5], [1.0, 3.0], [5.0, 5.0]])
    targets = np.array([[1.5, 1.0], [4.0, 2.0]])
    model = replace(ROUGH, combination=combination, placement_sigma_m=0.02)
    rng = np.random.default_rng(4)
    z = np.array([signal.simulate(model, sensors, targets=targets, rng=rng) for _ in range(8000)])
    v = signal.variance(model, sensors, targets=targets)
    mean = signal.expected(model, sensors, targets=targets)
    np.testing.assert_allclose(z.mean(0), mean, atol=5 * np.sqrt(v.max() / 8000))
    np.testing.assert_allclose(z.var(0), v, rtol=0.08)


def test_a_misplaced_sensor_may_stand_beyond_its_range():
    """The variance about the step is the second moment that draws show."""
    model = replace(OH, placement_sigma_m=0.1, sigma=0.5)
    sensors, targets = np.array([[7.95, 0.0], [8.05, 0.0]]), np.zeros((1, 2))
    rng = np.random.default_rng(5)
    z = np.array([signal.simulate(model, sensors, targets=targets, rng=rng) for _ in range(8000)])
    moment = ((z - signal.expected(model, sensors, targets=targets)) ** 2).mean(0)
    v = signal.variance(model, sensors, targets=targets)
    np.testing.assert_allclose(moment, v, rtol=0.08)
    assert (v > 2 * model.sigma**2).all()


def test_sensors_keep_their_errors_and_saturate():
    sensors, targets, _ = scene(6)
    model = replace(ROUGH, sigma=1e-9, saturation=20.0)
    errors = signal.draw_errors(model, sensors, rng=np.random.default_rng(7))
    path = np.broadcast_to(targets, (5, 3, 2))
    z = signal.simulate(model, sensors, targets=path, rng=np.random.default_rng(8), errors=errors)
    np.testing.assert_allclose(z, np.broadcast_to(z[0], z.shape), atol=1e-6)
    true = (1 + errors.gain) * signal.expected(model, sensors + errors.place, targets=targets)
    np.testing.assert_allclose(z[0], np.minimum(true, 20.0), atol=1e-6)
    assert z.max() <= 20.0


def test_a_seed_repeats_a_draw():
    sensors, targets, _ = scene(9)
    one, two = (
        signal.simulate(ROUGH, sensors, targets=targets, rng=np.random.default_rng(10))
        for _ in range(2)
    )
    np.testing.assert_array_equal(one, two)
