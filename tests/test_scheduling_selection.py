"""Selection of sensors: all sets in plain Python, laws, fields that say too little."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import selection_twin as twin
from trackfield._core import _selection
from trackfield.errors import InputError
from trackfield.linalg import UNKNOWN_VARIANCE, covariance_of
from trackfield.scheduling.criteria import FINE, known, rescaled
from trackfield.scheduling.relaxation import dual_bound, relax
from trackfield.scheduling.selection import select

seeds = st.integers(0, 2**32 - 1)
criteria = st.sampled_from(["A", "D", "E"])
dimensions = st.integers(1, 6)


def field(seed, n, d, spread=1.0):
    """Gains of sensors all around, with errors that differ by a factor of e^`spread`."""
    rng = np.random.default_rng(seed)
    g = rng.normal(size=(n, d))
    g /= np.linalg.norm(g, axis=1)[:, None]
    return g * np.exp(rng.uniform(-spread, spread, n))[:, None]


def some_prior(seed, d):
    root = np.random.default_rng(seed).normal(size=(d, d))
    return 0.3 * root @ root.T


@given(seeds, dimensions, criteria, st.integers(1, 9), st.booleans())
def test_a_small_field_has_the_best_of_all_sets(seed, d, criterion, k, with_prior):
    g = field(seed, 9, d)
    k = k if with_prior else max(k, d)
    prior = some_prior(seed, d) if with_prior else np.zeros((d, d))
    found = select(g, k, prior=prior, criterion=criterion)
    best = twin.value(g, twin.best(g, k, prior, criterion), prior, criterion)
    assert found.optimal
    assert found.determined
    assert found.sensors.tolist() == sorted(set(found.sensors.tolist()))
    assert len(found.sensors) == k
    sign = -1.0 if criterion == "A" else 1.0
    assert sign * found.value == pytest.approx(best, rel=1e-9, abs=1e-9)


@given(seeds, st.integers(2, 4), criteria)
def test_sensors_that_say_nothing_and_twins_hide_nobody(seed, d, criterion):
    """Sets that differ by nothing have the same value to the bit, where comparisons turn."""
    g = field(seed, 9, d)
    g[[1, 4]] = 0.0
    g[5] = g[2]
    prior = some_prior(seed, d)
    found = select(g, 3, prior=prior, criterion=criterion)
    best = twin.value(g, twin.best(g, 3, prior, criterion), prior, criterion)
    assert (-1 if criterion == "A" else 1) * found.value == pytest.approx(best, rel=1e-9, abs=1e-9)


@given(seeds, st.integers(2, 6), st.sampled_from(["A", "D"]))
def test_exchanges_are_those_of_the_twin(seed, d, criterion):
    g, nothing = field(seed, 60, d), np.zeros((d, d))
    code = "AD".index(criterion)
    found = _selection.exchanged(g[None], nothing[None], np.ones(1), d + 2, code, FINE)
    assert tuple(sorted(found)) == twin.exchanged(g, d + 2, nothing, criterion)


@given(seeds, st.integers(2, 4), criteria)
def test_the_tree_has_the_best_of_all_sets_too(seed, d, criterion):
    g = field(seed, 14, d)
    found, nothing = select(g, 6, criterion=criterion), np.zeros((d, d))
    best = twin.value(g, twin.best(g, 6, nothing, criterion), nothing, criterion)
    assert found.way == "tree"
    assert found.optimal
    assert (-1 if criterion == "A" else 1) * found.value == pytest.approx(best, rel=1e-9)


@given(seeds, st.integers(2, 4), criteria, st.sampled_from([8, 60]))
def test_no_exchange_of_one_sensor_helps(seed, d, criterion, n):
    g = field(seed, n, d)
    prior = some_prior(seed, d)
    chosen = select(g, 4, prior=prior, criterion=criterion).sensors.tolist()
    reached = twin.value(g, chosen, prior, criterion)
    for place in range(4):
        kept = chosen[:place] + chosen[place + 1 :]
        others = [twin.value(g, [*kept, i], prior, criterion) for i in set(range(n)) - set(chosen)]
        assert max(others) <= reached + 1e-9 * abs(reached)


@given(seeds, criteria)
def test_more_sensors_and_better_ones_are_never_worse(seed, criterion):
    g = field(seed, 9, 3)
    sign = -1.0 if criterion == "A" else 1.0
    values = [sign * select(g, k, criterion=criterion).value for k in (3, 4, 5)]
    assert values[0] <= values[1] <= values[2]
    better = sign * select(1.1 * g, 4, criterion=criterion).value
    assert better > values[1]


def test_sensors_all_around_are_chosen_and_the_trace_is_that_of_a_tight_frame():
    angles = np.pi * np.arange(60) / 60
    g = np.column_stack([np.cos(angles), np.sin(angles)]) / 0.1
    found = select(g, 3)
    assert np.diff(found.sensors).tolist() == [20, 20]
    assert found.value == pytest.approx(4.0 / 3.0 * 0.01)
    np.testing.assert_allclose(found.covariance, np.eye(2) * 0.01 * 2.0 / 3.0, atol=1e-15)


@given(seeds, st.integers(1, 5), st.integers(1, 6))
def test_what_is_known_is_the_covariance_of_the_information(seed, d, k):
    g, prior = field(seed, k, d), 1e-3 * some_prior(seed, d)
    for p in (prior, 0.0 * prior):
        there = known(g, prior=p)
        solved = covariance_of(p + g.T @ g)
        largest = np.abs(solved.value).max()
        np.testing.assert_allclose(there.covariance, solved.value, atol=1e-9 * largest)
        assert (len(there.missing) == 0) == solved.ok
        np.testing.assert_allclose(there.missing @ g.T, 0.0, atol=1e-5)
    inverse = np.linalg.inv(prior + g.T @ g)
    values = [known(g, prior=prior, criterion=criterion).value for criterion in "ADE"]
    wanted = [np.trace(inverse), -np.linalg.slogdet(inverse)[1], 1 / np.linalg.norm(inverse, 2)]
    np.testing.assert_allclose(values, wanted, rtol=1e-6)


@pytest.mark.parametrize("n", [8, 200])
def test_sensors_in_one_line_say_which_direction_is_missing_and_know_the_other_best(n):
    strength = np.random.default_rng(4).uniform(1.0, 2.0, n)
    u = np.array([0.6, 0.8])
    found = select(strength[:, None] * u, 3)
    assert not found.determined
    np.testing.assert_allclose(np.abs(found.missing @ [[0.8], [-0.6]]), 1.0, rtol=1e-9)
    best = np.sort(strength)[-3:]
    assert sorted(strength[found.sensors]) == best.tolist()
    assert u @ found.covariance @ u == pytest.approx(1.0 / (best**2).sum(), rel=1e-2)
    assert found.value == pytest.approx(min(UNKNOWN_VARIANCE, 1e12 / (best**2).sum()), rel=1e-6)


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
def test_too_few_for_all_directions_take_the_best_there_is(criterion):
    g = np.array([[1.0, 0, 0], [0, 3.0, 0], [0, 0, 2.0], [0.9, 0.1, 0]])
    found = select(g, 2, criterion=criterion)
    assert len(found.missing) == 1
    assert found.sensors.tolist() == [1, 2]
    assert np.isfinite(found.covariance).all()
    with_prior = select(g, 2, prior=np.eye(3), criterion=criterion)
    assert with_prior.determined


def test_fewer_sensors_than_asked_for_are_all_taken():
    g = np.eye(2)
    found = select(g, 5)
    assert found.sensors.tolist() == [0, 1]
    assert found.optimal
    assert found.value == pytest.approx(2.0)
    nobody = select(np.empty((0, 2)), 3, prior=np.diag([4.0, 1.0]))
    assert nobody.sensors.size == 0
    assert nobody.value == pytest.approx(1.25)
    assert select(np.empty((0, 2)), 3).missing.shape == (2, 2)
    silent = select(np.zeros((3, 2)), 2)
    assert len(silent.sensors) == 2
    assert len(silent.missing) == 2


def test_the_criterion_is_the_value_reported():
    g = field(7, 30, 2)
    at = {criterion: select(g, 3, criterion=criterion) for criterion in "ADE"}
    M = {criterion: g[found.sensors].T @ g[found.sensors] for criterion, found in at.items()}
    assert at["A"].value == pytest.approx(np.trace(np.linalg.inv(M["A"])))
    assert at["D"].value == pytest.approx(np.linalg.slogdet(M["D"])[1])
    assert at["E"].value == pytest.approx(np.linalg.eigvalsh(M["E"])[0])


@pytest.mark.parametrize(
    ("gains", "k", "extra", "words"),
    [
        (np.ones(3), 1, {}, r"shape \(3,\): expected \(n, d\)"),
        (np.ones((3, 7)), 1, {}, "d from 1 to 6"),
        (np.ones((3, 2)), 0, {}, "found 0, expected at least 1"),
        (np.array([[1.0, 2.0], [np.nan, 0.0]]), 1, {}, r"sensor 1: found \[nan, 0.0\]"),
        (np.ones((3, 2)), 1, {"prior": np.eye(3)}, r"prior of shape \(3, 3\)"),
        (np.ones((3, 2)), 1, {"prior": np.full((2, 2), np.inf)}, "expected finite"),
        (np.ones((3, 2)), 1, {"prior": np.array([[1.0, 0.5], [0.0, 1.0]])}, "symmetric"),
        (np.ones((3, 2)), 1, {"prior": -np.eye(2)}, "positive semidefinite"),
        (np.ones((3, 2)), 1, {"criterion": "F"}, "found 'F', expected one of A, D, E"),
    ],
)
def test_what_cannot_be_used_is_refused(gains, k, extra, words):
    with pytest.raises(InputError, match=words):
        select(gains, k, **extra)


def test_the_way_is_told_and_the_certificate_where_there_is_a_bound():
    few, many = select(field(1, 24, 2), 3), select(field(1, 1000, 2), 6)
    assert few.way == "enumeration"
    assert few.optimal
    assert (few.ratio, few.bound, few.certificate) == (1.0, few.value, None)
    assert many.way == "tree"
    assert many.optimal
    assert 1.0 <= many.ratio < 1.05
    again = dual_bound(field(1, 1000, 2), 6, certificate=many.certificate)
    assert many.bound == pytest.approx(again, rel=1e-9)


def test_where_thousands_are_alike_the_tree_is_given_up_and_the_bound_says_it_does_not_matter():
    found = select(field(2, 2000, 3, spread=0.0), 6)
    assert found.way == "exchanges"
    assert not found.optimal
    assert found.ratio < 1.002


@given(seeds, criteria, st.sampled_from([1e-2, 1e6, 1e12, 1e35]), st.sampled_from([9, 60]))
def test_a_change_of_units_changes_no_sensor(seed, criterion, unit, n):
    g, prior = field(seed, n, 3), some_prior(seed, 3)
    here = select(g, 4, prior=prior, criterion=criterion)
    there = select(unit * g, 4, prior=unit**2 * prior, criterion=criterion)
    again = rescaled(there.bound, unit, criterion=criterion, d=3)
    assert again == pytest.approx(here.bound, rel=1e-4, abs=1e-4)  # as near as it is sought
    value = rescaled(there.value, unit, criterion=criterion, d=3)
    if here.optimal and there.optimal:
        assert value == pytest.approx(here.value, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
@pytest.mark.parametrize("scale", [1e-300, 1e-100, 1e-40, 1e-10, 9e38])
@pytest.mark.parametrize("n", [10, 40, 400])
def test_numbers_of_any_size_give_numbers(criterion, scale, n):
    g = scale * field(9, n, 3, spread=10.0) / np.exp(10.0)
    for prior in (np.zeros((3, 3)), np.eye(3), 1e-30 * np.eye(3), 1e60 * np.eye(3)):
        found = select(g, 4, prior=prior, criterion=criterion)
        relaxed = relax(g, 4, prior=prior, criterion=criterion)
        assert len(found.sensors) == 4
        assert np.isfinite([found.value, found.bound, found.ratio, relaxed.value]).all()
        assert np.isfinite(relaxed.bound)
        assert np.isfinite(found.covariance).all()
        assert np.isfinite(relaxed.shares).all()
