"""Steering in least time: Oh's closed forms against integration, linear programs and grids."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from trackfield.errors import InputError
from trackfield.pursuit.robust import Doubt, robust_thrust
from trackfield.pursuit.steering import (
    held_thrust,
    thrust,
    time_to_capture,
    time_to_rest,
    trajectory,
)

STEP = 0.5
OFFSETS = st.floats(-30.0, 30.0)
SPEEDS = st.floats(-6.0, 6.0)
LIMITS = st.floats(0.2, 4.0)


@given(OFFSETS, SPEEDS, LIMITS)
def test_the_way_of_least_time_ends_at_rest_and_follows_the_thrust(x, v, limit):
    total = float(time_to_rest(x, v, limit_m_s2=limit))
    times = np.linspace(0.0, total, 4001)
    way = trajectory(x, v, limit_m_s2=limit, after_s=times)
    np.testing.assert_allclose(way[0], [x, v], atol=1e-9)
    np.testing.assert_allclose(way[-1], [0.0, 0.0], atol=1e-6 * (1.0 + abs(x) + abs(v)))
    dt = total / 4000
    moved = np.cumsum(0.5 * (way[1:, 1] + way[:-1, 1])) * dt  # its velocity is its slope
    np.testing.assert_allclose(way[1:, 0] - x, moved, atol=1e-3 * (1.0 + abs(x) + v**2))
    speeding = np.abs(np.diff(way[:, 1])) / max(dt, 1e-12)
    assert speeding.max(initial=0.0) <= limit * (1.0 + 1e-6) + 1e-9


@given(OFFSETS, SPEEDS, LIMITS)
def test_no_other_thrust_for_a_moment_makes_it_sooner(x, v, limit):
    """Bellman: T falls by the time that passes with the right thrust, and by less with others."""
    dt, total = 1e-4, float(time_to_rest(x, v, limit_m_s2=limit))
    best = float(thrust(x, v, limit_m_s2=limit))
    for u in (best, -best, 0.0, 0.3 * best):
        after = time_to_rest(x + dt * v + 0.5 * dt**2 * u, v + dt * u, limit_m_s2=limit)
        assert total - float(after) <= dt + 1e-7


def test_on_the_switching_curve_it_brakes_and_at_rest_it_does_nothing():
    assert thrust(-2.0, 2.0, limit_m_s2=1.0) == -1.0
    assert thrust(0.5, -1.0, limit_m_s2=1.0) == 1.0
    assert thrust(0.0, 0.0, limit_m_s2=1.0) == 0.0
    assert held_thrust(0.0, 0.0, limit_m_s2=1.0, step_s=STEP).steps == 0.0
    assert trajectory(0.0, 0.0, limit_m_s2=1.0, after_s=np.ones(1)).tolist() == [[0.0, 0.0]]


def test_capture_waits_for_the_slowest_axis():
    times = time_to_rest([3.0, -1.0], [0.0, 2.0], limit_m_s2=1.0)
    assert time_to_capture([3.0, -1.0], [0.0, 2.0], limit_m_s2=1.0) == times.max()


def least_steps(x: float, v: float, limit: float) -> int:
    """Least number of steps to rest, by linear programs."""
    for n in range(1, 200):
        left = n - np.arange(n) - 0.5
        table = np.array([np.full(n, STEP), STEP**2 * left])
        right = [-v, -x - n * STEP * v]
        if linprog(np.zeros(n), A_eq=table, b_eq=right, bounds=(-limit, limit)).status == 0:
            return n
    raise AssertionError


@pytest.mark.parametrize(
    ("x", "v"), [(3.0, 0.0), (-0.2, 0.1), (5.0, -4.0), (0.0, 0.7), (-7.3, -1.9), (1.0, -1.2)]
)
def test_held_thrust_takes_as_few_steps_as_a_linear_program(x, v):
    assert held_thrust(x, v, limit_m_s2=1.0, step_s=STEP).steps == least_steps(x, v, 1.0)


def test_held_thrust_ends_at_rest_when_it_says_without_chattering():
    rng = np.random.default_rng(3)
    x, v = rng.normal(0.0, 5.0, 500), rng.normal(0.0, 3.0, 500)
    limit = rng.uniform(0.3, 3.0, 500)
    told = held_thrust(x, v, limit_m_s2=limit, step_s=STEP).steps
    for done in range(int(told.max())):
        held = held_thrust(x, v, limit_m_s2=limit, step_s=STEP)
        moving = told > done
        u = np.where(moving, held.thrust_m_s2, 0.0)
        assert (np.abs(u) <= limit * (1.0 + 1e-12)).all()
        assert (held.steps[moving] == told[moving] - done).all()
        x, v = x + STEP * v + 0.5 * STEP**2 * u, v + STEP * u
    assert told.max() > 30
    assert np.abs([x, v]).max() < 1e-5


def test_robust_thrust_has_the_least_worst_time_of_a_fine_grid():
    rng = np.random.default_rng(5)
    grid = np.linspace(-1.2, 1.2, 4001)
    for _ in range(40):
        x, v = rng.normal(0.0, 3.0), rng.normal(0.0, 2.0)
        dx, dv, du = rng.uniform(0.0, 0.5, 3)
        found = robust_thrust(x, v, limit_m_s2=1.2, doubt=Doubt(dx, dv, du), step_s=STEP)
        wide, fast = dx + STEP * dv + 0.5 * STEP**2 * du, dv + STEP * du
        place, speed = x + STEP * v + 0.5 * STEP**2 * grid, v + STEP * grid
        corners = [
            time_to_rest(place + a * wide, speed + b * fast, limit_m_s2=1.2)
            for a in (-1.0, 0.0, 1.0)
            for b in (-1.0, 0.0, 1.0)
        ]
        best = np.max(corners, axis=0).min()  # all corners of the box, and points inside
        two = np.maximum(corners[0], corners[-1]).min()
        assert found.worst_s == pytest.approx(two, abs=2e-3)
        assert found.worst_s <= best + 1e-9


def test_without_doubt_robust_thrust_takes_least_time():
    found = robust_thrust(6.0, 1.0, limit_m_s2=1.0, doubt=Doubt(0.0, 0.0, 0.0), step_s=STEP)
    assert found.thrust_m_s2 == -1.0
    assert found.worst_s + STEP == pytest.approx(float(time_to_rest(6.0, 1.0, limit_m_s2=1.0)))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: time_to_rest(np.nan, 0.0, limit_m_s2=1.0), "not finite"),
        (lambda: time_to_rest(1.0, 0.0, limit_m_s2=0.0), "found 0, expected a finite thrust"),
        (lambda: held_thrust(1.0, 0.0, limit_m_s2=1.0, step_s=0.0), "step_s: found 0"),
        (
            lambda: robust_thrust(1.0, 0.0, limit_m_s2=1.0, doubt=Doubt(-1.0, 0, 0), step_s=1.0),
            "found one below 0",
        ),
        (
            lambda: robust_thrust(np.inf, 0.0, limit_m_s2=1.0, doubt=Doubt(1, 0, 0), step_s=1.0),
            "not finite",
        ),
        (
            lambda: robust_thrust(1.0, 0.0, limit_m_s2=1.0, doubt=Doubt(1, 0, 0), step_s=-1.0),
            "step_s: found -1",
        ),
    ],
)
def test_bad_input_is_refused(call, said):
    with pytest.raises(InputError, match=said):
        call()
