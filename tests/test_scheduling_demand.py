"""Prices by demand: shares by counting, plans against a linear program, learning."""

import numpy as np
import pytest
from scipy.optimize import linprog

from lifetime_fields import NEED, accurate_sets, small
from trackfield.errors import InputError
from trackfield.scheduling import demand
from trackfield.scheduling.demand import (
    MEMORY_PASSES,
    PRIOR_INTERVALS,
    by_flow,
    by_shares,
    expected,
    learned,
    need_shares,
    planned_flow,
)
from trackfield.scheduling.lifetime_candidates import join


@pytest.mark.parametrize("seed", range(4))
def test_shares_are_counted_over_intervals_that_have_accurate_sets(seed):
    known = small(seed)
    total, served = np.zeros(known.count), 0
    for t in range(len(known)):
        every = accurate_sets(known, t, NEED)
        served += bool(every)
        for node in range(known.count):
            total[node] += sum(node in s for s in every) / max(len(every), 1)
    np.testing.assert_allclose(need_shares(known, need=NEED), total / max(served, 1), rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_plan_comes_near_the_least_of_the_greatest_load(seed):
    known = small(seed, nodes=40)
    sets = [(t, s) for t in range(len(known)) for s in accurate_sets(known, t, NEED)]
    served = sorted({t for t, _ in sets})
    loads = np.zeros((known.count, len(sets) + 1))
    once = np.zeros((len(served), len(sets) + 1))
    for j, (t, s) in enumerate(sets):
        loads[list(s), j] = 1.0
        once[served.index(t), j] = 1.0
    loads[:, -1] = -1.0
    goal = np.append(np.zeros(len(sets)), 1.0)
    best = linprog(
        goal, A_ub=loads, b_ub=np.zeros(known.count), A_eq=once, b_eq=[1.0] * len(served)
    )
    flow = planned_flow(known, need=NEED, rounds=300) * len(known)
    assert flow.sum() == pytest.approx(3.0 * len(served), rel=0.02)
    assert best.fun - 1e-9 <= flow.max() * 1.02
    assert flow.max() <= 1.25 * best.fun


def test_prices_fall_with_energy_and_rise_with_demand():
    weights = by_shares(expected(small(1), need=NEED))
    nodes = np.arange(30, dtype=np.int32)
    full, low = (weights.prices(np.full(30, x), nodes) for x in (6.0, 1.0))
    assert (low > full).all()
    assert low / full == pytest.approx(np.full(30, (5.01 / 0.01) ** 3))
    np.testing.assert_array_equal(np.argsort(full), np.argsort(weights.weight))
    assert weights.learn(small(2)) is weights
    flow = expected(small(1), need=NEED)
    told = by_flow(flow)
    np.testing.assert_allclose(told.weight, np.maximum(flow.flow, 1e-4) ** 3)
    assert told.exponent == 1.0


def test_learning_mixes_the_prior_with_the_passes_that_are_over():
    places, one, two = small(1), small(2), small(3)
    start = learned(places, need=NEED)
    assert start.now is start.prior
    first = start.learn(one)
    found = expected(one, need=NEED)
    own = len(one) / (len(one) + PRIOR_INTERVALS)
    for now, new, old in zip(first.now, found, start.prior, strict=True):
        np.testing.assert_allclose(now, own * new + (1 - own) * old)
    second = first.learn(two)
    found = expected(join([one, two], one.count), need=NEED)
    own = 2 * len(one) / (2 * len(one) + PRIOR_INTERVALS)
    np.testing.assert_allclose(second.now.share, own * found.share + (1 - own) * start.prior.share)
    nodes = np.arange(5, dtype=np.int32)
    floor = np.maximum(second.now.flow[:5], 1e-4) ** 2 * np.maximum(second.now.share[:5], 1e-4)
    np.testing.assert_allclose(second.prices(np.full(5, 2.0), nodes), floor / 1.01)


def test_plans_are_made_again_ever_more_rarely_and_memory_is_bounded(monkeypatch):
    made = []

    def counted(given, *, need):
        made.append(len(given))
        return real(given, need=need)

    real = demand.expected
    state, one = learned(small(1), need=NEED), small(2, intervals=1)
    monkeypatch.setattr(demand, "expected", counted)
    for _ in range(MEMORY_PASSES + 20):
        state = state.learn(one)
    assert len(made) < 20
    assert len(state.passed) == MEMORY_PASSES
    assert max(made) <= MEMORY_PASSES


def test_a_forecast_of_nothing_is_refused():
    with pytest.raises(InputError, match="no interval"):
        expected(join([], 3), need=NEED)
