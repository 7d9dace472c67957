"""Bearings: the direction in the plane in which a sensor sees a target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_CORE_M = 1e-6  # nearer to a sensor than this a direction has no slope to speak of [m]


@dataclass(frozen=True, slots=True)
class BearingModel:
    """Bearing z = atan2(y, x) + bias_rad + n of a target at (x, y) from its sensor, n ~ N(0, s^2).

    Counter-clockwise from the local x axis, in -pi to pi; heights do not matter. s is `sigma_rad`.
    `max_range_m` is how far the sensor sees, measured in space where heights are known.
    """

    sigma_rad: float = 0.05
    bias_rad: float = 0.0
    max_range_m: float = math.inf


class BearingColumns(NamedTuple):
    """What each sensor's `BearingModel` says of its readings, as columns (n,) over the sensors."""

    sigma_rad: Vector
    bias_rad: Vector
    max_range_m: Vector


BearingModels = BearingModel | BearingColumns
"""One model for all sensors, or a column of models; every function of bearings takes either."""


class SimulatedBearings(NamedTuple):
    """What the sensors measured along a path, (..., steps, n) each.

    `value` [rad] is what a sensor would have read, in range or not; `heard` says where the target
    was within `max_range_m`.
    """

    value: Matrix
    heard: NDArray[np.bool_]


def columns(models: Sequence[BearingModel]) -> BearingColumns:
    """Columns (n,) of the models of n sensors."""
    return BearingColumns(
        *(np.array([getattr(m, name) for m in models], float) for name in BearingColumns._fields)
    )


def wrapped(angle: Matrix) -> Matrix:
    """Turn angles (...) [rad] by whole turns into -pi <= angle < pi."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def expected(models: BearingModels, sensors: Matrix, *, positions: Matrix) -> Matrix:
    """Mean reading (..., n) [rad] of `sensors` (n, d) with the target at `positions` (..., d).

    A target at a sensor is seen along the x axis.
    """
    offsets = _offsets(sensors, positions)
    return wrapped(np.arctan2(offsets[..., 1], offsets[..., 0]) + models.bias_rad)


def residual(z: Matrix, expected: Matrix) -> Matrix:
    """Difference z - expected of bearings (...) [rad] the short way round, -pi to pi."""
    return wrapped(z - expected)


def jacobian(models: BearingModels, sensors: Matrix, *, positions: Matrix) -> Matrix:
    """Slope (-y, x) / r^2 (..., n, d) [rad/m] of `expected` in the target's position (..., d).

    r is the distance in the plane. The slope in the height is zero, and so it is within a
    micrometre of the sensor, where there is none.
    """
    del models  # which only shift a bearing
    return slope(_offsets(sensors, positions))


def slope(offsets: Matrix) -> Matrix:
    """Slope (..., d) [rad/m] of a bearing in the place of a target `offsets` (..., d) from it."""
    x, y = offsets[..., 0], offsets[..., 1]
    square = x**2 + y**2
    inverse = np.where(square < _CORE_M**2, 0.0, 1.0 / np.maximum(square, _CORE_M**2))
    out = np.zeros(offsets.shape)
    out[..., 0], out[..., 1] = -y * inverse, x * inverse
    return out


def variance(models: BearingModels, r: Matrix) -> Matrix:
    """Variance sigma_rad^2 (..., n) [rad^2] of a reading; `r` (..., n) [m] only gives the shape."""
    return np.broadcast_to(np.square(models.sigma_rad), np.shape(r))


def simulate(
    models: BearingModels, sensors: Matrix, *, path: Matrix, rng: np.random.Generator
) -> SimulatedBearings:
    """Draw what `sensors` (n, d) read of a target on `path` (..., steps, d).

    Each leading index is a run of its own.
    """
    mean = expected(models, sensors, positions=path)
    noise = models.sigma_rad * rng.standard_normal(mean.shape)
    r = np.linalg.norm(_offsets(sensors, path), axis=-1)
    return SimulatedBearings(wrapped(mean + noise), np.asarray(r <= models.max_range_m))


def _offsets(sensors: Matrix, positions: Matrix) -> Matrix:
    if (
        sensors.ndim != 2
        or sensors.shape[1] not in {2, 3}
        or positions.shape[-1:] != (sensors.shape[1],)
    ):
        raise InputError(
            f"sensors of shape {sensors.shape} and positions of shape {positions.shape}: "
            "expected (n, d) and (..., d) with the same d, 2 or 3"
        )
    return positions[..., None, :] - sensors
