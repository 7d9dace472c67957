"""Lifetimes: a slow twin, conservation of energy, the order of policies, trouble."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lifetime_fields import NEED, accurate_sets, field, passes, small
from trackfield.errors import InputError
from trackfield.scheduling.cost import exponential
from trackfield.scheduling.lifetime import Field, lifetime
from trackfield.scheduling.lifetime_candidates import Need, candidates
from trackfield.scheduling.lifetime_policies import POLICIES, policy


def slow_twin(made, paths, need):
    """First death, failed intervals, residuals with the cost log x / (x - 1), set by set."""
    x = np.full(len(made.sensors), made.battery)
    death, failed, now = None, 0, 0
    for path in paths:
        known = candidates(made.sensors, path, sigma_m=made.sigma_m, reach_m=made.reach_m)
        for t in range(len(known)):
            now += 1
            cost = np.full(x.size, np.inf)
            alive = x >= 1.0
            cost[alive] = np.log((x[alive] + 1e-9) / (x[alive] - 1.0 + 1e-9))
            every = [s for s in accurate_sets(known, t, need) if alive[list(s)].all()]
            if not every:
                failed += 1
                continue
            # Equal costs: the first by rising cost, then by number, as the search goes.
            rank = np.argsort(np.argsort(cost, kind="stable"), kind="stable")
            best = min(every, key=lambda s: (round(cost[list(s)].sum(), 12), sorted(rank[list(s)])))
            x[list(best)] -= 1.0
            if death is None and (x[list(best)] < 1.0).any():
                death = now
    return death, failed, x


@pytest.mark.parametrize("seed", range(3))
def test_a_lifetime_is_that_of_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    made, paths = field(rng, 40, size_m=4.0, battery=3.0), passes(rng, 4, 8, size_m=4.0)
    found = lifetime(made, paths, need=NEED, chosen_by="cost")
    death, failed, x = slow_twin(made, paths, NEED)
    assert found.first_death == death
    assert found.failed == failed
    assert found.residual.sum() == pytest.approx(x.sum())
    np.testing.assert_allclose(np.sort(found.residual), np.sort(x))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(POLICIES), st.integers(2, 4))
def test_energy_is_spent_on_served_intervals_only(seed, name, k):
    rng = np.random.default_rng(seed)
    made, paths = field(rng, 40, size_m=4.0, battery=4.5), passes(rng, 5, 6, size_m=4.0)
    found = lifetime(made, paths, need=Need(0.04, k), chosen_by=name, forecast=paths)
    assert found.served + found.failed == 30
    assert 0 <= found.geometric <= found.failed
    assert found.residual.sum() == pytest.approx(40 * 4.5 - k * found.served)
    assert (found.residual >= 0.5).all()  # a node with half a sensing left senses no more
    assert (found.first_death is not None) == bool((found.residual < 1.0).any())
    assert found.history.shape == (5, 4)
    assert found.history[:, 0].sum() == found.served
    assert (np.diff(found.history[:, 1:], axis=0) <= 1e-12).all()
    assert found.mean_trace_m2 <= 0.04


def test_weighing_by_demand_outlives_costs_and_costs_outlive_geometry():
    deaths = {name: [] for name in ("geometry", "cost", "rank_sum", "flow", "learned")}
    for seed in (40, 41):
        rng = np.random.default_rng(seed)
        made, paths = field(rng, 441, battery=8.0), passes(rng, 36, 25)
        forecast = passes(rng, 200, 25)
        for name, found in deaths.items():
            end = lifetime(made, paths, need=NEED, chosen_by=name, forecast=forecast)
            found.append(end.first_death)
    mean = {name: np.mean(found) for name, found in deaths.items()}
    assert mean["cost"] > 2.0 * mean["geometry"]
    assert abs(mean["rank_sum"] / mean["cost"] - 1.0) < 0.05
    assert mean["learned"] > mean["cost"]
    assert mean["flow"] > 1.03 * mean["cost"]


def test_an_end_of_service_is_the_first_pass_that_fails_and_of_coverage_the_pass_after():
    rng = np.random.default_rng(5)
    made, paths = field(rng, 60, size_m=4.0, battery=3.0), passes(rng, 20, 10, size_m=4.0)
    found = lifetime(made, paths, need=NEED, chosen_by="flow", forecast=paths)
    assert found.geometric == 0
    bad = np.flatnonzero(found.history[:, 0] < 9.0)
    assert found.service_lifetime == 10 * bad[0] + 1
    assert found.coverage_lifetime is not None
    assert found.coverage_lifetime % 10 == 0
    assert found.first_death < found.coverage_lifetime


def test_a_network_with_energy_left_has_no_end():
    rng = np.random.default_rng(6)
    made, paths = field(rng, 60, size_m=4.0, battery=100.0), passes(rng, 2, 5, size_m=4.0)
    shares = []
    found = lifetime(made, paths, need=NEED, progress=shares.append)
    assert found.first_death is found.service_lifetime is found.coverage_lifetime is None
    assert shares == [0.5, 1.0]


def test_nodes_in_space_and_an_own_policy_and_price():
    rng = np.random.default_rng(7)
    made = Field(rng.uniform(0, 3, (60, 3)), 0.1, 1.5, np.full(60, 5.0))
    paths = rng.uniform(0.5, 2.5, (3, 4, 3))
    need = Need(0.1, 4)
    own = policy("cost", need=need, places=small(1), price=exponential(2.0))
    found = lifetime(made, paths, need=need, chosen_by=own)
    assert found.served > 0
    assert found.residual.sum() == pytest.approx(300 - 4 * found.served)
    assert lifetime(made, paths, need=need).served == found.served


def test_all_energy_gone_or_too_few_nodes_serve_nothing():
    line = np.column_stack([np.arange(5.0), np.zeros(5)])
    paths = np.full((1, 3, 2), 1.0) + np.arange(3)[None, :, None] * [[[0.5, 0.0]]]
    empty = lifetime(Field(line, 0.1, 5.0, 0.5), paths, need=NEED, chosen_by="cost")
    assert (empty.served, empty.failed, empty.mean_trace_m2) == (0, 3, 0.0)
    assert empty.service_lifetime == 1
    alone = lifetime(Field(line[:2], 0.1, 5.0, 9.0), paths, need=NEED, chosen_by="geometry")
    assert alone.geometric == alone.failed == 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"passes": np.zeros((2, 3))}, r"passes of shape \(2, 3\)"),
        ({"passes": np.zeros((0, 3, 2))}, "passes of shape"),
        ({"field": Field(np.zeros(3), 0.1, 1.0, 5.0)}, "passes of shape"),
        ({"field": Field(np.zeros((0, 2)), 0.1, 1.0, 5.0)}, "n > 0"),
        ({"field": Field(np.eye(2), 0.1, 1.0, -5.0)}, "battery: found -5.0"),
        ({"chosen_by": "luck"}, "policy: found 'luck', expected one of geometry"),
        ({"need": Need(-1.0)}, "bound_m2"),
    ],
)
def test_bad_input_is_refused(changes, message):
    rng = np.random.default_rng(8)
    given_ = {"field": field(rng, 9), "passes": passes(rng, 1, 3), "need": NEED, **changes}
    with pytest.raises(InputError, match=message):
        lifetime(given_.pop("field"), given_.pop("passes"), **given_)
