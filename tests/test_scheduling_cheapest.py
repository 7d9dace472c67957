"""The cheapest sets: equal to trying every set, in both dimensions and under every limit."""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from trackfield.errors import InputError
from trackfield.scheduling.cheapest import Choice, cheapest


def tried(J, g, w, bound, worth, limits):
    """Try every set: (sensors, trace, cost, feasible) by the rules of the docstring."""
    fewest, most = limits
    found = []
    able = np.flatnonzero(np.isfinite(w))
    for members in chain.from_iterable(combinations(able, k) for k in range(fewest, most + 1)):
        M = J + sum((np.outer(g[i], g[i]) for i in members), np.zeros_like(J))
        singular = np.linalg.matrix_rank(M, tol=1e-9) < len(M)
        trace = np.inf if singular else np.trace(np.linalg.inv(M))
        found.append((w[list(members)].sum(), trace, frozenset(map(int, members))))
    kept = [f for f in found if f[1] <= bound]
    if kept:
        cost, trace, members = min(kept, key=lambda f: (f[0] + worth * f[1], f[1]))
        return members, trace, cost, True
    if not found or min(f[1] for f in found) == np.inf:
        return frozenset(), np.inf, 0.0, False
    cost, trace, members = min(found, key=lambda f: f[1])
    return members, trace, cost, False


def members_of(choice: Choice) -> list[frozenset[int]]:
    rows = choice.sensors.reshape(-1, 3)
    return [frozenset(int(i) for i in row if i >= 0) for row in rows]


@settings(max_examples=120, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(0, 8),
    d=st.sampled_from((2, 3)),
    limits=st.sampled_from(((0, 3), (0, 2), (1, 1), (3, 3), (2, 3))),
    bound=st.floats(0.05, 8.0),
    known=st.booleans(),
    worth=st.sampled_from((0.0, 0.5, 20.0)),
)
def test_no_set_is_cheaper_and_none_is_forgotten(seed, n, d, limits, bound, known, worth):
    rng = np.random.default_rng(seed)
    g = rng.standard_normal((n, d))
    w = rng.uniform(0.5, 3.0, n)
    w[rng.random(n) < 0.2] = np.inf
    root = rng.standard_normal((d, d))
    J = root @ root.T + 0.05 * np.eye(d) if known else np.zeros((d, d))
    found = cheapest(J, g, weights=w, bound=bound, worth=worth, limits=limits)
    members, trace, cost, feasible = tried(J, g, w, bound, worth, limits)
    assert members_of(found) == [members]
    assert_allclose(found.trace, trace, rtol=1e-8)
    assert_allclose(found.cost, cost, rtol=1e-12)
    assert bool(found.feasible) is feasible


def test_of_sets_that_cost_the_same_the_sharpest_is_taken():
    angles = np.deg2rad([0.0, 10.0, 55.0, 100.0])
    g = np.column_stack([np.cos(angles), np.sin(angles)])
    found = cheapest(np.zeros((2, 2)), g, weights=np.ones(4), bound=100.0)
    assert members_of(found) == [{1, 3}]  # at right angles: tr = 2
    assert found.trace == pytest.approx(2.0)


def test_a_dear_pair_may_cost_more_than_three_cheap_ones():
    angles = np.deg2rad([0.0, 20.0, 40.0, 90.0])
    g = np.column_stack([np.cos(angles), np.sin(angles)])
    weights = np.array([1.0, 1.0, 1.0, 9.0])
    loose = cheapest(np.zeros((2, 2)), g, weights=weights, bound=4.7)
    assert members_of(loose) == [{0, 1, 2}]
    tight = cheapest(np.zeros((2, 2)), g, weights=weights, bound=2.1)
    assert members_of(tight) == [{0, 3}]
    assert (tight.cost, tight.trace) == (10.0, pytest.approx(2.0))


def test_many_at_once_are_each_for_itself():
    rng = np.random.default_rng(1)
    J = np.eye(2) * rng.uniform(0.1, 2.0, (5, 1, 1, 1))
    g = rng.standard_normal((4, 7, 2))
    w = rng.uniform(0.0, 1.0, (5, 4, 7))
    bound = rng.uniform(0.3, 2.0, (5, 4))
    worth = rng.uniform(0.0, 2.0, 4)
    whole = cheapest(J, g, weights=w, bound=bound, worth=worth)
    assert whole.sensors.shape == (5, 4, 3)
    for i, j in np.ndindex(5, 4):
        one = cheapest(
            J[i, 0], g[j], weights=w[i, j], bound=float(bound[i, j]), worth=float(worth[j])
        )
        assert_array_equal(whole.sensors[i, j], one.sensors)
        assert (whole.trace[i, j], whole.cost[i, j]) == (one.trace, one.cost)
        assert whole.feasible[i, j] == one.feasible


def test_a_prior_that_is_good_enough_asks_nobody():
    found = cheapest(np.eye(2), np.ones((3, 2)), weights=np.ones(3), bound=2.0)
    assert_array_equal(found.sensors, [-1, -1, -1])
    assert (float(found.trace), float(found.cost), bool(found.feasible)) == (2.0, 0.0, True)


def test_nobody_to_ask_leaves_the_prior():
    for weights in (np.zeros(0), np.full(2, np.inf)):
        found = cheapest(np.eye(2), np.ones((len(weights), 2)), weights=weights, bound=1.0)
        assert members_of(found) == [frozenset()]
        assert (float(found.trace), float(found.cost), bool(found.feasible)) == (2.0, 0.0, False)


def test_what_cannot_be_used_is_refused():
    g, w = np.ones((4, 2)), np.ones(4)
    with pytest.raises(InputError, match="expected 0 <= fewest <= most <= 3"):
        cheapest(np.eye(2), g, weights=w, bound=1.0, limits=(0, 4))
    with pytest.raises(InputError, match="a worth that is negative"):
        cheapest(np.eye(2), g, weights=w, bound=1.0, worth=-1.0)
    with pytest.raises(InputError, match="weights of shape \\(3,\\)"):
        cheapest(np.eye(2), g, weights=w[:3], bound=1.0)
    with pytest.raises(InputError, match="with d 2 or 3"):
        cheapest(np.eye(4), np.ones((4, 4)), weights=w, bound=1.0)
    with pytest.raises(InputError, match="no numbers"):
        cheapest(np.eye(2), np.full((4, 2), np.nan), weights=w, bound=1.0)
    with pytest.raises(InputError, match="negative or no number"):
        cheapest(np.eye(2), g, weights=np.array([1.0, np.nan, 1.0, -1.0]), bound=1.0)
