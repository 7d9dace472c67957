"""Bounds of selections: a slow solver of the same relaxation, all sets, any certificate."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

import selection_twin as twin
from trackfield.errors import InputError
from trackfield.scheduling.relaxation import dual_bound, relax
from trackfield.scheduling.selection import select

seeds = st.integers(0, 2**32 - 1)
criteria = st.sampled_from(["A", "D", "E"])
dimensions = st.integers(1, 4)


def field(seed, n, d):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, d)) * np.exp(rng.uniform(-1, 1, n))[:, None]


def some_prior(seed, d):
    root = np.random.default_rng(seed).normal(size=(d, d))
    return 0.3 * root @ root.T


def at_most(criterion, value, bound):
    """Whether a value does not pass the bound; rounding aside."""
    slack = 1e-9 * max(abs(bound), 1.0)
    return value >= bound - slack if criterion == "A" else value <= bound + slack


def slow(g, k, prior, criterion):
    """Best value over shares by sequential quadratic programming; -tr for A."""

    def loss(w):
        return -twin.merit(prior + (g.T * w) @ g, criterion)

    def slope(w):
        roots, axes = np.linalg.eigh(prior + (g.T * w) @ g)
        power = 1.0 / roots**2 if criterion == "A" else 1.0 / roots
        return -(((g @ axes) ** 2) * power).sum(axis=1)

    n = len(g)
    budget = {"type": "eq", "fun": lambda w: w.sum() - k, "jac": lambda w: np.ones(n)}
    options = {"ftol": 1e-13, "maxiter": 500}
    start = np.full(n, k / n)
    solved = minimize(
        loss, start, jac=slope, bounds=[(0, 1)] * n, constraints=budget, options=options
    )
    return -solved.fun


@given(seeds, st.sampled_from(["A", "D"]), dimensions, st.booleans())
def test_value_and_bound_are_those_of_a_slow_solver(seed, criterion, d, with_prior):
    g, k = field(seed, 12, d), d + 1
    prior = some_prior(seed, d) if with_prior else np.zeros((d, d))
    found = relax(g, k, prior=prior, criterion=criterion)
    best = slow(g, k, prior, criterion)
    sign = -1.0 if criterion == "A" else 1.0
    assert sign * found.value == pytest.approx(best, rel=1e-5, abs=1e-5)
    assert found.bound == pytest.approx(found.value, rel=1e-5, abs=1e-5)


@given(seeds, dimensions)
def test_the_smallest_eigenvalue_of_shares_meets_its_bound(seed, d):
    """Equality proves both: every share is feasible and every certificate is a bound."""
    g, prior = field(seed, 20, d), some_prior(seed, d)
    found = relax(g, d + 2, prior=prior, criterion="E")
    reached = np.linalg.eigvalsh(prior + (g.T * found.shares) @ g)[0]
    assert found.value == pytest.approx(reached, rel=1e-9)
    again = dual_bound(g, d + 2, certificate=found.certificate, prior=prior, criterion="E")
    assert found.bound == pytest.approx(again, rel=1e-9)
    assert found.bound == pytest.approx(found.value, rel=1e-4)


@given(seeds, criteria, dimensions, st.booleans(), st.booleans())
def test_no_set_passes_the_bound_of_any_certificate(seed, criterion, d, with_prior, best):
    g, k = field(seed, 8, d), min(d + 1, 4)
    prior = some_prior(seed, d) if with_prior else np.zeros((d, d))
    root = np.random.default_rng(seed + 1).normal(size=(d, d))
    certificate = root @ root.T
    if best:
        certificate = relax(g, k, prior=prior, criterion=criterion).certificate
    bound = dual_bound(g, k, certificate=certificate, prior=prior, criterion=criterion)
    sign = -1.0 if criterion == "A" else 1.0
    for chosen in itertools.combinations(range(8), k):
        assert at_most(criterion, sign * twin.value(g, chosen, prior, criterion), bound)


@given(seeds, criteria, st.sampled_from([30, 700]), st.integers(2, 3))
def test_shares_are_shares_and_reach_at_least_what_a_set_does(seed, criterion, n, d):
    g, k = field(seed, n, d), 6
    found = relax(g, k, criterion=criterion)
    assert found.shares.min() >= 0.0
    assert found.shares.max() <= 1.0
    assert found.shares.sum() == pytest.approx(k, rel=1e-3)
    assert at_most(criterion, found.value, found.bound)
    chosen = select(g, k, criterion=criterion)
    assert at_most(criterion, chosen.value, found.bound)
    assert at_most(criterion, chosen.value, found.value + (-1 if criterion == "A" else 1) * 1e-3)
    again = dual_bound(g, k, certificate=found.certificate, criterion=criterion)
    assert found.bound == pytest.approx(again, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
def test_a_few_hundred_candidates_bound_thousands_as_all_do(criterion):
    g = field(3, 3000, 3)
    found = relax(g, 6, criterion=criterion)
    some = np.flatnonzero(found.shares > 1e-4)
    assert len(some) < 20
    alone = relax(g[some], 6, criterion=criterion)
    assert alone.value == pytest.approx(found.value, rel=1e-4)
    assert found.bound == pytest.approx(found.value, rel=1e-4)


def test_equal_sensors_all_around_reach_the_tight_frame():
    angles = np.pi * np.arange(12) / 12
    g = np.column_stack([np.cos(angles), np.sin(angles)])
    for criterion, value in (("A", 4.0 / 6.0), ("D", 2 * np.log(3.0)), ("E", 3.0)):
        assert relax(g, 6, criterion=criterion).bound == pytest.approx(value, rel=1e-6)
        bound = dual_bound(g, 6, certificate=np.eye(2), criterion=criterion)
        assert bound == pytest.approx(value, rel=1e-12)


def test_where_nothing_is_to_choose_the_bound_is_the_value():
    g = field(5, 3, 2)
    for criterion in ("A", "D", "E"):
        found = relax(g, 7, criterion=criterion)
        assert found.shares.tolist() == [1.0, 1.0, 1.0]
        again = dual_bound(g, 7, certificate=found.certificate, criterion=criterion)
        assert again == pytest.approx(found.value, rel=1e-9)
    nobody = relax(np.empty((0, 2)), 2, prior=np.eye(2))
    assert nobody.bound == 2.0


def test_without_any_information_the_bound_says_so():
    silent, eye = np.zeros((3, 2)), np.eye(2)
    bounds = [dual_bound(silent, 2, certificate=eye, criterion=c) for c in ("A", "D", "E")]
    assert bounds == [np.inf, -np.inf, 0.0]


@pytest.mark.parametrize(
    ("certificate", "criterion", "words"),
    [
        (np.zeros((2, 2)), "A", "expected positive ones"),
        (np.diag([1.0, 0.0]), "D", "expected positive ones"),
        (np.eye(3), "A", r"shape \(3, 3\)"),
        (np.eye(2), "G", "one of A, D, E"),
    ],
)
def test_what_is_no_certificate_is_refused(certificate, criterion, words):
    with pytest.raises(InputError, match=words):
        dual_bound(np.eye(2), 1, certificate=certificate, criterion=criterion)
