"""Paper mode of sizes of motion: square error, gradient steps, Newton, from moment to moment."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_scenes import RECTANGLE
from trackfield.errors import InputError
from trackfield.localization import motion_newton
from trackfield.localization.motion_newton import SizeScan
from trackfield.sensing import motion_vector


def scan_of(sensors, state, falloff=1.0):
    seen = motion_vector.sighting(sensors, state)
    return SizeScan(sensors, motion_vector.scalar_output(seen, falloff=falloff), falloff)


@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.sampled_from([1.0, 2.0]))
def test_square_error_is_the_papers_sum_and_has_its_slope(seed, n, falloff):
    rng = np.random.default_rng(seed)
    sensors, state = rng.uniform(-1, 1, (5, n)), rng.uniform(-1, 1, 2 * n)
    scan = SizeScan(sensors, rng.uniform(0, 1, 5), falloff)
    E = 0.0
    for s, b in zip(sensors, scan.value, strict=True):
        x, y = state[:n] - s, state[n:]
        E += (x @ x * (y @ y) - (x @ y) ** 2 - (x @ x) ** (falloff + 1.0) * b**2) ** 2
    found = motion_newton.square_error(scan, state)
    assert found.value == pytest.approx(E, rel=1e-9)
    h = 1e-6
    slope = [
        (
            motion_newton.square_error(scan, state + h * e).value
            - motion_newton.square_error(scan, state - h * e).value
        )
        / (2 * h)
        for e in np.eye(2 * n)
    ]
    np.testing.assert_allclose(found.slope, slope, atol=1e-5 * np.abs(slope).max() + 1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_newton_comes_back_to_the_truth_from_nearby(seed, n):
    rng = np.random.default_rng(seed)
    sensors = rng.uniform(-1, 1, (4 * n, n))
    state = np.concatenate([rng.uniform(-0.5, 0.5, n), rng.normal(size=n)])
    if np.linalg.norm(state[:n] - sensors, axis=1).min() < 0.1:
        return
    found = motion_newton.newton(scan_of(sensors, state), state * (1.0 + 1e-4 * rng.normal()))
    assert found.converged
    assert found.rank == 2 * n
    np.testing.assert_allclose(found.state, state, atol=1e-6)


def test_the_gradient_goes_down_to_the_truth_slowly():
    state = np.array([0.05, 0.03, 0.12, 0.0])
    scan = scan_of(RECTANGLE, state)
    start = np.array([0.045, 0.028, 0.115, 0.002])
    slow, fast = motion_newton.gradient(scan, start), motion_newton.newton(scan, start)
    first = motion_newton.square_error(scan, start).value
    assert slow.square_error < 1e-3 * first
    assert fast.square_error < 1e-25
    assert slow.iterations > 20 * fast.iterations
    assert np.abs(slow.state - state).max() < np.abs(start - state).max()


def test_zero_velocity_is_a_trap_and_is_told():
    scan = scan_of(RECTANGLE, np.array([0.05, 0.03, 0.12, 0.0]))
    start = np.array([0.1, 0.05, 0.0, 0.0])
    for found in (motion_newton.gradient(scan, start), motion_newton.newton(scan, start)):
        np.testing.assert_array_equal(found.state[2:], 0.0)
        assert found.rank <= 2
        assert found.square_error > 0.0


def test_newton_follows_a_robot_from_moment_to_moment():
    t = np.arange(0.0, 2.0, 0.1)
    states = [np.array([-0.1 + 0.12 * k, 0.03, 0.12, 0.01]) for k in t]
    for k, state in enumerate(states):
        state[1] += 0.01 * t[k]
    values = np.array([scan_of(RECTANGLE, state).value for state in states])
    scan = SizeScan(RECTANGLE, values[0])
    found = motion_newton.follow(scan, values, states[0] * 1.01, step_s=0.1)
    for fix, state in zip(found, states, strict=True):
        np.testing.assert_allclose(fix.state, state, atol=1e-6)


def test_guesses_use_the_second_difference_of_places_as_corrected(monkeypatch):
    t = np.arange(0.0, 0.5, 0.1)
    states = np.column_stack([-0.1 + 0.3 * t**2, 0.03 + 0 * t, 0.6 * t + 0.05, 0 * t + 0.02])
    values = np.array([scan_of(RECTANGLE, state).value for state in states])
    starts, solve = [], motion_newton.newton
    monkeypatch.setattr(
        motion_newton, "newton", lambda scan, start: (starts.append(start), solve(scan, start))[1]
    )
    found = motion_newton.follow(SizeScan(RECTANGLE, values[0]), values, states[0], step_s=0.1)
    r = np.array([fix.state[:2] for fix in found])
    v = np.array([fix.state[2:] for fix in found])
    np.testing.assert_allclose(starts[1], [*(r[0] + 0.1 * v[0]), *v[0]])
    np.testing.assert_allclose(starts[2], [*(r[1] + 0.1 * v[1]), *v[1]])
    np.testing.assert_allclose(
        starts[4], [*(r[3] + 0.1 * v[3]), *(v[3] + (r[3] - 2 * r[2] + r[1]) / 0.1)]
    )


@pytest.mark.parametrize(
    ("value", "start", "message"),
    [
        (np.full(4, -0.1), np.ones(4), "not negative"),
        (np.full(4, math.nan), np.ones(4), "not negative"),
        (np.full(3, 0.1), np.ones(4), r"expected \(4,\)"),
        (np.full(4, 0.1), np.ones(3), r"expected \(4,\)"),
    ],
)
def test_bad_scans_are_refused(value, start, message):
    for search in (motion_newton.newton, motion_newton.gradient):
        with pytest.raises(InputError, match=message):
            search(SizeScan(RECTANGLE, value), start)
