"""Cheapest accurate sets: against enumeration; the sum of ranks; nothing accurate enough."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.scheduling.lifetime_search import (
    all_sets,
    optimum,
    rank_order,
    rank_sum,
    set_traces,
)


def slow_trace(gains, members, prior):
    J = prior + sum(np.outer(gains[i], gains[i]) for i in members)
    return np.trace(np.linalg.inv(J)) if np.linalg.cond(J) < 1e10 else np.inf


def slow_optimum(gains, costs, bound, k, prior):
    """All sets one by one: least cost of the accurate ones, least trace of all."""
    sets = [s for s in combinations(range(len(gains)), k) if np.isfinite(costs[list(s)]).all()]
    traces = [slow_trace(gains, s, prior) for s in sets]
    good = [(costs[list(s)].sum(), s) for s, t in zip(sets, traces, strict=True) if t <= bound]
    return min(good, default=None), min(traces, default=np.inf)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 9),
    st.sampled_from([1, 2, 3, 4]),
    st.sampled_from([2, 3]),
    st.floats(0.3, 20.0),
    st.booleans(),
)
def test_the_optimum_is_that_of_all_sets(seed, n, k, d, bound, with_prior):
    rng = np.random.default_rng(seed)
    gains, costs = rng.standard_normal((n, d)), rng.random(n)
    costs[rng.random(n) < 0.15] = np.inf
    prior = np.diag(rng.random(d) + 0.1) if with_prior else np.zeros((d, d))
    best, least_trace = slow_optimum(gains, costs, bound, k, prior)
    found = optimum(gains, costs, bound=bound, k=k, prior=prior if with_prior else None)
    assert found.feasible == (best is not None)
    if best is not None:
        assert found.cost == pytest.approx(best[0], rel=1e-12)
        assert found.trace <= bound
    else:
        assert found.trace == pytest.approx(least_trace, rel=1e-8)
    if found.chosen.size:
        assert found.trace == pytest.approx(slow_trace(gains, found.chosen, prior), rel=1e-8)
        assert found.cost == pytest.approx(costs[found.chosen].sum())
        assert (np.diff(found.chosen) > 0).all()
    else:
        assert found.trace == np.inf


@given(st.integers(0, 2**32 - 1), st.integers(3, 12), st.floats(1.4, 6.0))
def test_the_rank_sum_is_least_among_accurate_sets_and_attempts_are_counted(seed, n, bound):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, n)
    gains = np.column_stack([np.cos(angle), np.sin(angle)])
    costs = rng.random(n)
    rank = np.argsort(np.argsort(costs))
    none = np.zeros((2, 2))
    sets = sorted(
        combinations(range(n), 3), key=lambda s: (rank[list(s)].sum(), costs[list(s)].sum())
    )
    good = [i for i, s in enumerate(sets) if slow_trace(gains, s, none) <= bound]
    found = rank_sum(gains, costs, bound=bound)
    exact = optimum(gains, costs, bound=bound)
    assert found.feasible == exact.feasible == bool(good)
    if good:
        assert tuple(found.chosen) == sets[good[0]]
        assert found.attempts == good[0] + 1
        assert found.cost >= exact.cost - 1e-12
    else:
        assert found.attempts == len(sets)
        assert found.trace == pytest.approx(exact.trace)
        np.testing.assert_array_equal(found.chosen, exact.chosen)


def test_sets_of_equal_rank_sum_come_by_cost():
    costs = np.array([1.0, 2.0, 3.0, 3.5])
    sets = np.array([[0, 3], [1, 2], [0, 1]], np.int32)
    assert rank_order(costs, sets).tolist() == [2, 0, 1]


def test_traces_of_sets_on_a_line_are_infinite():
    gains = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(
        set_traces(gains, np.array([[0, 1], [0, 2]], np.int32)), [np.inf, 2.0]
    )


@pytest.mark.parametrize("search", [optimum, rank_sum])
def test_all_on_a_line_and_too_few_nodes_say_that_nothing_can_be_reached(search):
    line = np.outer([1.0, -2.0, 0.5, 3.0], [0.6, 0.8])
    for gains in (line, np.eye(2)):
        found = search(gains, np.ones(len(gains)), bound=3.0)
        assert not found.feasible
        assert found.chosen.size == 0
        assert found.trace == np.inf


@pytest.mark.parametrize("search", [optimum, rank_sum])
def test_without_an_accurate_set_the_best_reachable_is_named(search):
    angle = np.radians([0.0, 10.0, 20.0, 30.0])
    gains = np.column_stack([np.cos(angle), np.sin(angle)])
    found = search(gains, np.array([1.0, 1.0, 1.0, np.inf]), bound=3.0)
    assert not found.feasible
    assert found.chosen.tolist() == [0, 1, 2]
    assert found.trace == pytest.approx(slow_trace(gains, [0, 1, 2], np.zeros((2, 2))))


@pytest.mark.parametrize("search", [optimum, rank_sum])
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gains": np.ones((3, 4))}, r"\(3, 4\)"),
        ({"gains": np.full((3, 2), np.nan)}, "finite"),
        ({"costs": np.ones(2)}, "costs of shape"),
        ({"costs": np.array([1.0, -2.0, 1.0])}, "costs: found -2.0"),
        ({"costs": np.array([1.0, np.nan, 1.0])}, "costs: found nan"),
        ({"bound": 0.0}, "bound"),
        ({"bound": np.nan}, "bound"),
        ({"k": 5}, "k: found 5"),
        ({"prior": np.eye(3)}, "prior"),
    ],
)
def test_bad_input_is_refused(search, changes, message):
    given_ = {"gains": np.ones((3, 2)), "costs": np.ones(3), "bound": 3.0, **changes}
    with pytest.raises(InputError, match=message):
        search(given_.pop("gains"), given_.pop("costs"), **given_)


def test_too_many_sets_to_try_one_by_one_are_refused():
    with pytest.raises(InputError, match="at most"):
        all_sets(1000, 4)
