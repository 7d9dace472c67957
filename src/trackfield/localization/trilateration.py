"""Position from squared ranges by linear algebra: Pham (2.4)-(2.5) and (3.13)-(3.15), corrected.

Differences of squared ranges are linear in the position. They lose one degree of freedom, so even
their best combination stays above the bound of the ranges themselves; `range_mle` does not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.linalg import UNKNOWN_VARIANCE
from trackfield.localization.bounds import range_bound
from trackfield.sensing.range import RangeModel, distance
from trackfield.types import Matrix, Vector

FLAT = 1e-12  # sensors span a direction if their spread there is this part of the largest, squared


class PairSystem(NamedTuple):
    """Linear equations A T = r of all pairs i < j: `matrix` A (M, d), `right` r (M,)."""

    matrix: Matrix
    right: Vector


class Trilateration(NamedTuple):
    """Position (d,) [m] and its covariance (d, d) [m^2].

    `determined` is false where the sensors leave a direction free; its variance is huge then.
    """

    position: Vector
    covariance: Matrix
    determined: bool


class Traces(NamedTuple):
    """Trace of the covariance over sigma^2, to first order in sigma, of three estimators."""

    ordinary: float
    blue: float
    crlb: float


def pair_system(sensors: Matrix, ranges: Vector) -> PairSystem:
    """Rows 2 (c_i - c_j)' and |c_i|^2 - |c_j|^2 - d_i^2 + d_j^2 over i < j, Pham (2.4), corrected.

    `sensors` (n, d) [m], `ranges` (n,) [m]; M = n (n - 1) / 2 rows.
    """
    c, d = _checked(sensors, ranges)
    i, j = np.triu_indices(len(c), 1)
    lifted = np.sum(c**2, axis=1) - d**2
    return PairSystem(2.0 * (c[i] - c[j]), lifted[i] - lifted[j])


def ordinary(sensors: Matrix, ranges: Vector, *, sigma_m: float | Vector = 0.15) -> Trilateration:
    """Least squares over all pairs, Pham (2.5), in O(n).

    It equals the regression of (|c|^2 - d^2)/2 on c, both centred. The covariance, Pham (3.13), is
    exact for ranges with independent errors N(0, sigma_m^2), at the measured distances.
    """
    c, d = _checked(sensors, ranges)
    return _regression(c, d, _half_square_variance(d, sigma_m), np.ones_like(d))


def blue(sensors: Matrix, ranges: Vector, *, sigma_m: float | Vector = 0.15) -> Trilateration:
    """Best linear unbiased estimate from squared ranges, in O(n).

    The covariance of the pairs is singular; what it weighs is the regression of (|c|^2 - d^2)/2 on
    c with a free intercept and weights 1/v, v = d^2 s^2 + s^4/2.
    """
    c, d = _checked(sensors, ranges)
    v = _half_square_variance(d, sigma_m)
    return _regression(c, d, v, 1.0 / v)


def pair_covariance(sensors: Matrix, position: Vector, *, sigma_m: float | Vector) -> Matrix:
    """Covariance Phi (M, M) [m^4] of the pairs' right sides, Pham (3.14)-(3.15), corrected, exact.

    Variance 4 s^2 (d_i^2 + d_j^2) + 4 s^4; pairs that share i: +-(4 d_i^2 s^2 + 2 s^4), + where i
    has the same sign in both; others 0.
    """
    i, j = np.triu_indices(len(sensors), 1)
    signs = np.zeros((len(i), len(sensors)))
    signs[np.arange(len(i)), i] = -1.0
    signs[np.arange(len(i)), j] = 1.0
    square_variance = 4.0 * _half_square_variance(distance(sensors, position), sigma_m)
    return (signs * square_variance) @ signs.T


def ordinary_covariance(
    sensors: Matrix, position: Vector, *, sigma_m: float | Vector, first_order: bool = False
) -> Matrix:
    """Covariance Theta (d, d) [m^2] of `ordinary` at a true `position` (d,), Pham (3.13), exact.

    `first_order` leaves out the terms in sigma^4.
    """
    d = distance(sensors, position)
    v = _half_square_variance(d, sigma_m, first_order=first_order)
    return _regression(sensors, d, v, np.ones_like(d)).covariance


def blue_covariance(
    sensors: Matrix, position: Vector, *, sigma_m: float | Vector, first_order: bool = False
) -> Matrix:
    """Covariance (d, d) [m^2] of `blue` at a true `position` (d,); `first_order` as above."""
    d = distance(sensors, position)
    v = _half_square_variance(d, sigma_m, first_order=first_order)
    return _regression(sensors, d, v, 1.0 / np.maximum(v, 1e-12 * v.max())).covariance


def traces(sensors: Matrix, position: Vector) -> Traces:
    """Compare `ordinary`, `blue` and the bound of ranges with equal errors at `position` (d,)."""
    three = (
        ordinary_covariance(sensors, position, sigma_m=1.0, first_order=True),
        blue_covariance(sensors, position, sigma_m=1.0, first_order=True),
        range_bound(sensors, position, models=RangeModel(sigma_m=1.0)).covariance,
    )
    return Traces(*(float(np.trace(covariance)) for covariance in three))


def _checked(sensors: Matrix, ranges: Vector) -> tuple[Matrix, Vector]:
    c, d = np.asarray(sensors, float), np.asarray(ranges, float)
    if c.ndim != 2 or d.shape != (len(c),) or len(c) < 2:
        raise InputError(
            f"sensors of shape {c.shape} and ranges of shape {d.shape}: expected (n, d) and (n,), "
            "n >= 2"
        )
    if not (np.isfinite(c).all() and np.isfinite(d).all() and (d >= 0.0).all()):
        raise InputError("sensors must be finite, and ranges finite and not negative")
    return c, d


def _half_square_variance(
    d: Vector, sigma_m: float | Vector, *, first_order: bool = False
) -> Vector:
    """Variance d^2 s^2 + s^4/2 of half a squared range."""
    s2 = np.square(sigma_m)
    return d**2 * s2 + (0.0 if first_order else 0.5 * s2**2)


def _regression(c: Matrix, d: Vector, variances: Vector, weights: Vector) -> Trilateration:
    """Regression of (|c|^2 - d^2)/2 on c with free intercept, for values of these variances.

    Centring first keeps the digits that far coordinates would cost.
    """
    weights = weights / weights.sum()
    middle = weights @ c
    x = c - middle
    y = 0.5 * (np.sum(x**2, axis=1) - d**2)
    roots, axes = np.linalg.eigh(x.T @ (x * weights[:, None]))
    free = roots <= FLAT * roots[-1]
    seen, unseen = axes[:, ~free], axes[:, free]
    slope = (seen / roots[~free]) @ seen.T @ (x * weights[:, None]).T
    covariance = (slope * variances) @ slope.T + UNKNOWN_VARIANCE * unseen @ unseen.T
    return Trilateration(middle + slope @ (y - weights @ y), covariance, not free.any())
