"""Bias, scale and noise of range sensors from tests at known distances, Wang 3.1."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.range import RangeModel
from trackfield.types import Vector

Method = Literal["weighted", "least squares"]
ROUNDS = 100


class RangeTests(NamedTuple):
    """Tests at m known distances, (m,) each: distance [m], sample mean [m], variance [m^2], count.

    `counts` None: the numbers of samples are equal and not known.
    """

    distances: Vector
    means: Vector
    variances: Vector
    counts: Vector | None = None


class NoiseStatistics(NamedTuple):
    """Wang's mu_n [m], mu_g, sigma_n^2 [m^2], sigma_g^2, each with its standard error.

    The errors are None where nothing tells them: two distances and counts unknown. The sets of
    means and of variances are fitted apart. `converged` says that the weights settled.
    """

    bias_m: float
    scale: float
    variance_m2: float
    variance_scale: float
    bias_error_m: float | None
    scale_error: float | None
    variance_error_m2: float | None
    variance_scale_error: float | None
    converged: bool


def sample_statistics(distances: Vector, measured: Vector) -> RangeTests:
    """Sample statistics of readings `measured` (k,) at true `distances` (k,), grouped by distance.

    Raises `InputError` where a distance has fewer than two readings.
    """
    r, z = np.asarray(distances, float), np.asarray(measured, float)
    if r.shape != z.shape or r.ndim != 1 or not np.isfinite(z).all():
        raise InputError(
            f"distances of shape {r.shape}, readings of shape {z.shape}: expected two finite "
            "columns of one length"
        )
    at, group = np.unique(r, return_inverse=True)
    counts = np.bincount(group).astype(float)
    if (counts < 2).any():
        raise InputError(f"distance {at[counts < 2][0]:g} m: one reading, expected two or more")
    means = np.bincount(group, z) / counts
    spread = np.bincount(group, (z - means[group]) ** 2)
    return RangeTests(at, means, spread / (counts - 1.0), counts)


def noise_statistics(tests: RangeTests, *, method: Method = "weighted") -> NoiseStatistics:
    """Fit means d_i = mu_n + mu_g r_i and variances s_i^2 = var_n + var_g r_i^2, Wang (4)-(5).

    "least squares" is the paper's rule, which now and then gives a negative variance. "weighted"
    gives each test the weight that its own noise deserves, and keeps variances from falling below
    zero: var s_i^2 = 2 v_i^2 / (N_i - 1), var d_i = v_i / N_i, v_i fitted.

    Raises `InputError` for fewer than two distinct distances and values that cannot be.
    """
    r, excess, s2 = _checked(tests)
    counts = tests.counts
    draws = np.full(len(r), 2.0) if counts is None else counts
    if method == "weighted":
        noise, fitted, converged = _weighted_variances(r**2, s2, draws)
        mean_weights, noise_weights = draws / fitted, (draws - 1.0) / fitted**2
    else:
        noise, fitted, converged = _fit(r**2, s2, np.ones_like(r)), s2, True
        mean_weights = noise_weights = np.ones_like(r)

    known = counts is not None
    noise_errors = _errors(
        r**2, s2, noise, noise_weights, 2.0 * fitted**2 / (draws - 1.0) if known else None
    )
    mean = _fit(r, excess, mean_weights)
    mean_errors = _errors(r, excess, mean, mean_weights, fitted / draws if known else None)
    return NoiseStatistics(
        bias_m=float(mean[0]),
        scale=float(mean[1]),
        variance_m2=float(noise[0]),
        variance_scale=float(noise[1]),
        bias_error_m=mean_errors[0],
        scale_error=mean_errors[1],
        variance_error_m2=noise_errors[0],
        variance_scale_error=noise_errors[1],
        converged=converged,
    )


def model(statistics: NoiseStatistics, *, max_range_m: float = math.inf) -> RangeModel:
    """Range model with these statistics; a negative variance counts as zero."""
    return RangeModel(
        bias_m=statistics.bias_m,
        scale=statistics.scale,
        sigma_m=math.sqrt(max(statistics.variance_m2, 0.0)),
        sigma_scale=math.sqrt(max(statistics.variance_scale, 0.0)),
        max_range_m=max_range_m,
    )


def _checked(tests: RangeTests) -> tuple[Vector, Vector, Vector]:
    """Distances, means less distances, variances; refuses what no test can have given."""
    r, means, s2 = (np.asarray(part, float) for part in tests[:3])
    counts = np.full(r.shape, 2.0) if tests.counts is None else np.asarray(tests.counts, float)
    if r.ndim != 1 or not r.shape == means.shape == s2.shape == counts.shape:
        raise InputError(
            f"tests with {r.shape} distances, {means.shape} means, {s2.shape} variances and "
            f"{counts.shape} counts: expected columns of one length"
        )
    if not (np.isfinite(r).all() and np.isfinite(means).all() and np.isfinite(s2).all()):
        raise InputError("tests need finite distances, means and variances")
    if (r < 0.0).any() or (s2 < 0.0).any() or not (counts >= 2.0).all():
        raise InputError("tests need distances and variances of zero or more, and counts above one")
    if len(np.unique(r)) < 2:
        raise InputError(
            f"distinct test distances: found {len(np.unique(r))}, expected two or more, "
            "or bias and scale cannot be told apart"
        )
    return r, means - r, s2


def _weighted_variances(x: Vector, s2: Vector, draws: Vector) -> tuple[Vector, Vector, bool]:
    """Line of variances over `x`, not below zero, its values at the tests, whether it settled.

    The weights 1/v^2 come from the fit itself, repeated until it stays.
    """
    floor = max(1e-9 * float(s2.mean()), 1e-30)
    line = _fit_nonnegative(x, s2, np.ones_like(x))
    for _ in range(ROUNDS):
        fitted = np.maximum(line[0] + line[1] * x, floor)
        before, line = line, _fit_nonnegative(x, s2, (draws - 1.0) / fitted**2)
        if np.all(np.abs(line - before) <= 1e-12 * np.abs(line)):
            return line, fitted, True
    return line, np.maximum(line[0] + line[1] * x, floor), False


def _fit(x: Vector, y: Vector, weights: Vector) -> Vector:
    """Intercept and slope of the weighted least-squares line."""
    w = weights / weights.sum()
    middle = w @ x
    slope = (w * (x - middle)) @ y / (w @ (x - middle) ** 2)
    return np.array([w @ y - slope * middle, slope])


def _fit_nonnegative(x: Vector, y: Vector, weights: Vector) -> Vector:
    """Return the same with intercept and slope >= 0: on an edge if `_fit` leaves the quadrant."""
    line = _fit(x, y, weights)
    if (line >= 0.0).all():
        return line
    edges = (
        np.array([max(weights @ y / weights.sum(), 0.0), 0.0]),
        np.array([0.0, max((weights * x) @ y / (weights @ x**2), 0.0)]),
    )
    return min(edges, key=lambda edge: float(weights @ (y - edge[0] - edge[1] * x) ** 2))


def _errors(
    x: Vector, y: Vector, line: Vector, weights: Vector, variances: Vector | None
) -> tuple[float | None, float | None]:
    """Find standard errors of a `_fit`, of `variances` of its values or of how they scatter."""
    design = np.column_stack([np.ones_like(x), x])
    w = weights / weights.sum()
    solve = np.asarray(np.linalg.solve((design.T * w) @ design, design.T * w), np.float64)
    if variances is None:
        free = len(x) - 2
        if free == 0:
            return None, None
        scatter = w @ (y - design @ line) ** 2 / free
        spread = scatter / w
    else:
        spread = variances
    error = np.sqrt(np.sum(solve**2 * spread, axis=1))
    return float(error[0]), float(error[1])
