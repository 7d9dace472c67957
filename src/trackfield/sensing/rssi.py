"""Received signal strength of a beacon in dBm, which falls with the logarithm of the distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_SLOPE = 10.0 / math.log(10.0)  # dB for each e-fold of distance and unit of exponent


@dataclass(frozen=True, slots=True)
class RssiModel:
    """Strength z = power_dbm - 10 exponent log10(r) + shadow + n of a beacon at distance r [m].

    n ~ N(0, sigma_db^2), white. The shadow of walls and furniture stays alike near a place:
    N(0, shadow_db^2) with correlation exp(-d / shadow_m) over d metres in the plane. `fading_db` is
    what of n belongs to the place, at the scale of a wavelength: a mean of readings taken in one
    place still has it.

    With `p_blocked` a body or a wall takes N(blocked_db, blocked_sigma_db^2) away for `burst_s` in
    the mean (0: each reading by itself); with `p_outlier` a reading is off by N(0, outlier_db^2).
    What is weaker than `min_dbm` is not heard. Nearer than `near_m` the strength stays what it is
    there.
    """

    power_dbm: float = -59.0  # at 1 m
    exponent: float = 2.0
    sigma_db: float = 5.0
    shadow_db: float = 0.0
    shadow_m: float = 5.0
    fading_db: float = 0.0
    p_blocked: float = 0.0
    blocked_db: float = 6.0
    blocked_sigma_db: float = 3.0
    burst_s: float = 0.0
    p_outlier: float = 0.0
    outlier_db: float = 20.0
    min_dbm: float = -127.0
    near_m: float = 0.3
    max_range_m: float = math.inf


UNSURVEYED = RssiModel(sigma_db=4.5, shadow_db=3.0, fading_db=3.0, p_blocked=0.05, p_outlier=0.01)
"""What is believed of a receiver of which nothing is told: as of beacons in buildings."""


class RssiColumns(NamedTuple):
    """What each receiver's `RssiModel` says of its readings, as columns (n,) over the receivers."""

    power_dbm: Vector
    exponent: Vector
    sigma_db: Vector
    shadow_db: Vector
    shadow_m: Vector
    fading_db: Vector
    p_blocked: Vector
    blocked_db: Vector
    blocked_sigma_db: Vector
    burst_s: Vector
    p_outlier: Vector
    outlier_db: Vector
    min_dbm: Vector
    near_m: Vector
    max_range_m: Vector


RssiModels = RssiModel | RssiColumns
"""One model for all receivers, or a column of models; every function of strengths takes either."""


def columns(models: Sequence[RssiModel]) -> RssiColumns:
    """Columns (n,) of the models of n receivers."""
    return RssiColumns(
        *(np.array([getattr(m, name) for m in models], float) for name in RssiColumns._fields)
    )


def distance(sensors: Matrix, positions: Matrix) -> Matrix:
    """Distances (..., n) [m] from `sensors` (n, d) to `positions` (..., d); d is 2 or 3."""
    return np.linalg.norm(_offsets(sensors, positions), axis=-1)


def expected(models: RssiModels, r: Matrix) -> Matrix:
    """Strength power_dbm - 10 exponent log10(max(r, near_m)) (..., n) [dBm] at distances `r` [m].

    That of a path that nothing blocks, without its shadow.
    """
    return models.power_dbm - 10.0 * models.exponent * np.log10(np.maximum(r, models.near_m))


def jacobian(models: RssiModels, sensors: Matrix, *, positions: Matrix) -> Matrix:
    """Slope -(10 exponent / ln 10) u' / r (..., n, d) [dB/m] of `expected` in `positions`.

    u is the direction from sensor to target (..., d). Nearer than `near_m` the slope is zero.
    """
    offsets = _offsets(sensors, positions)
    return slope(models, offsets, r=np.linalg.norm(offsets, axis=-1))


def slope(models: RssiModels, offsets: Matrix, *, r: Matrix) -> Matrix:
    """Slope (..., n, d) [dB/m] of the strength of a beacon `offsets` (..., n, d), `r` away."""
    near = np.maximum(models.near_m, 1e-6)
    inverse = np.where(r < near, 0.0, 1.0 / np.square(np.maximum(r, near)))
    return (-_SLOPE * models.exponent * inverse)[..., None] * offsets


def variance(models: RssiModels, r: Matrix) -> Matrix:
    """Variance sigma_db^2 + shadow_db^2 (..., n) [dB^2] of a reading that nothing blocks.

    `r` (..., n) [m] only gives the shape.
    """
    both = np.square(models.sigma_db) + np.square(models.shadow_db)
    return np.broadcast_to(both, np.shape(r))


def log_density(models: RssiModels, off: Matrix, *, variance: Matrix) -> Matrix:
    """Log density (..., n) of readings that are `off` (..., n) [dB] from what was expected.

    A mixture: clear N(0, v) with 1 - p_blocked - p_outlier, blocked N(-blocked_db, v +
    blocked_sigma_db^2), outlier N(0, v + outlier_db^2); v is `variance`, all that is not known of a
    reading whose path nothing blocks.
    """
    return np.logaddexp.reduce(_log_parts(models, off, variance), axis=0)


def shares(models: RssiModels, off: Matrix, *, variance: Matrix) -> Matrix:
    """Probabilities (3, ..., n) that readings `off` [dB] are clear, blocked or outliers."""
    parts = _log_parts(models, off, variance)
    return np.exp(parts - np.logaddexp.reduce(parts, axis=0))


def _log_parts(models: RssiModels, off: Matrix, variance: Matrix) -> Matrix:
    """Log of share times density (3, ..., n) of clear, blocked and outlying readings."""
    blocked, outlier = np.asarray(models.p_blocked), np.asarray(models.p_outlier)
    clear = np.maximum(1.0 - blocked - outlier, 0.0)
    parts = (
        (clear, 0.0, variance),
        (blocked, -models.blocked_db, variance + np.square(models.blocked_sigma_db)),
        (outlier, 0.0, variance + np.square(models.outlier_db)),
    )
    with np.errstate(divide="ignore"):  # of a share of 0 the logarithm is -inf, as it should be
        return np.stack([np.log(p) + _log_normal(off - m, v) for p, m, v in parts])


def _log_normal(off: Matrix, variance: Matrix) -> Matrix:
    return -0.5 * (np.square(off) / variance + np.log(2.0 * np.pi * variance))


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
