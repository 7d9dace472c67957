"""Noise statistics from tests at known distances, Wang 3.1: closed forms, honesty, bad input."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from trackfield.errors import InputError
from trackfield.sensing.range_statistics import (
    RangeTests,
    model,
    noise_statistics,
    sample_statistics,
)

WANG = np.array([-0.0386, 0.0174, 7.97e-5, 2.916e-4])  # mu_n, mu_g, var_n, var_g
NAMES = ("bias_m", "scale", "variance_m2", "variance_scale")
ERRORS = ("bias_error_m", "scale_error", "variance_error_m2", "variance_scale_error")


def drawn(rng, r, count, truth=WANG):
    v = truth[2] + truth[3] * r**2
    means = r * (1 + truth[1]) + truth[0] + np.sqrt(v / count) * rng.normal(size=len(r))
    variances = v * rng.chisquare(count - 1, len(r)) / (count - 1)
    return RangeTests(r, means, variances, np.full(len(r), float(count)))


def estimates(method, *, count, runs=600):
    rng = np.random.default_rng(11)
    r = np.linspace(0.3, 2.8, 10)
    found = [noise_statistics(drawn(rng, r, count), method=method) for _ in range(runs)]
    return (
        np.array([[getattr(f, n) for n in NAMES] for f in found]),
        np.array([[getattr(f, n) for n in ERRORS] for f in found]),
    )


@given(st.integers(0, 2**32 - 1), st.integers(2, 12))
def test_paper_mode_is_the_closed_form(seed, m):
    rng = np.random.default_rng(seed)
    r = np.cumsum(rng.uniform(0.2, 1.0, m))
    tests = drawn(rng, r, 20)
    d, s2 = tests.means - r, tests.variances
    D1 = m * np.sum(r**2) - np.sum(r) ** 2
    D2 = m * np.sum(r**4) - np.sum(r**2) ** 2
    expected = [
        (np.sum(r**2) * np.sum(d) - np.sum(r) * np.sum(r * d)) / D1,
        (m * np.sum(r * d) - np.sum(r) * np.sum(d)) / D1,
        (np.sum(r**4) * np.sum(s2) - np.sum(r**2) * np.sum(r**2 * s2)) / D2,
        (m * np.sum(r**2 * s2) - np.sum(r**2) * np.sum(s2)) / D2,
    ]
    found = noise_statistics(tests, method="least squares")
    got = [getattr(found, n) for n in NAMES]
    np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("method", ["weighted", "least squares"])
@pytest.mark.parametrize("counts", [None, np.array([30.0, 50.0, 20.0, 90.0])])
def test_exact_statistics_are_found_exactly(method, counts):
    r = np.array([0.5, 1.0, 2.0, 4.0])
    tests = RangeTests(r, r * 1.02 - 0.1, 1e-4 + 2e-4 * r**2, counts)
    found = noise_statistics(tests, method=method)
    np.testing.assert_allclose([getattr(found, n) for n in NAMES], [-0.1, 0.02, 1e-4, 2e-4])
    assert found.converged


def test_weighted_variances_are_the_nonnegative_weighted_fit_at_their_own_weights():
    rng = np.random.default_rng(12)
    r = np.linspace(0.5, 2.5, 5)
    edges = 0
    for _ in range(40):
        tests = drawn(rng, r, 15)
        found = noise_statistics(tests)
        fitted = found.variance_m2 + found.variance_scale * r**2
        design = np.column_stack([np.ones(5), r**2]) / fitted[:, None]
        oracle, _ = nnls(design, tests.variances / fitted)
        np.testing.assert_allclose(
            [found.variance_m2, found.variance_scale], oracle, rtol=1e-6, atol=1e-12
        )
        edges += found.variance_m2 == 0.0
    assert 0 < edges < 40  # both sides of the constraint were met


def test_weighting_cuts_the_error_of_the_additive_variance_fourfold_and_is_never_negative():
    plain, _ = estimates("least squares", count=100)
    weighted, _ = estimates("weighted", count=100)
    rms_plain, rms = (np.sqrt(np.mean((e - WANG) ** 2, axis=0)) for e in (plain, weighted))
    assert rms_plain[2] / rms[2] > 3.0  # 3.7 measured
    assert (rms < rms_plain).all()
    assert (plain[:, 2] < 0.0).any()
    assert (weighted[:, 2:] >= 0.0).all()


@pytest.mark.parametrize("method", ["weighted", "least squares"])
def test_standard_errors_are_those_of_repetition(method):
    found, errors = estimates(method, count=300)
    np.testing.assert_allclose(errors.mean(axis=0) / found.std(axis=0), 1.0, atol=0.12)
    inside = np.mean(np.abs(found - WANG) < 1.96 * errors, axis=0)
    assert (np.abs(inside - 0.95) < 0.03).all()


def test_without_counts_the_scatter_of_the_tests_tells_the_errors():
    rng = np.random.default_rng(13)
    r = np.linspace(0.3, 2.8, 40)
    tests = drawn(rng, r, 200)
    known, unknown = noise_statistics(tests), noise_statistics(tests._replace(counts=None))
    for name in NAMES:
        assert getattr(unknown, name) == pytest.approx(getattr(known, name), rel=1e-6)
    for name in ERRORS:
        assert getattr(unknown, name) == pytest.approx(getattr(known, name), rel=0.4)
    two = noise_statistics(RangeTests(*(np.asarray(c)[:2] for c in tests[:3])))
    assert [getattr(two, name) for name in ERRORS] == [None] * 4


def test_samples_become_tests_and_a_model():
    rng = np.random.default_rng(14)
    r = np.repeat([1.0, 2.0, 3.0, 5.0], 4000)
    z = r * 1.03 + 0.2 + rng.normal(size=r.size) * np.sqrt(0.01 + 0.0004 * r**2)
    tests = sample_statistics(r, z)
    np.testing.assert_array_equal(tests.counts, 4000.0)
    np.testing.assert_allclose(tests.means[0], z[:4000].mean())
    np.testing.assert_allclose(tests.variances[3], z[-4000:].var(ddof=1))
    found = model(noise_statistics(tests), max_range_m=50.0)
    assert found.bias_m == pytest.approx(0.2, abs=0.01)
    assert found.scale == pytest.approx(0.03, abs=0.004)
    assert found.sigma_m == pytest.approx(0.1, abs=0.01)
    assert found.sigma_scale == pytest.approx(0.02, abs=0.003)
    assert found.max_range_m == 50.0


def test_a_negative_variance_of_the_paper_is_no_noise_in_the_model():
    tests = RangeTests(np.array([1.0, 2.0]), np.array([1.0, 2.0]), np.array([0.001, 0.1]))
    found = noise_statistics(tests, method="least squares")
    assert found.variance_m2 < 0.0
    assert dataclasses.astuple(model(found))[2] == 0.0


def test_noiseless_tests_have_no_variance_and_no_trouble():
    r = np.array([1.0, 2.0, 3.0])
    found = noise_statistics(RangeTests(r, r + 0.1, np.zeros(3), np.full(3, 5.0)))
    assert (found.variance_m2, found.variance_scale) == (0.0, 0.0)
    assert found.bias_m == pytest.approx(0.1)


GOOD = RangeTests(*(np.array([2.0, 3.0]) for _ in range(4)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distances": np.array([1.0, 1.0])}, "distances: found 1"),
        ({"distances": np.array([1.0, 2.0, 3.0])}, "one length"),
        ({"means": np.array([1.0, np.nan])}, "finite"),
        ({"variances": np.array([1.0, -1.0])}, "zero or more"),
        ({"counts": np.array([1.0, 9.0])}, "counts above one"),
        ({"distances": np.array([-1.0, 2.0])}, "zero or more"),
    ],
)
def test_tests_that_cannot_be_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        noise_statistics(GOOD._replace(**change))


def test_samples_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="2 m: one reading"):
        sample_statistics(np.array([1.0, 1.0, 2.0]), np.array([1.0, 1.1, 2.0]))
    with pytest.raises(InputError, match="one length"):
        sample_statistics(np.array([1.0, 1.0]), np.array([1.0]))
