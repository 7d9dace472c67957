"""Closed forms of two and three ranges: each one is the bound of the ranges themselves."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize_scalar

from trackfield.errors import InputError
from trackfield.localization.information import fisher_information, reading_gains
from trackfield.scheduling.uncertainty import (
    best_third,
    half_chord,
    long_diagonal,
    printed_third,
    printed_trace,
    three_sensor_trace,
    three_sensor_trace_3d,
    two_cells,
    two_sensor_covariance,
)
from trackfield.sensing.range import RangeModel

turns = st.floats(-7.0, 7.0)
between = st.floats(0.05, math.pi - 0.05)


def bound(directions, sigma_m=1.0):
    """Inverse of the information of ranges from far sensors that are seen in these directions."""
    sensors = 1e3 * np.asarray(directions)
    gains = reading_gains(RangeModel(sigma_m=sigma_m), sensors, np.zeros(sensors.shape[1]))
    return np.linalg.inv(fisher_information(gains))


def seen(*bearings):
    return np.column_stack([np.cos(bearings), np.sin(bearings)])


@given(turns, between, st.floats(0.01, 10.0))
def test_two_ranges_have_the_bound_of_two_ranges(phi, alpha, sigma_m):
    theta = two_sensor_covariance(phi, alpha, sigma_m=sigma_m)
    expected = bound(seen(phi, phi + alpha), sigma_m)
    np.testing.assert_allclose(theta, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert np.trace(theta) == pytest.approx(2 * sigma_m**2 / math.sin(alpha) ** 2)


def test_as_printed_the_covariance_would_not_turn_with_the_sensors():
    """(3.8) holds with the axis along the first sensor only in trace, not in its entries."""
    alpha = 1.1
    turned = two_sensor_covariance(np.array([0.0, 0.7]), alpha)
    assert turned.shape == (2, 2, 2)
    printed = np.array([[1.0, math.cos(alpha)], [math.cos(alpha), 1.0]]) / math.sin(alpha) ** 2
    assert not np.allclose(turned[0], printed)
    for theta in turned:
        np.testing.assert_allclose(np.linalg.eigvalsh(theta), np.linalg.eigvalsh(printed))
    assert not np.allclose(turned[0], turned[1])


@given(between, turns)
def test_three_ranges_have_the_trace_of_three_ranges(alpha, beta):
    expected = np.trace(bound(seen(0.0, alpha, beta)))
    assert three_sensor_trace(alpha, beta) == pytest.approx(expected, rel=1e-8)
    assert three_sensor_trace(alpha, beta) < 2.0 / math.sin(alpha) ** 2 * (1 + 1e-9)
    assert printed_trace(alpha, beta) >= 2.0 / math.sin(alpha) ** 2  # a third would never help


@given(between)
def test_the_best_third_is_what_a_search_finds_and_the_printed_one_the_worst(alpha):
    grid = np.linspace(0.0, math.pi, 721)
    for rule, sign in ((best_third, 1.0), (printed_third, -1.0)):
        start = grid[np.argmin(sign * three_sensor_trace(alpha, grid))]
        found = minimize_scalar(
            lambda b, sign=sign: sign * three_sensor_trace(alpha, b),
            bounds=(start - 0.01, start + 0.01),
            method="bounded",
        )
        told = rule(alpha)
        assert told.trace == pytest.approx(sign * found.fun, rel=1e-7)
        assert three_sensor_trace(alpha, told.beta) == pytest.approx(float(told.trace))


def test_at_thirty_degrees_the_printed_choice_costs_five_times_the_best():
    alpha = math.radians(30.0)
    assert best_third(alpha).trace == pytest.approx(1.417, abs=1e-3)
    assert math.degrees(best_third(alpha).beta) == pytest.approx(105.0)
    assert printed_third(alpha).trace == pytest.approx(7.81, abs=5e-3)
    right = best_third(math.pi / 2)
    assert right.trace == pytest.approx(1.5)
    np.testing.assert_allclose(three_sensor_trace(math.pi / 2, np.linspace(0, 3, 9)), 1.5)


@given(between, turns, between)
def test_in_space_three_ranges_have_the_trace_of_three_ranges(alpha, beta, gamma):
    third = [
        math.cos(gamma) * math.cos(beta),
        math.cos(gamma) * math.sin(beta),
        math.sin(gamma),
    ]
    directions = [[1.0, 0.0, 0.0], [math.cos(alpha), math.sin(alpha), 0.0], third]
    expected = np.trace(bound(directions))
    assert three_sensor_trace_3d(alpha, beta, gamma=gamma) == pytest.approx(expected, rel=1e-6)


def test_in_space_the_trace_depends_on_the_direction_of_the_third_unless_it_is_overhead():
    beta = np.array([0.0, 0.5, 1.2])
    low = three_sensor_trace_3d(1.1, beta, gamma=0.8)
    assert np.ptp(low) > 0.1
    overhead = three_sensor_trace_3d(1.1, beta, gamma=math.pi / 2)
    np.testing.assert_allclose(overhead, 1.0 + 2.0 / math.sin(1.1) ** 2)


@given(st.floats(0.1, 10.0), st.floats(0.0, 1.0))
def test_what_two_discs_share_is_as_high_as_their_crossings(reach, share):
    apart = 2.0 * reach * share
    height = float(half_chord(reach, apart))
    assert math.hypot(height, apart / 2) == pytest.approx(reach)


@given(st.floats(0.01, 1.0), st.floats(0.05, math.pi - 0.05))
def test_the_long_diagonal_is_that_of_the_rhombus_of_two_strips(u, alpha):
    """A linear program in every direction finds how far two points of the strips are apart."""
    a, b = seen(0.3, 0.3 + alpha)
    corners = [np.linalg.solve([a, b], u * np.array(s)) for s in ((1, 1), (1, -1))]
    along = max(corners, key=np.linalg.norm)
    along = along / np.linalg.norm(along)
    rows = np.array([a, -a, b, -b])
    half = -linprog(-along, A_ub=rows, b_ub=np.full(4, u), bounds=[(None, None)] * 2).fun
    assert long_diagonal(u, alpha) == pytest.approx(2 * half, rel=1e-6)


def test_one_ring_alone_limits_the_diagonal():
    assert long_diagonal(0.1, np.array([0.01, 1.5]), reach_m=3.0) == pytest.approx(
        [3.1, 0.2 / math.sin(0.75)]
    )
    assert long_diagonal(0.1, 0.0, reach_m=3.0) == pytest.approx(3.1)


@given(st.floats(0.5, 5.0), st.floats(0.5, 5.0), st.floats(0.1, 10.0), st.floats(0.0, 0.4))
def test_two_cells_are_two_pieces_of_the_plane(first, second, apart, u):
    """On a fine path along the line of the sensors no place is in both rings: the pieces part."""
    x = np.linspace(-12.0, 22.0, 40_001)
    in_first = np.abs(np.abs(x) - first) <= u
    in_second = np.abs(np.abs(x - apart) - second) <= u
    met = bool((in_first & in_second).any())
    apart_by_rule = bool(two_cells(first, second, apart_m=apart, error_m=u))
    outer = first + second - apart - 2 * u
    inner = min(first, second) + apart - max(first, second) - 2 * u
    if min(abs(outer), abs(inner)) < 2e-3:  # the path is not so fine
        return
    cross = apart <= first + second + 2 * u and apart >= abs(first - second) - 2 * u
    assert apart_by_rule == (cross and not met)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: two_sensor_covariance(0.2, math.pi), "angle of 0 or a straight one"),
        (lambda: two_sensor_covariance(0.2, np.array([1.0, 0.0])), "angle of 0"),
        (lambda: three_sensor_trace(0.0, math.pi), "on a line"),
        (lambda: printed_third(0.0), "alpha"),
        (lambda: printed_trace(math.pi, 1.0), "alpha"),
        (lambda: three_sensor_trace_3d(1.0, 0.3, gamma=0.0), "gamma"),
        (lambda: half_chord(1.0, 2.1), "reach no place"),
        (lambda: half_chord(1.0, -0.1), "reach no place"),
        (lambda: long_diagonal(0.1, 0.0), "touch"),
        (lambda: long_diagonal(0.1, 4.0, reach_m=2.0), "touch"),
    ],
)
def test_where_a_direction_is_free_there_is_no_closed_form(call, words):
    with pytest.raises(InputError, match=words):
        call()
