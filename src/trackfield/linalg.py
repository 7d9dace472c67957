"""Small dense algebra on symmetric matrices, in stacks; a failure is a flag, never a NaN."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from trackfield.types import Matrix, Vector

UNKNOWN_VARIANCE = 1e12
"""Variance of a direction about which nothing is known, (1000 km)^2 for positions [m^2]."""


class Solved(NamedTuple):
    """What came out, and where: `value` is zero in the items of the stack where `ok` is false."""

    value: Matrix
    ok: NDArray[np.bool_]


def cholesky(matrix: Matrix) -> Solved:
    """Lower triangles L, L L' = `matrix` (..., n, n); `ok` (...) is false where there is none.

    L is the identity, not zero, where `ok` is false, so that it can be divided by.
    """
    try:
        lower = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return _cholesky_by_columns(matrix)
    ok = np.asarray(np.isfinite(lower).all(axis=(-2, -1)))
    return Solved(np.where(ok[..., None, None], lower, np.eye(matrix.shape[-1])), ok)


def solve(matrix: Matrix, right: Matrix) -> Solved:
    """Solve matrix x = right for positive definite (..., n, n) and right sides (..., n, k)."""
    lower, ok = cholesky(matrix)
    half = np.linalg.solve(lower, np.where(ok[..., None, None], right, 0.0))
    value = np.linalg.solve(np.swapaxes(lower, -1, -2), half)
    return Solved(np.asarray(value, np.float64), ok)


def covariance_of(information: Matrix) -> Solved:
    """Inverse of information (..., n, n) that stays finite where a direction has no information.

    Such a direction gets the variance `UNKNOWN_VARIANCE`, or 1e12 times the smallest one if that is
    less, and `ok` is false; the value is a covariance everywhere.
    """
    roots, axes = np.linalg.eigh(information)
    floor = np.maximum(1e-12 * roots[..., -1:], 1.0 / UNKNOWN_VARIANCE)
    variances = 1.0 / np.maximum(roots, floor)
    value = (axes * variances[..., None, :]) @ np.swapaxes(axes, -1, -2)
    ok = np.asarray(roots[..., 0] > floor[..., 0])
    return Solved(0.5 * (value + np.swapaxes(value, -1, -2)), ok)


def square_root(covariance: Matrix) -> Matrix:
    """Find S with S S' = `covariance` (..., n, n), which may be singular; lower where it is not.

    Negative eigenvalues, which only rounding makes, count as zero.
    """
    lower, ok = cholesky(covariance)
    if ok.all():
        return lower
    roots, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(roots, 0.0))[..., None, :]
    return np.where(ok[..., None, None], lower, root)


def mahalanobis2(residual: Vector, covariance: Matrix) -> Solved:
    """Squared distance e' P^-1 e of residuals (..., n) under covariances (..., n, n)."""
    lower, ok = cholesky(covariance)
    white = np.linalg.solve(lower, residual[..., None])[..., 0]
    return Solved(np.where(ok, np.sum(white**2, axis=-1), 0.0), ok)


def gate(probability: float, degrees: int | Vector) -> Vector:
    """Squared distance within which a Gaussian of `degrees` entries lies with `probability`.

    The chi-square quantile, in the shape of `degrees`.
    """
    return np.asarray(2.0 * gammaincinv(np.asarray(degrees) / 2.0, probability), dtype=np.float64)


def _cholesky_by_columns(matrix: Matrix) -> Solved:
    """Cholesky's recursion over all items at once, each failing for itself."""
    n = matrix.shape[-1]
    lower = np.zeros_like(matrix)
    ok = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))
    clean = np.where(ok[..., None, None], matrix, np.eye(n))
    for j in range(n):
        pivot = clean[..., j, j] - np.sum(lower[..., j, :j] ** 2, axis=-1)
        ok = np.asarray(ok & (pivot > 0.0))
        root = np.sqrt(np.where(ok, pivot, 1.0))
        inner = (lower[..., j + 1 :, :j] @ lower[..., j, :j, None])[..., 0]
        lower[..., j, j] = root
        lower[..., j + 1 :, j] = (clean[..., j + 1 :, j] - inner) / root[..., None]
    return Solved(np.where(ok[..., None, None], lower, np.eye(n)), ok)
