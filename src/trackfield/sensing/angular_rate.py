"""Angular rates: how fast the direction of a target turns, seen from a sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_CORE_M = 1e-6  # nearer to a sensor than this nothing turns at a rate to speak of [m]


@dataclass(frozen=True, slots=True)
class AngularRateModel:
    """Rate z = (x vy - y vx) / (x^2 + y^2) + n at which the bearing of a target turns.

    (x, y) is the target seen from its sensor, (vx, vy) its velocity, n ~ N(0, sigma_rad_s^2);
    positive counter-clockwise; heights do not matter. `max_range_m` is how far the sensor sees,
    measured in space where heights are known. What turns slower than `threshold_rad_s` is not said.
    Cheng, Ghosh, Hu: y = thetadot.
    """

    sigma_rad_s: float = 0.01
    max_range_m: float = math.inf
    threshold_rad_s: float = 0.0


class AngularRateColumns(NamedTuple):
    """What each sensor's `AngularRateModel` says, as columns (n,) over the sensors."""

    sigma_rad_s: Vector
    max_range_m: Vector
    threshold_rad_s: Vector


AngularRateModels = AngularRateModel | AngularRateColumns
"""One model for all sensors, or a column of models; every function of angular rates takes either.
"""


class SimulatedAngularRates(NamedTuple):
    """What the sensors measured along a path, (..., steps, n) each.

    `value` [rad/s] is what a sensor would have read, in range or not; `heard` says where the target
    was within `max_range_m` and turned at `threshold_rad_s` or more.
    """

    value: Matrix
    heard: NDArray[np.bool_]


def columns(models: Sequence[AngularRateModel]) -> AngularRateColumns:
    """Columns (n,) of the models of n sensors."""
    names = AngularRateColumns._fields
    return AngularRateColumns(
        *(np.array([getattr(m, name) for m in models], float) for name in names)
    )


def expected(models: AngularRateModels, sensors: Matrix, *, states: Matrix) -> Matrix:
    """Mean reading (..., n) [rad/s] of `sensors` (n, d) with the target in `states` (..., 2 d).

    A state is a position [m] and a velocity [m/s]. A target at the sensor does not turn.
    """
    del models  # which only add noise
    return _rate(*_parts(sensors, states))[0]


def jacobian(models: AngularRateModels, sensors: Matrix, *, states: Matrix) -> Matrix:
    """Slope (..., n, 2 d) of `expected` in position [rad/(s m)] and velocity [rad/m] of the target.

    (vy - 2 z x, -vx - 2 z y) / r^2 and (-y, x) / r^2, r the distance in the plane. Zero in the
    heights, and within a micrometre of the sensor, where there is no slope.
    """
    del models
    return slope(*_parts(sensors, states))


def slope(offsets: Matrix, velocities: Matrix) -> Matrix:
    """Slope (..., 2 d) of a rate, `offsets` (..., d) [m] from the sensor and at `velocities`."""
    z, inverse = _rate(offsets, velocities)
    x, y, vx, vy = _plane(offsets, velocities)
    d = offsets.shape[-1]
    out = np.zeros((*z.shape, 2 * d))
    out[..., 0] = (vy - 2.0 * z * x) * inverse
    out[..., 1] = (-vx - 2.0 * z * y) * inverse
    out[..., d] = -y * inverse
    out[..., d + 1] = x * inverse
    return out


def variance(models: AngularRateModels, r: Matrix) -> Matrix:
    """Variance sigma_rad_s^2 (..., n) of a reading; `r` (..., n) [m] only gives the shape."""
    return np.broadcast_to(np.square(models.sigma_rad_s), np.shape(r))


def simulate(
    models: AngularRateModels, sensors: Matrix, *, path: Matrix, rng: np.random.Generator
) -> SimulatedAngularRates:
    """Draw what `sensors` (n, d) read of a target in the states `path` (..., steps, 2 d).

    Each leading index is a run of its own.
    """
    offsets, velocities = _parts(sensors, path)
    mean, _ = _rate(offsets, velocities)
    value = mean + models.sigma_rad_s * rng.standard_normal(mean.shape)
    heard = np.linalg.norm(offsets, axis=-1) <= models.max_range_m
    return SimulatedAngularRates(value, heard & (np.abs(value) >= models.threshold_rad_s))


def _rate(offsets: Matrix, velocities: Matrix) -> tuple[Matrix, Matrix]:
    """Rates (...) and 1 / r^2, both zero within the core."""
    x, y, vx, vy = _plane(offsets, velocities)
    square = x**2 + y**2
    inverse = np.where(square < _CORE_M**2, 0.0, 1.0 / np.maximum(square, _CORE_M**2))
    return (x * vy - y * vx) * inverse, inverse


def _plane(offsets: Matrix, velocities: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    return offsets[..., 0], offsets[..., 1], velocities[..., 0], velocities[..., 1]


def _parts(sensors: Matrix, states: Matrix) -> tuple[Matrix, Matrix]:
    """Offsets from the sensors (..., n, d) and velocities (..., 1, d)."""
    d = sensors.shape[-1]
    if sensors.ndim != 2 or d not in {2, 3} or states.shape[-1:] != (2 * d,):
        raise InputError(
            f"sensors of shape {sensors.shape} and states of shape {states.shape}: "
            "expected (n, d) and (..., 2 d), positions and velocities, d = 2 or 3"
        )
    return states[..., None, :d] - sensors, states[..., None, d:]
