"""Function-2D and Function-3D: angles against traces, and what is wrong with step 4 as printed."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.localization.trilateration import traces
from trackfield.scheduling.paper_selection import best_pair_and_next, function_2d, function_3d

seeds = st.integers(0, 2**32 - 1)


def field(seed, n, d):
    rng = np.random.default_rng(seed)
    return rng.uniform(-5, 5, (n, d)), rng.uniform(-1, 1, d)


def trace(sensors, chosen, position):
    return traces(sensors[list(chosen)], position).crlb


def best_with(sensors, kept, position, worst=False):
    """Sensors `kept` and the one more with which the trace is least."""
    others = [i for i in range(len(sensors)) if i not in kept]
    pick = max if worst else min
    return sorted((*kept, pick(others, key=lambda i: trace(sensors, (*kept, i), position))))


def squarest(sensors, position):
    u = sensors - position
    u /= np.linalg.norm(u, axis=1)[:, None]
    pairs = itertools.combinations(range(len(u)), 2)
    return min(pairs, key=lambda pair: abs(u[pair[0]] @ u[pair[1]]))


@given(seeds, st.integers(3, 9))
def test_the_corrected_step_takes_the_best_third_and_the_printed_one_the_worst(seed, n):
    sensors, position = field(seed, n, 2)
    pair = squarest(sensors, position)
    u = (sensors - position)[list(pair)]
    assume(abs(u[0] @ u[1]) > 1e-3)  # at a right angle all thirds are alike
    assert function_2d(sensors, position).tolist() == best_with(sensors, pair, position)
    printed = function_2d(sensors, position, printed=True)
    assert printed.tolist() == best_with(sensors, pair, position, worst=True)


@given(seeds, st.integers(4, 8))
def test_in_space_the_third_is_nearest_to_the_normal_and_the_fourth_is_the_best(seed, n):
    sensors, position = field(seed, n, 3)
    i, j = squarest(sensors, position)
    u = (sensors - position) / np.linalg.norm(sensors - position, axis=1)[:, None]
    others = [k for k in range(n) if k not in (i, j)]
    third = max(others, key=lambda k: abs(np.linalg.det(u[[i, j, k]])))
    chosen = function_3d(sensors, position)
    assert chosen.tolist() == best_with(sensors, (i, j, third), position)


@given(seeds, st.integers(5, 8))
def test_as_printed_the_fourth_is_the_best_for_trilateration(seed, n):
    sensors, position = field(seed, n, 3)
    chosen = function_3d(sensors, position, printed=True).tolist()
    other = function_3d(sensors, position).tolist()
    ols, others_ols = (traces(sensors[s], position).ordinary for s in (chosen, other))
    assert ols <= others_ols * (1 + 1e-9)
    shared = set(chosen) & set(other)
    assert len(shared) >= 3
    if len(shared) == 3:
        rest = [i for i in range(n) if i not in shared]
        least = min(traces(sensors[[*shared, i]], position).ordinary for i in rest)
        assert ols == pytest.approx(least, rel=1e-9)


@given(seeds, st.integers(5, 8), st.sampled_from([2, 3]))
def test_the_next_one_is_the_best_next_one(seed, n, d):
    sensors, position = field(seed, n, d)
    four = best_pair_and_next(sensors, position, d + 1)
    assert set(squarest(sensors, position)) <= set(four.tolist())
    five = best_pair_and_next(sensors, position, d + 2)
    assert five.tolist() == best_with(sensors, tuple(four.tolist()), position)


def test_too_few_sensors_and_one_at_the_target_are_refused():
    with pytest.raises(InputError, match="found 2, expected at least 3"):
        function_2d(np.eye(2), np.zeros(2))
    with pytest.raises(InputError, match="found 3, expected at least 4"):
        function_3d(np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match="sensor 1: found distance 0"):
        function_2d(np.eye(3)[:, :2], np.array([0.0, 1.0]))
    with pytest.raises(InputError, match="sensor 0: found distance nan"):
        function_2d(np.full((3, 2), np.nan), np.zeros(2))
    with pytest.raises(InputError, match="expected at least 2"):
        best_pair_and_next(np.eye(2), np.array([3.0, 3.0]), 1)
