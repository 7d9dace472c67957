"""Selection over a predicted distribution: plain means, and the errors that a posterior has."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import selection_twin as twin
from trackfield.errors import InputError
from trackfield.localization.information import reading_gains
from trackfield.scheduling.expected import (
    expected_values,
    hearings,
    places,
    select_expected,
)
from trackfield.scheduling.selection import select
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

seeds = st.integers(0, 2**32 - 1)
criteria = st.sampled_from(["A", "D", "E"])


def field(seed, s, n, d):
    """Gains at places, a third of them unheard, with weights and a prior."""
    rng = np.random.default_rng(seed)
    gains = rng.normal(size=(s, n, d)) * (rng.random((s, n)) < 0.67)[..., None]
    root = rng.normal(size=(d, d))
    return gains, rng.random(s), 0.1 * np.eye(d) + 0.1 * root @ root.T


def mean_merit(gains, chosen, weights, prior, criterion):
    values = [twin.value(g, chosen, prior, criterion) for g in gains]
    return float(np.average(values, weights=weights))


@settings(max_examples=40)
@given(seeds, criteria, st.integers(1, 3), st.integers(1, 5))
def test_the_best_of_all_sets_for_all_places(seed, criterion, d, s):
    gains, weights, prior = field(seed, s, 7, d)
    found = select_expected(gains, 3, weights=weights, prior=prior, criterion=criterion)
    best = max(
        mean_merit(gains, chosen, weights, prior, criterion)
        for chosen in itertools.combinations(range(7), 3)
    )
    assert found.optimal
    assert (-1 if criterion == "A" else 1) * found.value == pytest.approx(best, rel=1e-9, abs=1e-12)


@settings(max_examples=20)
@given(seeds, st.sampled_from(["A", "D"]))
def test_no_exchange_of_one_sensor_helps(seed, criterion):
    gains, weights, prior = field(seed, 4, 30, 2)
    found = select_expected(gains, 4, weights=weights, prior=prior, criterion=criterion)
    assert not found.optimal
    reached = mean_merit(gains, found.sensors.tolist(), weights, prior, criterion)
    for place, i in itertools.product(range(4), set(range(30)) - set(found.sensors.tolist())):
        others = found.sensors.tolist()
        others[place] = i
        other = mean_merit(gains, others, weights, prior, criterion)
        assert other <= reached + 1e-9 * abs(reached)


@given(seeds, criteria)
def test_at_one_place_it_is_the_selection_for_that_place(seed, criterion):
    gains, _, prior = field(seed, 1, 9, 2)
    found = select_expected(gains, 3, weights=np.ones(1), prior=prior, criterion=criterion)
    alone = select(gains[0], 3, prior=prior, criterion=criterion)
    assert found.value == pytest.approx(alone.value, rel=1e-9)
    assert found.pooled == pytest.approx(found.value, rel=1e-9)


@given(seeds, criteria, st.integers(1, 3))
def test_pooled_information_promises_more(seed, criterion, d):
    gains, weights, prior = field(seed, 5, 3, d)
    mean, pooled = expected_values(gains, weights=weights, prior=prior, criterion=criterion)
    sign = -1.0 if criterion == "A" else 1.0
    assert sign * pooled >= sign * mean - 1e-9 * abs(mean)


@given(seeds, st.integers(1, 3), st.integers(3, 6))
def test_places_have_the_moments_of_the_belief(seed, d, order):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(d, d))
    belief = Gaussian(rng.normal(size=d), root @ root.T + 0.1 * np.eye(d))
    at, weights = places(belief, order=order)
    assert at.shape == (order**d, d)
    assert weights.min() > 0.0
    mean = weights @ at
    np.testing.assert_allclose(mean, belief.mean, atol=1e-9)
    np.testing.assert_allclose(
        (at - mean).T @ ((at - mean) * weights[:, None]), belief.covariance, atol=1e-9
    )
    fourth = weights @ (at[:, 0] - mean[0]) ** 4
    assert fourth == pytest.approx(3.0 * belief.covariance[0, 0] ** 2, rel=1e-9)


def test_who_hears_is_drawn_with_its_probability():
    gains = np.ones((2, 3, 2))
    p = np.array([[0.0, 0.3, 1.0], [0.6, 0.5, 0.0]])
    drawn = hearings(gains, p, draws=4000, rng=np.random.default_rng(5))
    assert drawn.shape == (8000, 3, 2)
    share = (drawn[..., 0] > 0.0).reshape(2, 4000, 3).mean(axis=1)
    np.testing.assert_allclose(share, p, atol=0.03)
    assert (drawn[..., 0] == drawn[..., 1]).all()


class Edge:
    """A target that is known to 1.5 m, sensors of .1 m noise that reach 4 m, near and far."""

    belief = Gaussian(np.zeros(2), 2.25 * np.eye(2))
    model = RangeModel(sigma_m=0.1, max_range_m=4.0)

    def __init__(self, seed, n=10):
        rng = np.random.default_rng(seed)
        r, angle = rng.uniform(1.0, 3.95, n), rng.uniform(-np.pi, np.pi, n)
        self.sensors = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
        self.prior = np.linalg.inv(self.belief.covariance)

    def gains(self, at):
        return reading_gains(self.model, self.sensors, at)

    def error2(self, chosen, rng, runs=150):
        """Mean squared error of the posterior mean; silence of a sensor counts too."""
        cloud = 1.5 * rng.normal(size=(4000, 2))
        r_cloud = np.linalg.norm(cloud[:, None] - self.sensors[chosen], axis=2)
        total = 0.0
        for truth in 1.5 * rng.normal(size=(runs, 2)):
            r = np.linalg.norm(truth - self.sensors[chosen], axis=1)
            z = r + 0.1 * rng.normal(size=r.size)
            fit = -0.5 * ((z - r_cloud) / 0.1) ** 2
            near = r <= 4.0
            log = np.where(near, np.where(r_cloud <= 4.0, fit, -1e3), -1e3 * (r_cloud <= 4.0))
            log = log.sum(axis=1)
            weight = np.exp(log - log.max())
            total += float(((weight @ cloud / weight.sum() - truth) ** 2).sum())
        return total / runs


def test_sensors_for_the_whole_belief_beat_those_for_its_middle_and_the_mean_is_nearer_the_truth():
    """Errors are of the posterior mean on a cloud, which knows nothing of Fisher's information."""
    rng = np.random.default_rng(8)
    middle, whole, mean, pooled = [], [], [], []
    for seed in range(12):
        edge = Edge(seed)
        at, weights = places(edge.belief, order=9)
        found = select_expected(edge.gains(at), 3, weights=weights, prior=edge.prior)
        alone = select(edge.gains(edge.belief.mean), 3, prior=edge.prior)
        middle.append(edge.error2(alone.sensors, rng))
        whole.append(edge.error2(found.sensors, rng))
        mean.append(found.value)
        pooled.append(found.pooled)
    assert np.mean(whole) < 0.9 * np.mean(middle)
    assert abs(np.mean(mean) - np.mean(whole)) < abs(np.mean(pooled) - np.mean(whole))
    assert np.mean(pooled) < 0.5 * np.mean(whole)


def test_the_chance_of_silence_is_told():
    gains = np.zeros((4, 3, 2))
    gains[0, 0] = gains[1, 1] = 1.0
    found = select_expected(
        gains, 2, weights=np.array([1.0, 1.0, 1.0, 5.0]), prior=np.eye(2), criterion="D"
    )
    assert found.sensors.tolist() == [0, 1]
    assert found.silent == pytest.approx(0.75)
    everybody = select_expected(gains, 9, weights=np.ones(4), prior=np.eye(2))
    assert len(everybody.sensors) == 3
    assert everybody.optimal
    nobody = select_expected(np.zeros((1, 0, 2)), 2, weights=np.ones(1), prior=np.eye(2))
    assert nobody.value == 2.0
    assert nobody.silent == 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gains": np.ones((3, 2))}, r"expected \(s, n, d\)"),
        ({"gains": np.full((2, 3, 2), np.inf)}, "finite"),
        ({"weights": np.ones(3)}, r"expected \(s, n, d\) and \(s,\)"),
        ({"weights": np.array([1.0, -0.5])}, "probabilities"),
        ({"weights": np.zeros(2)}, "probabilities"),
        ({"prior": np.diag([1.0, 0.0])}, "positive definite"),
        ({"k": 0}, "at least 1"),
        ({"criterion": "B"}, "one of A, D, E"),
    ],
)
def test_what_cannot_be_used_is_refused(change, words):
    given_all = {"gains": np.ones((2, 3, 2)), "k": 2, "weights": np.ones(2), "prior": np.eye(2)}
    with pytest.raises(InputError, match=words):
        select_expected(**{**given_all, **change})


def test_bad_orders_and_probabilities_are_refused():
    with pytest.raises(InputError, match="order: found 0"):
        places(Gaussian(np.zeros(2), np.eye(2)), order=0)
    with pytest.raises(InputError, match="not from 0 to 1"):
        hearings(np.ones((1, 2, 2)), np.array([[0.5, 1.5]]), draws=2, rng=np.random.default_rng(1))
