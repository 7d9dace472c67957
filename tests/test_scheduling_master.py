"""Who is master: a plain twin of the rule, the shape of Pham's bells, and what travels."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.scheduling.master import (
    CUT_OFF,
    NOBODY,
    Bells,
    belief_after,
    choose,
    costs,
    costs_ahead,
    fitness,
    relative_costs,
    state_bits,
)
from trackfield.types import Gaussian

unit = st.floats(0.0, 1.0)


def plain_choice(cost, current, able, may_stay, margin):
    """The rule in words: the best of the able, if the master must go or is worse by the margin."""
    best = min((i for i in range(len(cost)) if able[i]), key=lambda i: cost[i], default=NOBODY)
    if current == NOBODY or not may_stay:
        return best
    if best != NOBODY and cost[best] < cost[current] - margin:
        return best
    return current


@given(
    rows=st.lists(st.tuples(unit, unit, st.booleans()), min_size=1, max_size=8),
    alpha=unit,
    margin=unit,
    may_stay=st.booleans(),
    data=st.data(),
)
def test_the_choice_is_that_of_the_plain_rule(rows, alpha, margin, may_stay, data):
    D, left, able = (np.array(column) for column in zip(*rows, strict=True))
    cost = costs(D, left, alpha=alpha)
    for i, (d, p, _) in enumerate(rows):
        assert cost[i] == pytest.approx(alpha * d + (1 - alpha) * (1 - p))
    current = data.draw(st.integers(NOBODY, len(rows) - 1))
    found = choose(cost, current, able=able, may_stay=may_stay, margin=margin)
    assert found.node == plain_choice(cost, current, able, may_stay, margin)
    assert found.previous == current
    assert found.forced == (current != NOBODY and not may_stay)
    assert found.handed_over == (NOBODY not in (current, found.node) and current != found.node)
    assert found.cost == (math.inf if found.node == NOBODY else cost[found.node])


def test_whom_nothing_is_known_of_does_not_become_master():
    cost = np.array([math.inf, 0.9, math.nan])
    assert choose(cost).node == 1
    assert choose(cost, 0).forced
    assert choose(np.array([])).node == NOBODY
    assert choose(cost, 1, able=np.zeros(3, bool), may_stay=False).node == NOBODY


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), turn=st.floats(0, 6.3), lead=st.floats(0.0, 1.0))
def test_a_place_is_as_fit_as_two_bells_say(x, y, turn, lead):
    bells = Bells(lead_m=lead, ahead_m=1.5, behind_m=0.4, across_m=0.7)
    c, s = math.cos(turn), math.sin(turn)
    target = np.array([2.0, -1.0])
    node = target + np.array([c * x - s * y, s * x + c * y])  # x ahead and y across
    u = x - lead
    along = 1 / (1 + (u / 1.5) ** 2) if u >= 0 else math.exp(-((u / 0.4) ** 2) / 2)
    expected = along * math.exp(-((y / 0.7) ** 2) / 2)
    for speed in (0.1, 3.0):
        found = fitness(bells, node[None], target=target, heading=speed * np.array([c, s]))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_ahead_is_fitter_than_behind_and_without_heading_all_sides_are_alike():
    nodes = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    found = fitness(Bells(), nodes, target=np.zeros(2), heading=np.array([2.0, 0.0]))
    assert found[0] == pytest.approx(0.5)
    assert found[1] < 0.2
    still = fitness(Bells(), nodes, target=np.zeros(2), heading=np.zeros(2))
    np.testing.assert_allclose(still, math.exp(-2.0))


def test_who_reaches_no_sink_costs_more_than_any_that_does():
    hops = np.array([3, 0, -1, 1], np.int32)
    rho = relative_costs([1.0, 6.0, 0.5, 4.0], hops, per_hop=3.0)
    np.testing.assert_allclose(rho, [1.0, 0.6, CUT_OFF, 0.7])
    fit = np.array([0.2, 0.5, 1.0, 0.4])
    np.testing.assert_allclose(costs_ahead(rho, fit, alpha=0.5), [0.9, 0.55, 1.0, 0.65])
    assert choose(costs_ahead(rho, fit, alpha=0.5)).node == 1
    spent = relative_costs([1.0, math.inf, math.inf, 4.0], hops, per_hop=3.0)
    np.testing.assert_allclose(spent, [1.0, math.inf, math.inf, 0.7])
    nothing = relative_costs([0.0, 0.0], np.array([0, -1], np.int32), per_hop=0.0)
    np.testing.assert_array_equal(nothing, [0.0, CUT_OFF])


def test_the_state_travels_or_the_filter_begins_anew():
    old, start = (Gaussian(np.full(4, v), v * np.eye(4)) for v in (1.0, 9.0))
    stays, goes, begins = (
        choose(np.array([0.5, 0.1]), current, margin=margin)
        for current, margin in ((0, 0.6), (0, 0.0), (NOBODY, 0.0))
    )
    assert (stays.handed_over, goes.handed_over, begins.handed_over) == (False, True, False)
    for choice in (stays, goes, begins):
        assert belief_after(choice, old, shared=True, start=start) is old
    assert belief_after(goes, old, shared=False, start=start) is start
    assert belief_after(stays, old, shared=False, start=start) is old
    assert state_bits(4) == 512
    assert state_bits(2) == 64 + 32 * 5


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: costs(0.5, 0.5, alpha=1.5), "alpha: found 1.5"),
        (lambda: costs_ahead(0.5, 0.5, alpha=math.nan), "alpha: found nan"),
        (lambda: choose(np.array([1.0]), margin=-1.0), "margin: found -1.0"),
        (lambda: Bells(across_m=0.0), "expected lengths above 0"),
        (lambda: relative_costs([-1.0], np.array([0]), per_hop=0.0), "found costs below 0"),
    ],
)
def test_what_cannot_be_is_refused(call, said):
    with pytest.raises(InputError, match=said):
        call()
