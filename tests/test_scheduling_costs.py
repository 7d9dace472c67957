"""Sensors that cost: the best for a budget and the cheapest for a bound, against all sets."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import selection_twin as twin
from trackfield.errors import InputError
from trackfield.scheduling.selection import select
from trackfield.scheduling.sufficient import sufficient

seeds = st.integers(0, 2**32 - 1)
criteria = st.sampled_from(["A", "D", "E"])
few = settings(max_examples=40)


def field(seed, n, d):
    """Gains and costs; dear sensors are no better."""
    rng = np.random.default_rng(seed)
    gains = rng.normal(size=(n, d)) * np.exp(rng.uniform(-1, 1, n))[:, None]
    return gains, rng.choice([0.0, 0.5, 1.0], n) + rng.uniform(0.0, 1.0, n)


def some_prior(seed, d):
    root = np.random.default_rng(seed).normal(size=(d, d))
    return 0.3 * root @ root.T


def all_sets(n, k):
    return [s for size in range(k + 1) for s in itertools.combinations(range(n), size)]


def signed(value, criterion):
    return -value if criterion == "A" else value


@few
@given(seeds, criteria, st.integers(2, 3), st.floats(0.3, 6.0), st.booleans())
def test_a_budget_buys_the_best_of_all_sets_that_it_pays_for(seed, criterion, d, budget, informed):
    gains, costs = field(seed, 9, d)
    prior = some_prior(seed, d) if informed else np.zeros((d, d))
    found = select(gains, 4, prior=prior, criterion=criterion, costs=costs, budget=budget)
    assert found.cost == pytest.approx(costs[found.sensors].sum())
    assert found.cost <= budget
    assert len(found.sensors) <= 4
    paid = [s for s in all_sets(9, 4) if costs[list(s)].sum() <= budget]
    best = max(twin.value(gains, s, prior, criterion) for s in paid)
    assert found.optimal
    if found.determined:
        assert signed(found.value, criterion) == pytest.approx(best, rel=1e-9, abs=1e-9)
        assert found.ratio >= 1.0 - 1e-9
    else:
        rank = np.linalg.matrix_rank
        assert len(found.missing) == d - max((rank(gains[list(s)]) for s in paid if s), default=0)


@few
@given(seeds, criteria, st.integers(2, 3), st.floats(0.05, 0.95), st.booleans())
def test_the_cheapest_is_that_of_all_sets_that_are_good_enough(seed, criterion, d, part, informed):
    gains, costs = field(seed, 9, d)
    prior = some_prior(seed, d) if informed else np.zeros((d, d))
    sets = all_sets(9, 4)
    values = np.array([twin.value(gains, s, prior, criterion) for s in sets])
    least = {"A": -1e4, "D": -15.0, "E": 1e-6}[criterion]  # less is rounding, of singular sets
    sane = values[values > least]
    level = float(np.quantile(sane, part))
    found = sufficient(
        gains, 4, costs=costs, level=signed(level, criterion), prior=prior, criterion=criterion
    )
    cheapest = min(
        costs[list(s)].sum() for s, v in zip(sets, values, strict=True) if v >= level - 1e-12
    )
    assert found.feasible
    assert found.optimal
    assert found.cost == pytest.approx(cheapest, rel=1e-9, abs=1e-12)
    assert found.cost == pytest.approx(costs[found.sensors].sum())
    assert signed(found.value, criterion) >= level - 1e-9 * abs(level)
    assert found.bound <= cheapest + 1e-9


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
def test_what_one_finds_the_other_finds_back_among_hundreds(criterion):
    gains, costs = field(11, 300, 2)
    costs += 0.2
    bought = select(gains, 6, criterion=criterion, costs=costs, budget=3.0)
    assert bought.way == "tree"
    back = sufficient(gains, 6, costs=costs, level=bought.value, criterion=criterion)
    assert back.feasible
    assert back.optimal or criterion == "E"  # where the relaxation is farther off
    assert back.cost == pytest.approx(bought.cost, rel=1e-9) or back.cost < bought.cost
    more = sufficient(
        gains,
        6,
        costs=costs,
        level=signed(signed(bought.value, criterion) + 1e-6, criterion),
        criterion=criterion,
    )
    assert not more.feasible or more.cost > 3.0


def test_a_budget_that_binds_nobody_changes_nothing():
    gains, costs = field(3, 60, 3)
    free = select(gains, 5)
    paid = select(gains, 5, costs=costs, budget=1e3)
    assert paid.sensors.tolist() == free.sensors.tolist()
    assert paid.certificate is not None
    assert free.cost == 0.0
    assert paid.cost == pytest.approx(costs[paid.sensors].sum())


def test_sensors_that_a_budget_cannot_pay_are_as_if_they_were_not_there():
    gains, costs = field(4, 40, 2)
    costs[::2] = 50.0
    found = select(gains, 3, costs=costs, budget=20.0)
    alone = select(gains[1::2], 3)
    assert found.sensors.tolist() == (2 * alone.sensors + 1).tolist()
    nothing = select(gains, 3, prior=np.eye(2), costs=costs + 30.0, budget=20.0)
    assert nothing.sensors.size == 0
    assert nothing.value == pytest.approx(2.0)


def test_a_bound_that_nobody_reaches_says_the_best_that_can_be_reached():
    gains, costs = field(5, 12, 2)
    best = select(gains, 3)
    found = sufficient(gains, 3, costs=costs, level=0.9 * best.value)
    assert not found.feasible
    assert found.sensors.tolist() == best.sensors.tolist()
    assert found.value == best.value
    assert found.optimal
    assert found.bound == np.inf
    line = sufficient(np.outer(np.arange(1.0, 5.0), [0.6, 0.8]), 3, costs=np.ones(4), level=1.0)
    assert not line.feasible
    nobody = sufficient(np.empty((0, 2)), 3, costs=np.empty(0), level=1.0)
    assert not nobody.feasible
    assert nobody.sensors.size == 0


def test_a_prior_that_is_good_enough_asks_nobody():
    gains, costs = field(6, 12, 2)
    found = sufficient(gains, 3, costs=costs, level=2.5, prior=np.eye(2))
    assert (found.sensors.size, found.cost, found.feasible) == (0, 0.0, True)
    assert found.value == pytest.approx(2.0)
    free = sufficient(gains, 3, costs=0.0 * costs, level=1.5, prior=np.eye(2))
    assert free.feasible
    assert (free.cost, free.bound) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ({"costs": np.ones(3)}, r"costs of shape \(3,\): expected \(4,\)"),
        ({"costs": np.array([1.0, -1.0, 1.0, 1.0])}, "sensor 1: found -1"),
        ({"costs": np.array([1.0, 1.0, np.nan, 1.0])}, "sensor 2: found nan"),
        ({"costs": np.ones(4), "budget": -1.0}, "budget: found -1"),
        ({"costs": np.ones(4), "budget": np.nan}, "budget: found nan"),
        ({"budget": 3.0}, "expected costs"),
    ],
)
def test_costs_that_cannot_be_used_are_refused(extra, words):
    with pytest.raises(InputError, match=words):
        select(np.ones((4, 2)), 2, **extra)


def test_a_level_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="level: found nan"):
        sufficient(np.eye(2), 2, costs=np.ones(2), level=np.nan)
