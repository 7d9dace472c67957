"""Steady states against filters that run long, directions nobody tells of, Lyapunov's terms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from trackfield.errors import InputError
from trackfield.localization.bounds import range_information
from trackfield.motion import ConstantVelocity, RandomWalk, SteppedAcceleration
from trackfield.network.site import Site
from trackfield.raster import Region, cell_centres
from trackfield.scheduling.accuracy import accuracy_map
from trackfield.scheduling.stability import (
    Filtered,
    in_words,
    lyapunov_change,
    lyapunov_test,
    steady_state,
    undetectable,
)
from trackfield.scheduling.steady_error import steady_map, steady_of, steady_rms
from trackfield.sensing.range import RangeModel


def run(model, covariance, steps):
    """Predicted and updated covariance after some steps of a Kalman filter, in Joseph's form."""
    F, Q, H, theta = model
    for _ in range(steps):
        predicted = F @ covariance @ F.T + Q
        K = np.linalg.solve(H @ predicted @ H.T + theta, H @ predicted).T
        keep = np.eye(len(F)) - K @ H
        covariance = keep @ predicted @ keep.T + K @ theta @ K.T
    return predicted, covariance


def positions_seen(motion, dt_s, theta):
    d = len(theta)
    H = np.hstack([np.eye(d), np.zeros((d, len(motion.transition(dt_s)) - d))])
    return Filtered(motion.transition(dt_s), motion.noise(dt_s), H, theta)


def random_noise(rng, d):
    root = rng.normal(size=(d, d)) + 0.5 * np.eye(d)
    return root @ root.T + 0.05 * np.eye(d)


@settings(max_examples=30)
@given(
    seed=st.integers(0, 10_000),
    motion=st.sampled_from(
        [
            SteppedAcceleration((0.3, 0.1)),
            SteppedAcceleration((0.2, 0.2, 0.05)),
            ConstantVelocity(0.2),
            RandomWalk(0.3, 3),
        ]
    ),
    dt_s=st.floats(0.2, 2.0),
)
def test_the_steady_state_is_where_a_filter_ends_whatever_it_believed_at_first(seed, motion, dt_s):
    rng = np.random.default_rng(seed)
    d = {4: 2, 6: 3, 3: 3}[len(motion.transition(1.0))]
    model = positions_seen(motion, dt_s, random_noise(rng, d))
    found = steady_state(model)
    n = len(model.transition)
    for start in (1e-6 * np.eye(n), 1e3 * random_noise(rng, n)):
        predicted, updated = run(model, start, 400)
        np.testing.assert_allclose(found.predicted, predicted, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(found.updated, updated, rtol=1e-6, atol=1e-9)
    assert found.bounded
    assert 0 < found.decay < 1


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), d=st.sampled_from([2, 3]), accel=st.floats(1e-3, 10.0))
def test_the_closed_form_is_the_steady_state_of_the_whole_filter(seed, d, accel):
    theta = random_noise(np.random.default_rng(seed), d)
    model = positions_seen(SteppedAcceleration((accel**2,) * d), 0.7, theta)
    expected = np.sqrt(np.trace(steady_state(model).updated[:d, :d]))
    found = steady_rms(np.linalg.inv(theta), step_s=0.7, accel_sigma_m_s2=accel)
    assert found == pytest.approx(expected, rel=1e-7)


@given(
    step=st.floats(-2, 2), accel=st.floats(-5, 2), sigma=st.floats(-3, 3), ratio=st.floats(-2, 2)
)
def test_steady_states_keep_their_digits_at_any_scale(step, accel, sigma, ratio):
    """From targets that hardly move to ones that leap far beyond what is measured in a step."""
    theta = 10.0 ** (2 * sigma) * np.diag([1.0, 10.0**ratio])
    model = positions_seen(SteppedAcceleration((10.0 ** (2 * accel),) * 2), 10.0**step, theta)
    found = np.sqrt(np.trace(steady_state(model).updated[:2, :2]))
    expected = steady_rms(np.linalg.inv(theta), step_s=10.0**step, accel_sigma_m_s2=10.0**accel)
    assert found == pytest.approx(expected, rel=1e-5)


@given(seed=st.integers(0, 1000))
def test_steady_states_solve_scipy_s_equation(seed):
    rng = np.random.default_rng(seed)
    F, H = rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    model = Filtered(F, random_noise(rng, 4), H, random_noise(rng, 2))
    expected = solve_discrete_are(F.T, H.T, model.process_noise, model.measurement_noise)
    np.testing.assert_allclose(steady_state(model).predicted, expected, rtol=1e-6, atol=1e-8)


def test_a_direction_that_nobody_measures_is_named():
    angle = 0.3
    c = np.array([[np.cos(angle), np.sin(angle), 0.0, 0.0]])
    motion = ConstantVelocity(0.1)
    model = Filtered(motion.transition(0.5), motion.noise(0.5), c, np.array([[0.1]]))
    found = steady_state(model)
    assert not found.bounded
    words = {in_words(direction) for direction in found.free.T}
    assert words == {"- 0.30 x + 0.96 y", "- 0.30 vx + 0.96 vy"}
    # The seen direction settles all the same, and the other one grows without end.
    predicted, updated = run(model, np.eye(4), 500)
    assert (c @ found.updated @ c.T)[0, 0] == pytest.approx((c @ updated @ c.T)[0, 0], rel=1e-6)
    np.testing.assert_allclose(found.updated @ found.free, 0.0, atol=1e-12)
    longer, _ = run(model, np.eye(4), 1000)
    free = found.free[:, :1]
    assert (free.T @ longer @ free)[0, 0] > 4 * (free.T @ predicted @ free)[0, 0]


def test_a_velocity_alone_leaves_the_place_free():
    motion = ConstantVelocity(0.1)
    H = np.hstack([np.zeros((2, 2)), np.eye(2)])
    free = undetectable(Filtered(motion.transition(0.1), motion.noise(0.1), H, np.eye(2)))
    np.testing.assert_allclose(np.abs(free[2:]), 0.0, atol=1e-12)
    assert free.shape == (4, 2)


def test_what_dies_out_by_itself_needs_no_sensor():
    model = Filtered(np.diag([0.5, 1.0]), np.eye(2), np.array([[0.0, 1.0]]), np.eye(1))
    found = steady_state(model)
    assert found.bounded
    golden = (1 + np.sqrt(5)) / 2
    np.testing.assert_allclose(found.predicted, np.diag([4 / 3, golden]), atol=1e-9)
    assert found.decay == pytest.approx(0.5)


def test_without_sensors_all_is_free():
    motion = ConstantVelocity(0.1)
    none = Filtered(motion.transition(1.0), motion.noise(1.0), np.zeros((0, 4)), np.zeros((0, 0)))
    assert steady_state(none).free.shape == (4, 4)


@pytest.mark.parametrize(
    "noise",
    [np.zeros((4, 4)), np.diag([0.0, 0.0, 0.01, 0.0]), np.diag([0.0, 0.0, 0.02, 0.0])],
)
def test_what_no_noise_drives_is_known_ever_better(noise):
    """The Riccati equation has no stabilising solution there; its limit is found all the same."""
    F = ConstantVelocity(0.0).transition(0.5)
    model = Filtered(F, noise, np.hstack([np.eye(2), np.zeros((2, 2))]), np.diag([0.2, 0.4]))
    found = steady_state(model)
    predicted, _ = run(model, np.eye(4), 8_000)
    np.testing.assert_allclose(found.predicted, predicted, atol=5e-4)
    np.testing.assert_allclose(found.predicted[1::2], 0.0, atol=1e-12)
    assert found.bounded


def test_a_growing_state_that_no_noise_drives_has_a_floor():
    model = Filtered(np.array([[1.2]]), np.zeros((1, 1)), np.eye(1), np.eye(1))
    found = steady_state(model)
    predicted, updated = run(model, np.eye(1), 400)
    assert found.predicted == pytest.approx(predicted)
    assert found.updated == pytest.approx(updated)


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), linear=st.booleans())
def test_the_terms_add_up_to_the_change_of_v(seed, linear):
    """One step of a filter whose target and readings have no noise, error by error."""
    rng = np.random.default_rng(seed)
    model = positions_seen(SteppedAcceleration((0.3, 0.1)), 0.6, random_noise(rng, 2))
    F, Q, H, theta = model
    P = random_noise(rng, 4)
    a = np.ones(4) if linear else rng.uniform(0.5, 1.5, 4)
    errors = rng.normal(size=(5, 4))
    predicted = F @ P @ F.T + Q
    K = predicted @ H.T @ np.linalg.inv(H @ predicted @ H.T + theta)
    after = (np.eye(4) - K @ H) @ predicted
    moved = a * (errors @ F.T)
    left = moved - moved @ (K @ H).T
    v_before = np.einsum("ki,ij,kj->k", errors, np.linalg.inv(P), errors)
    v_after = np.einsum("ki,ij,kj->k", left, np.linalg.inv(after), left)
    change = lyapunov_change(model, P, errors, nonlinearity=None if linear else a)
    np.testing.assert_allclose(sum(change), v_after - v_before, rtol=1e-8, atol=1e-9)
    assert (change[1] <= 1e-12).all()
    if linear:
        assert (change[0] <= 1e-9).all()


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), scale=st.floats(0.05, 1.3))
def test_the_first_condition_always_holds_and_the_second_is_sufficient(seed, scale):
    rng = np.random.default_rng(seed)
    model = positions_seen(SteppedAcceleration((0.3, 0.1)), 0.6, random_noise(rng, 2))
    P = random_noise(rng, 4)
    a = scale * rng.uniform(0.5, 1.0, 4)
    test = lyapunov_test(model, P, nonlinearity=a)
    assert test.update <= 1e-9
    assert test.nonlinearity == pytest.approx(a.max() ** 2)
    if test.sufficient:
        assert test.growth <= 1 + 1e-9
    change, _ = lyapunov_change(model, P, rng.normal(size=(200, 4)), nonlinearity=a)
    v = np.einsum("ki,ij,kj->k", e := rng.normal(size=(200, 4)), np.linalg.inv(P), e)
    grown, _ = lyapunov_change(model, P, e, nonlinearity=a)
    assert (grown + v <= test.growth * v * (1 + 1e-9)).all()
    if test.growth <= 1:
        assert (change <= 1e-9).all()


def test_the_second_condition_is_not_necessary():
    """It fails for a linear filter at its steady state, whose errors are bounded."""
    model = positions_seen(SteppedAcceleration((0.04, 0.04)), 0.5, 0.1 * np.eye(2))
    steady = steady_state(model)
    test = lyapunov_test(model, steady.updated)
    assert steady.bounded
    assert not test.sufficient
    assert test.growth == pytest.approx(1.0)


def test_a_map_is_unbounded_where_too_few_directions_are_seen():
    """Two sensors in the west, none in the east; on their line both measure the same direction."""
    sensors = np.array([[0.0, 2.0], [4.0, 2.0]])
    model = RangeModel(sigma_m=0.1, max_range_m=3.0)
    region = Region(0, 0, 12, 4)
    centres, shape = cell_centres(region, 0.5)
    information = range_information(sensors, centres, models=model).reshape(*shape, 2, 2)
    raster = steady_map(region, information, step_s=0.5, accel_sigma_m_s2=0.3)
    in_reach = np.linalg.norm(centres[:, None] - sensors, axis=2) <= 3.0
    np.testing.assert_array_equal(np.isfinite(raster.values).ravel(), in_reach.all(axis=1))
    assert not np.isfinite(raster.at(np.array([[10.0, 2.0]])))[0]
    line = range_information(sensors, np.array([[2.0, 2.0]]), models=model)
    assert steady_rms(line, step_s=0.5, accel_sigma_m_s2=0.3)[0] == np.inf
    square = steady_rms(200.0 * np.eye(2), step_s=0.5, accel_sigma_m_s2=0.3)
    assert square < np.sqrt(2 / 200.0)


def test_the_map_of_a_site_is_that_of_its_information():
    rng = np.random.default_rng(1)
    region = Region(0, 0, 12, 8)
    positions = np.column_stack([rng.uniform([0, 0], [12, 8], (12, 2)), np.full(12, np.nan)])
    model = RangeModel(sigma_m=0.1, max_range_m=3.5)
    site = Site("s", tuple(f"s{i}" for i in range(12)), positions, (model,) * 12)
    found = steady_of(accuracy_map(site, region, cell_m=0.5), step_s=0.4, accel_sigma_m_s2=0.5)
    centres, shape = cell_centres(region, 0.5)
    information = range_information(positions[:, :2], centres, models=model)
    expected = steady_map(
        region, information.reshape(*shape, 2, 2), step_s=0.4, accel_sigma_m_s2=0.5
    )
    bounded = np.isfinite(expected.values)
    assert 0.3 < bounded.mean() < 1.0
    np.testing.assert_array_equal(np.isfinite(found.values), bounded)
    np.testing.assert_allclose(found.values[bounded], expected.values[bounded], rtol=1e-6)


@given(factor=st.floats(1.1, 10.0), seed=st.integers(0, 100))
def test_more_information_more_often_and_calmer_targets_help(factor, seed):
    information = random_noise(np.random.default_rng(seed), 2)
    usual = steady_rms(information, step_s=0.5, accel_sigma_m_s2=0.3)
    assert steady_rms(factor * information, step_s=0.5, accel_sigma_m_s2=0.3) < usual
    assert steady_rms(information, step_s=0.5 / factor, accel_sigma_m_s2=0.3) < usual
    assert steady_rms(information, step_s=0.5, accel_sigma_m_s2=0.3 / factor) < usual


def test_words_of_other_states():
    assert in_words(np.array([0.0, -1.0])) == "1.00 x1"
    assert in_words(np.array([0, 0, 0.8, 0, 0, -0.6])) == "0.80 z - 0.60 vz"


GOOD = positions_seen(ConstantVelocity(0.1), 0.5, np.eye(2))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: steady_state(GOOD._replace(measurement=np.eye(2))), "found shapes"),
        (lambda: steady_state(GOOD._replace(process_noise=np.full((4, 4), np.nan))), "no numbers"),
        (lambda: steady_state(GOOD._replace(measurement_noise=np.zeros((2, 2)))), "definite"),
        (lambda: lyapunov_test(GOOD, np.zeros((4, 4))), "singular"),
        (lambda: steady_rms(np.eye(2), step_s=0.0, accel_sigma_m_s2=1.0), "above 0"),
        (lambda: steady_rms(np.eye(2) * np.nan, step_s=1.0, accel_sigma_m_s2=1.0), "no number"),
        (
            lambda: steady_map(Region(0, 0, 1, 1), np.eye(2), step_s=1.0, accel_sigma_m_s2=1.0),
            "rows, columns",
        ),
    ],
)
def test_what_is_no_model_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
