"""Small dense algebra: against NumPy and SciPy, and what happens where there is no answer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from trackfield import linalg

sizes = st.integers(1, 6)
seeds = st.integers(0, 2**32 - 1)


def definite(rng, n, *, count=3):
    A = rng.normal(size=(count, n, n + 2))
    return A @ np.swapaxes(A, -1, -2)


@given(seeds, sizes)
def test_solve_meets_its_equations(seed, n):
    rng = np.random.default_rng(seed)
    P, b = definite(rng, n), rng.normal(size=(3, n, 2))
    x, ok = linalg.solve(P, b)
    assert ok.all()
    np.testing.assert_allclose(P @ x, b, atol=1e-6 * np.abs(x).max() * np.abs(P).max())


def test_a_failure_is_a_flag_for_its_own_item_and_never_nan():
    rng = np.random.default_rng(1)
    P = definite(rng, 3, count=5)
    P[1] = -np.eye(3)
    P[2] = np.nan
    P[3] = np.diag([1.0, 0.0, 2.0])
    x, ok = linalg.solve(P, np.ones((5, 3, 1)))
    assert ok.tolist() == [True, False, False, False, True]
    assert (x[1:4] == 0.0).all()
    np.testing.assert_allclose(P[[0, 4]] @ x[[0, 4]], 1.0)
    distance2, ok = linalg.mahalanobis2(np.ones((5, 3)), P)
    assert ok.tolist() == [True, False, False, False, True]
    assert np.isfinite(distance2).all()
    assert np.isfinite(linalg.cholesky(P).value).all()


def test_the_column_wise_cholesky_equals_lapack():
    P = definite(np.random.default_rng(2), 5, count=4)
    with_a_failure = np.concatenate([P, -np.eye(5)[None]])  # sends the whole stack that way
    lower, ok = linalg.cholesky(with_a_failure)
    np.testing.assert_allclose(lower[:4], np.linalg.cholesky(P), rtol=1e-12, atol=1e-12)
    assert ok.tolist() == [True] * 4 + [False]


@given(seeds, sizes)
def test_square_root_squares_to_the_covariance_even_if_singular(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(2, n, max(n - 1, 1)))
    P = A @ np.swapaxes(A, -1, -2)
    P[0] += np.eye(n)
    S = linalg.square_root(P)
    np.testing.assert_allclose(S @ np.swapaxes(S, -1, -2), P, atol=1e-9 * (1 + np.abs(P).max()))


def test_covariance_of_full_information_is_its_inverse():
    J = definite(np.random.default_rng(3), 3)
    covariance, ok = linalg.covariance_of(J)
    assert ok.all()
    np.testing.assert_allclose(covariance, np.linalg.inv(J), rtol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_covariance_of_a_free_direction_is_huge_and_finite_and_says_so(scale):
    u = np.array([0.6, 0.8])
    covariance, ok = linalg.covariance_of(scale * np.outer(u, u))
    assert not ok
    np.testing.assert_allclose(u @ covariance @ u, 1.0 / scale, rtol=1e-3)
    across = np.array([-0.8, 0.6])
    assert across @ covariance @ across == pytest.approx(min(1e12, 1e12 / scale), rel=1e-3)
    nothing, ok = linalg.covariance_of(np.zeros((2, 2)))
    assert not ok
    np.testing.assert_allclose(nothing, 1e12 * np.eye(2))


@given(seeds, sizes)
def test_mahalanobis_is_the_quadratic_form(seed, n):
    rng = np.random.default_rng(seed)
    P, e = definite(rng, n), rng.normal(size=(3, n))
    expected = np.einsum("bi,bij,bj->b", e, np.linalg.inv(P), e)
    np.testing.assert_allclose(linalg.mahalanobis2(e, P).value, expected, rtol=1e-5)


@pytest.mark.parametrize("degrees", [1, 2, 3, 10])
@pytest.mark.parametrize("probability", [0.5, 0.95, 0.9999])
def test_gate_is_the_chi_square_quantile(degrees, probability):
    assert linalg.gate(probability, degrees) == pytest.approx(chi2.ppf(probability, degrees))
    several = linalg.gate(probability, np.array([degrees, degrees + 1]))
    assert several.shape == (2,)
    assert several[0] == linalg.gate(probability, degrees)
