"""What a run with truth tells of ranges: bias, scale, clock, and how their errors hang together."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Matrix, Vector

_PRIOR_BIAS_M = 1.0  # a bias, a scale beyond these needs evidence
_PRIOR_SCALE = 0.1
_RUN_TO_RUN = 0.5  # sensors drift by half a sigma between runs
_ROUNDS = 4


class Fit(NamedTuple):
    """z - r = bias_a + scale r + residual, robustly: one scale, one bias a sensor.

    Errors are standard errors; `sigma` of all residuals, `sigmas` (n,) of each sensor's [m].
    """

    bias: Vector
    bias_error: Vector
    scale: float
    scale_error: float
    sigma: float
    sigmas: Vector
    residual: Vector


def robust_sigma(residual: Vector) -> float:
    """Sigma of the Gaussian core: 1.4826 times the median deviation from the median."""
    if not residual.size:
        return 0.0
    return float(1.4826 * np.median(np.abs(residual - np.median(residual))))


def fit_bias_and_scale(r: Vector, excess: Vector, sensor: Indices, sensors: int) -> Fit:
    """Fit `excess` = z - r over distances `r`, (n,) [m], with Cauchy weights.

    A sensor's deviation from the common line is shrunk by w = tau^2/(tau^2 + (sigma_a/2)^2), tau^2
    by moments, because a sensor's bias moves by that much from run to run.
    """
    design = np.stack([np.ones_like(r), r], axis=1)
    fit = _round(design, excess, sensor, deviation=np.zeros(sensors))
    for _ in range(_ROUNDS - 1):  # line and deviations explain the same residuals: take turns
        fit = _round(design, excess, sensor, deviation=fit.bias - fit.bias.mean())
    return fit


def _round(design: Matrix, excess: Vector, sensor: Indices, *, deviation: Vector) -> Fit:
    """Fit the line to what the sensors' deviations (n,) leave, then deviations to the rest."""
    sensors = deviation.size
    line, covariance, rest, weight = _cauchy_line(design, excess - deviation[sensor])
    sigma = max(robust_sigma(rest), 1e-6)
    residual = rest + deviation[sensor]
    count = np.bincount(sensor, weights=weight, minlength=sensors)
    total = np.bincount(sensor, weights=weight * residual, minlength=sensors)
    mean = total / np.maximum(count, 1e-9)
    own = residual - mean[sensor]
    sigmas = np.array([_pooled(own[sensor == a], sigma) for a in range(sensors)])
    noise = sigmas**2 / np.maximum(count, 1.0)
    heard = count > 0
    tau2 = 0.0
    if heard.sum() > 1:
        tau2 = max(0.0, float(np.var(mean[heard], ddof=1) - noise[heard].mean()))
    shrink = tau2 / (tau2 + (_RUN_TO_RUN * sigmas) ** 2) if tau2 > 0.0 else np.zeros(sensors)
    shrunk = np.where(heard, shrink * mean, 0.0)
    return Fit(
        bias=line[0] + shrunk,
        bias_error=np.sqrt(covariance[0, 0] + noise * shrink**2 + tau2 * (1.0 - shrink)),
        scale=float(line[1]),
        scale_error=float(np.sqrt(covariance[1, 1])),
        sigma=sigma,
        sigmas=sigmas,
        residual=residual - shrunk[sensor],
    )


def clock_offset(
    distances: Callable[[float], Vector], value: Vector, kept: NDArray[np.bool_]
) -> tuple[float, float]:
    """Offset [s] to add to the readings' times so that they meet the truth, and its error.

    Least Cauchy cost of the line over offsets of +-1 s; the error is from the curvature, ten-fold
    for errors that hang together. An offset within three errors of 0 is returned as 0.
    """
    excess = value[kept]

    def cost(offset_s: float) -> float:
        r = distances(offset_s)[kept]
        design = np.stack([np.ones_like(r), r], axis=1)
        _, _, residual, _ = _cauchy_line(design, excess - r, rounds=6)
        sigma = max(robust_sigma(residual), 1e-6)
        return float(
            residual.size * np.log(sigma) + np.log1p((residual / (2.0 * sigma)) ** 2).sum()
        )

    grid = np.arange(-1.0, 1.01, 0.1)
    best = float(grid[int(np.argmin([cost(s) for s in grid]))])
    for step in (0.02, 0.004):
        near = best + step * np.arange(-5, 6)
        best = float(near[int(np.argmin([cost(s) for s in near]))])
    width = 0.04
    low, middle, high = (cost(best + s) for s in (-width, 0.0, width))
    curvature = (low - 2.0 * middle + high) / width**2
    if curvature <= 0.0:
        return 0.0, float("inf")
    error = float(np.sqrt(10.0 / curvature))
    return (best, error) if abs(best) > 3.0 * error else (0.0, error)


def correlation(residual: Vector, sensor: Indices, travelled_m: Vector) -> tuple[float, float]:
    """Share of the residuals' variance that fades with the way travelled, and its length [m].

    Least squares of c exp(-s/L) to the correlation of residuals of one sensor that are a way s of
    up to 6 m apart, gross errors clipped.
    """
    ways: list[Vector] = []
    products: list[Vector] = []
    for a in np.unique(sensor):
        mine = np.flatnonzero(sensor == a)
        sigma = robust_sigma(residual[mine])
        if mine.size < 20 or sigma <= 0.0:
            continue
        e = np.clip(residual[mine] / sigma, -3.0, 3.0)
        e = (e - e.mean()) / max(float(e.std()), 1e-9)
        s = travelled_m[mine]
        for lag in range(1, min(40, mine.size)):
            way = s[lag:] - s[:-lag]
            near = (way > 0.02) & (way < 6.0)
            ways.append(way[near])
            products.append((e[lag:] * e[:-lag])[near])
    if not ways or sum(w.size for w in ways) < 100:
        return 0.0, 1.0
    way, product = np.concatenate(ways), np.concatenate(products)
    edges = np.array([0.02, 0.1, 0.2, 0.4, 0.8, 1.5, 3.0, 6.0])
    where = np.digitize(way, edges) - 1
    full = [b for b in range(edges.size - 1) if np.sum(where == b) >= 30]
    if not full:
        return 0.0, 1.0
    centre = np.array([way[where == b].mean() for b in full])
    level = np.array([product[where == b].mean() for b in full])
    best = (float("inf"), 0.0, 1.0)
    for length in np.geomspace(0.3, 3.0, 24):
        shape = np.exp(-centre / length)
        share = float(np.clip(shape @ level / (shape @ shape), 0.0, 0.9))
        error = float(((level - share * shape) ** 2).sum())
        best = min(best, (error, share, float(length)))
    return best[1], best[2]


def displacement_sigma(
    residual: Vector, directions: Matrix, t_s: Vector, *, white_sigma: float
) -> float:
    """Sigma per axis [m] of residuals that look like a displacement of the target.

    Residuals e = u'd + white of each second with four readings or more give d; what its variance
    has beyond the white noise's share is not noise but the antenna's place on the target, or the
    anchors' frame, and no filter of ranges can see it.
    """
    second = np.floor(t_s - t_s.min()).astype(int) if t_s.size else np.zeros(0, int)
    excess: list[float] = []
    for rows in np.split(np.arange(t_s.size), np.flatnonzero(np.diff(second)) + 1):
        if rows.size < 4:
            continue
        u = directions[rows]
        information = u.T @ u
        if np.linalg.cond(information) > 30.0:
            continue
        inverse = np.linalg.inv(information)
        limit = 4.0 * max(white_sigma, 1e-9)
        d = inverse @ (u.T @ np.clip(residual[rows], -limit, limit))
        excess.append(float(d @ d - white_sigma**2 * np.trace(inverse)) / d.size)
    if len(excess) < 5:
        return 0.0
    return float(np.sqrt(max(0.0, float(np.mean(excess)))))


def _pooled(residual: Vector, sigma: float) -> float:
    """Sigma of one sensor, shrunk to that of all by 30 readings' worth."""
    own = robust_sigma(residual)
    return float(np.sqrt((residual.size * own**2 + 30.0 * sigma**2) / (residual.size + 30.0)))


def _cauchy_line(
    design: Matrix, y: Vector, rounds: int = 25
) -> tuple[Vector, Matrix, Vector, Vector]:
    """Weigh least squares by Cauchy at 2 sigma: line, covariance, residual, weights."""
    prior = np.diag([1.0 / _PRIOR_BIAS_M**2, 1.0 / _PRIOR_SCALE**2])
    weight = np.ones(y.size)
    sigma = max(robust_sigma(y), 1e-6)
    line: Vector = np.zeros(2)
    information: Matrix = prior
    for _ in range(rounds):
        information = (design * (weight / sigma**2)[:, None]).T @ design + prior
        line = np.asarray(np.linalg.solve(information, design.T @ (weight * y) / sigma**2), float)
        residual = y - design @ line
        sigma = max(robust_sigma(residual), 1e-6)
        weight = 1.0 / (1.0 + (residual / (2.0 * sigma)) ** 2)
    covariance = np.asarray(np.linalg.inv(information), float)
    return line, covariance, y - design @ line, weight
