"""OSPA and GOSPA: metrics, equal to Stone Soup's, to all assignments tried, and by hand."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import peers
from trackfield import matching
from trackfield.errors import InputError
from trackfield.metrics.ospa import gospa, ospa

places = st.floats(-8, 8).map(lambda x: round(x, 3))
sets = st.lists(st.tuples(places, places), max_size=5).map(
    lambda rows: np.array(rows).reshape(-1, 2)
)
cutoffs, orders = st.floats(0.1, 20), st.floats(1, 6)
alphas = st.floats(0.1, 2)


@given(sets, sets, sets, cutoffs, orders, alphas)
def test_both_are_metrics(one, other, third, cutoff_m, order, alpha):
    def single(x, y):
        return ospa(x, y, cutoff_m=cutoff_m, order=order)

    def general(x, y):
        return gospa(x, y, cutoff_m=cutoff_m, order=order, alpha=alpha).gospa_m

    for distance in (single, general):
        assert distance(one, one) == 0.0
        assert distance(one, other) == pytest.approx(distance(other, one), abs=1e-9)
        slack = 1e-9 * (1 + cutoff_m)
        assert distance(one, third) <= distance(one, other) + distance(other, third) + slack
        if {*map(tuple, one)} != {*map(tuple, other)}:
            assert distance(one, other) > 0.0


@given(sets, sets, cutoffs, orders)
def test_gospa_is_the_sum_of_its_parts_and_ospa_within_the_cutoff(one, other, cutoff_m, order):
    found = gospa(one, other, cutoff_m=cutoff_m, order=order)
    parts = found.localisation + cutoff_m**order / 2 * (found.missed + found.false)
    assert found.gospa_m**order == pytest.approx(parts, rel=1e-9, abs=1e-12)
    assert found.false - found.missed == len(other) - len(one)
    assert ospa(one, other, cutoff_m=cutoff_m, order=order) <= cutoff_m * (1 + 1e-12)


@given(sets, sets, cutoffs, orders, alphas)
def test_as_all_assignments_tried(one, other, cutoff_m, order, alpha):
    few, many = sorted((one, other), key=len)
    cut = np.minimum(np.linalg.norm(few[:, None] - many[None], axis=2), cutoff_m) ** order
    best = min(
        sum(cut[i, j] for i, j in enumerate(chosen))
        for chosen in itertools.permutations(range(len(many)), len(few))
    )
    more = cutoff_m**order * (len(many) - len(few))
    expected = ((best + more) / max(len(many), 1)) ** (1 / order)
    assert ospa(one, other, cutoff_m=cutoff_m, order=order) == pytest.approx(expected, abs=1e-9)
    found = gospa(one, other, cutoff_m=cutoff_m, order=order, alpha=alpha)
    assert found.gospa_m == pytest.approx((best + more / alpha) ** (1 / order), abs=1e-9)


def test_as_stone_soup():
    rng = np.random.default_rng(1)
    for i in range(150):
        order = (1.0, 2.0, 1.5)[i % 3]
        n, m = rng.integers(0, 7), rng.integers(1, 7)
        one, other = rng.uniform(0, 9, (n, 2)), rng.uniform(0, 9, (m, 2))
        if i % 2:
            one, other = other, one
        cutoff_m = float(rng.uniform(1, 6))
        single, whole, *parts = peers.set_distances(one, other, cutoff_m=cutoff_m, order=order)
        found = gospa(one, other, cutoff_m=cutoff_m, order=order)
        assert found.gospa_m == pytest.approx(whole, rel=1e-9)
        if (
            order != 1.5
        ):  # it tells pairs at the cut-off by equal floats, which fails for odd powers
            unit = cutoff_m**order / 2
            ours = (found.localisation, found.missed * unit, found.false * unit)
            np.testing.assert_allclose(ours, parts, rtol=1e-9, atol=1e-12)
        mine = ospa(one, other, cutoff_m=cutoff_m, order=order)
        # It looks for the best pairs by the sum of d, not of d^p.
        assert mine <= single * (1 + 1e-9)
        if order == 1.0 or min(n, m) == 0:
            assert mine == pytest.approx(single, rel=1e-9)


def test_small_errors_are_not_lost_beside_the_cutoff():
    one, other = np.array([[0.0, 3.0], [3.0, 0.0]]), np.array([[0.0, 3.25], [3.0, 0.0]])
    assert ospa(one, other, cutoff_m=7.0, order=6.0) == pytest.approx(
        0.25 / 2 ** (1 / 6), rel=1e-12
    )
    far = np.array([[0.0, 3.25], [3.0, 0.03]])
    expected = gospa(one, far, cutoff_m=1.0, order=6.0).gospa_m
    assert gospa(one, far, cutoff_m=700.0, order=6.0).gospa_m == pytest.approx(expected, rel=1e-9)


def test_by_hand():
    one, other = (
        np.array([[0.0, 0.0], [10.0, 0.0]]),
        np.array([[3.0, 4.0], [10.0, 1.0], [50.0, 0.0]]),
    )
    found = gospa(one, other, cutoff_m=6.0)
    assert found == (pytest.approx(math.sqrt(26 + 18)), pytest.approx(26.0), 0, 1)
    assert ospa(one, other, cutoff_m=6.0) == pytest.approx(math.sqrt((26 + 36) / 3))
    # Just at the cut-off a pair is none.
    assert gospa(one, other, cutoff_m=5.0)[2:] == (1, 2)
    assert ospa(one[:0], one[:0]) == 0.0
    assert ospa(one, one[:0], cutoff_m=7.0) == 7.0
    assert gospa(one, one[:0], cutoff_m=8.0, order=1.0) == (8.0, 0.0, 2, 0)


def test_positions_may_have_any_number_of_axes():
    one, other = np.zeros((1, 3)), np.array([[1.0, 2.0, 2.0]])
    assert ospa(one, other) == pytest.approx(3.0)
    assert ospa(np.zeros((1, 1)), np.ones((1, 1))) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"cutoff_m": 0.0}, "cut-off of 0 m"),
        ({"cutoff_m": math.inf}, "cut-off of inf m"),
        ({"cutoff_m": math.nan}, "cut-off of nan m"),
        ({"order": 0.5}, "order 0.5"),
        ({"order": math.inf}, "order inf"),
        ({"order": math.nan}, "order nan"),
        ({"cutoff_m": 1e9, "order": 20.0}, "order 20"),
        ({"alpha": 0.0}, "alpha 0"),
        ({"alpha": 2.5}, "alpha 2.5"),
    ],
)
def test_what_makes_no_distance_is_refused(bad, message):
    with pytest.raises(InputError, match=message):
        gospa(np.zeros((1, 2)), np.ones((1, 2)), **bad)


def test_positions_that_are_no_numbers_are_refused():
    for one, other, name in ((np.nan, 0.0, "truth"), (0.0, np.inf, "shown")):
        with pytest.raises(InputError, match=name):
            ospa(np.full((1, 2), one), np.full((1, 2), other))


pair_lists = st.lists(
    st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(1, 1000)), max_size=14
).map(lambda rows: list({(i, j): (i, j, w) for i, j, w in rows}.values()))


@pytest.mark.parametrize("largest", [matching.LARGEST_DENSE, 0])
@given(pair_lists)
def test_the_cheapest_matching_is_that_of_all_subsets(largest, rows):
    i, j, gain = np.array(rows, int).reshape(-1, 3).T
    best = 0
    stack = [(0, 0, frozenset(), frozenset())]
    while stack:
        k, worth, left, right = stack.pop()
        best = max(best, worth)
        if k < len(rows):
            stack.append((k + 1, worth, left, right))
            if i[k] not in left and j[k] not in right:
                stack.append((k + 1, worth + gain[k], left | {i[k]}, right | {j[k]}))
    usual, matching.LARGEST_DENSE = matching.LARGEST_DENSE, largest
    try:
        chosen = matching.cheapest(i, j, 7.0 - gain, alone=7.0)
    finally:
        matching.LARGEST_DENSE = usual
    assert gain[chosen].sum() == best
    assert np.unique(i[chosen]).size == np.unique(j[chosen]).size == chosen.sum()
