"""Candidates of many intervals, and their best sets, against going through everything."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lifetime_fields import NEED, accurate_sets, small
from trackfield.errors import InputError
from trackfield.scheduling.lifetime_candidates import (
    Need,
    candidates,
    cheapest,
    check_need,
    join,
    shares,
    sharpest,
    usage,
)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_candidates_are_the_nodes_in_reach_with_unit_vectors_over_sigma(seed, d):
    rng = np.random.default_rng(seed)
    c, x = rng.uniform(0, 3, (9, d)), rng.uniform(0, 3, (2, 3, d))
    sigma, reach = rng.uniform(0.1, 1.0, 9), rng.uniform(0.5, 2.0, 9)
    found = candidates(c, x, sigma_m=sigma, reach_m=reach)
    assert len(found) == 6
    assert found.count == 9
    for t, p in enumerate(x.reshape(-1, d)):
        a, b = found.offsets[t : t + 2]
        r = np.linalg.norm(p - c, axis=1)
        np.testing.assert_array_equal(found.nodes[a:b], np.flatnonzero(r <= reach))
        inside = found.nodes[a:b]
        gains = (p - c[inside]) / (r * sigma)[inside, None]
        np.testing.assert_allclose(found.gains[a:b], gains, rtol=1e-12)


def test_a_node_at_the_target_says_nothing():
    found = candidates(np.zeros((1, 2)), np.zeros((1, 2)), sigma_m=0.1, reach_m=1.0)
    assert found.nodes.size == 0


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_parts_join_to_the_whole(seed, cut):
    whole = small(seed % 1000)
    parts = [whole.part(0, cut), whole.part(cut, cut), whole.part(cut, len(whole))]
    again = join(parts, whole.count)
    for name in ("offsets", "nodes", "gains"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    assert len(join([], 5)) == 0


@pytest.mark.parametrize("seed", range(5))
def test_best_sets_and_shares_are_those_of_all_sets(seed):
    rng = np.random.default_rng(seed)
    known = small(seed)
    prices = rng.random(known.count)
    found, shared = cheapest(known, prices, need=NEED), shares(known, prices, need=NEED)
    sharp = sharpest(known, prices, need=NEED)
    for t in range(len(known)):
        every = accurate_sets(known, t, NEED)
        assert shared.sets[t] == len(every)
        a, b = known.offsets[t : t + 2]
        for node, share in zip(known.nodes[a:b], shared.share[a:b], strict=True):
            own = sum(node in s for s in every)
            assert share == pytest.approx(own / len(every) if every else 0.0)
        if every:
            least = min(prices[list(s)].sum() for s in every)
            assert found.value[t] == pytest.approx(least)
            assert prices[found.chosen[t]].sum() == pytest.approx(least)
            assert tuple(np.sort(found.chosen[t])) in every
            assert sharp.value[t] <= NEED.bound_m2
        else:
            assert (found.chosen[t] == -1).all()
            assert found.value[t] == np.inf
            assert not sharp.value[t] <= NEED.bound_m2
    counts = np.bincount(found.chosen[found.chosen >= 0], minlength=known.count)
    np.testing.assert_array_equal(usage(known, found), counts)


def test_nodes_of_infinite_price_are_not_to_be_had():
    known = small(3)
    prices = np.where(np.arange(known.count) % 2, 1.0, np.inf)
    for search in (cheapest, sharpest):
        chosen = search(known, prices, need=NEED).chosen
        assert (chosen[chosen >= 0] % 2 == 1).all()


@pytest.mark.parametrize(
    ("c", "x", "sigma", "reach", "message"),
    [
        (np.zeros((3, 4)), np.zeros((1, 4)), 0.1, 1.0, r"\(3, 4\)"),
        (np.zeros((3, 2)), np.zeros((1, 3)), 0.1, 1.0, r"\(1, 3\)"),
        (np.full((3, 2), np.nan), np.zeros((1, 2)), 0.1, 1.0, "finite"),
        (np.zeros((3, 2)), np.zeros((1, 2)), 0.0, 1.0, "sigma_m: found 0.0"),
        (np.zeros((3, 2)), np.zeros((1, 2)), 0.1, -1.0, "reach_m: found -1.0"),
    ],
)
def test_bad_input_is_refused(c, x, sigma, reach, message):
    with pytest.raises(InputError, match=message):
        candidates(c, x, sigma_m=sigma, reach_m=reach)


@pytest.mark.parametrize("need", [Need(0.0), Need(np.nan), Need(1.0, 0), Need(1.0, 5)])
def test_a_need_that_cannot_be_is_refused(need):
    with pytest.raises(InputError, match="expected"):
        check_need(need)
