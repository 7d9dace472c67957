"""Ranges with additive and multiplicative noise, Wang (2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector


@dataclass(frozen=True, slots=True)
class RangeModel:
    """Range to a target at distance r: z = (1 + gamma) r + n, Wang (2).

    gamma ~ N(scale, sigma_scale^2), n ~ N(bias_m, sigma_m^2), white; plus an error that stays
    alike while the target moves less than `correlation_length_m`, of standard deviation
    `correlated_sigma_m` (multipath, antenna pattern, a body in the way).

    `bias_sigma_m` (own to each sensor), `common_bias_sigma_m` and `scale_sigma` (shared) say how
    well bias and scale are known; the tracker goes on estimating what is not known exactly.
    `learn_noise` lets it learn sigma_m from residuals too. `placement_sigma_m` (per axis) is what
    ranges cannot see: the antenna against the tracked point, the anchors' frame against that of the
    truth. `clock_offset_s` is added to the sensor's times.
    """

    bias_m: float = 0.0
    scale: float = 0.0
    sigma_m: float = 0.15
    sigma_scale: float = 0.0
    max_range_m: float = math.inf
    correlated_sigma_m: float = 0.0
    correlation_length_m: float = 1.0
    bias_sigma_m: float = 0.0
    common_bias_sigma_m: float = 0.0
    scale_sigma: float = 0.0
    learn_noise: bool = False
    placement_sigma_m: float = 0.0
    clock_offset_s: float = 0.0


UNCALIBRATED = RangeModel(
    sigma_m=0.15,
    correlated_sigma_m=0.13,
    correlation_length_m=0.5,
    bias_sigma_m=0.04,
    common_bias_sigma_m=0.2,
    scale_sigma=0.02,
    placement_sigma_m=0.03,
    learn_noise=True,
)
"""What is believed of a sensor of which nothing is told: the tracker learns the rest on line."""


class RangeColumns(NamedTuple):
    """What each sensor's `RangeModel` says of its readings, as columns (n,) over the sensors."""

    bias_m: Vector
    scale: Vector
    sigma_m: Vector
    sigma_scale: Vector
    max_range_m: Vector
    correlated_sigma_m: Vector
    correlation_length_m: Vector


RangeModels = RangeModel | RangeColumns
"""One model for all sensors, or a column of models; every function of ranges takes either."""


class Nlos(NamedTuple):
    """Each reading is late with `probability`, by Exp(mean_m): the direct path was blocked."""

    probability: float = 0.1
    mean_m: float = 1.0


class SimulatedRanges(NamedTuple):
    """What the sensors measured along a path, (..., steps, n) each.

    `value` [m] is what a sensor would have read, in range or not; `heard` says where the target was
    within `max_range_m`; `late` where the direct path was blocked.
    """

    value: Matrix
    heard: NDArray[np.bool_]
    late: NDArray[np.bool_]


def columns(models: Sequence[RangeModel]) -> RangeColumns:
    """Columns (n,) of the models of n sensors."""
    return RangeColumns(
        *(np.array([getattr(m, name) for m in models], float) for name in RangeColumns._fields)
    )


def distance(sensors: Matrix, positions: Matrix) -> Matrix:
    """Distances r_i = |p - c_i| (..., n) [m] from `sensors` (n, d) to `positions` (..., d)."""
    return np.linalg.norm(_offsets(sensors, positions), axis=-1)


def directions(sensors: Matrix, positions: Matrix) -> tuple[Matrix, Matrix]:
    """Distances (..., n) [m] and unit vectors (..., n, d) from sensor to target.

    A target at a sensor has no direction: its vector is zero.
    """
    offsets = _offsets(sensors, positions)
    r = np.linalg.norm(offsets, axis=-1)
    return r, offsets / np.where(r > 0.0, r, 1.0)[..., None]


def expected(models: RangeModels, r: Matrix) -> Matrix:
    """Mean reading (1 + scale) r + bias (..., n) [m] at true distances `r` (..., n)."""
    return (1.0 + models.scale) * r + models.bias_m


def jacobian(models: RangeModels, sensors: Matrix, *, positions: Matrix) -> Matrix:
    """Slope (1 + scale) u' (..., n, d) of `expected` in the target's position (..., d)."""
    _, u = directions(sensors, positions)
    return np.asarray(1.0 + models.scale)[..., None] * u


def variance(models: RangeModels, r: Matrix) -> Matrix:
    """Variance sigma_m^2 + correlated_sigma_m^2 + sigma_scale^2 r^2 (..., n) [m^2] of a reading."""
    return constant_variance(models) + models.sigma_scale**2 * r**2


def constant_variance(models: RangeModels) -> float | Vector:
    """Part of `variance` that does not grow with the distance, sigma_m^2 + correlated_sigma_m^2."""
    return models.sigma_m**2 + models.correlated_sigma_m**2


def corrected(models: RangeModels, ranges: Matrix) -> Matrix:
    """Distances (z - bias) / (1 + scale) (..., n) [m] that `ranges` stand for, the noise aside."""
    return (ranges - models.bias_m) / (1.0 + models.scale)


def simulate(
    models: RangeModels,
    sensors: Matrix,
    *,
    path: Matrix,
    rng: np.random.Generator,
    nlos: Nlos | None = None,
) -> SimulatedRanges:
    """Draw what `sensors` (n, d) read of a target on `path` (..., steps, d), Wang (2).

    Each leading index is a run of its own. A reading is never below zero.
    """
    r = distance(sensors, path)
    white = np.sqrt(np.asarray(models.sigma_m**2 + models.sigma_scale**2 * r**2))
    z = expected(models, r) + white * rng.standard_normal(r.shape)
    if np.any(np.asarray(models.correlated_sigma_m) > 0.0):
        z = z + correlated_errors(models, _travelled(path), sensors=len(sensors), rng=rng)
    late = np.zeros(r.shape, bool)
    if nlos is not None:
        late = rng.random(r.shape) < nlos.probability
        z = z + late * rng.exponential(nlos.mean_m, r.shape)
    return SimulatedRanges(np.maximum(z, 0.0), r <= models.max_range_m, late)


def correlated_errors(
    models: RangeModels, travelled_m: Matrix, *, sensors: int, rng: np.random.Generator
) -> Matrix:
    """Draw errors (..., steps, n) [m] of a target that has `travelled_m` (..., steps) at each step.

    An Ornstein-Uhlenbeck process of the way s: E[g(s) g(s')] = correlated_sigma_m^2
    exp(-|s - s'| / correlation_length_m), sampled exactly at any spacing, independent per sensor.
    """
    shape = (*travelled_m.shape, sensors)
    moved = np.diff(travelled_m, axis=-1, prepend=travelled_m[..., :1])[..., None]
    length = np.maximum(models.correlation_length_m, 1e-9)
    keep = np.broadcast_to(np.exp(-moved / length), shape)
    kick = np.sqrt(-np.expm1(-2.0 * np.broadcast_to(moved / length, shape)))
    errors = rng.standard_normal(shape)
    for k in range(1, shape[-2]):
        errors[..., k, :] = (
            keep[..., k, :] * errors[..., k - 1, :] + kick[..., k, :] * errors[..., k, :]
        )
    return models.correlated_sigma_m * errors


def _travelled(path: Matrix) -> Matrix:
    steps = np.linalg.norm(np.diff(path, axis=-2, prepend=path[..., :1, :]), axis=-1)
    return np.cumsum(steps, axis=-1)


def _offsets(sensors: Matrix, positions: Matrix) -> Matrix:
    if sensors.ndim != 2 or sensors.shape[-1] != positions.shape[-1]:
        raise InputError(
            f"sensors of shape {sensors.shape} and positions of shape {positions.shape}: "
            "expected (n, d) and (..., d) with the same d"
        )
    return positions[..., None, :] - sensors
