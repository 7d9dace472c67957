"""Motion rates: how fast a target moves across the line of sight of a sensor, without a sign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chndtr, erf, ive

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_CORE_M = 1e-6  # nearer to a sensor than this there is no line of sight to speak of [m]
_FAR = 1e3  # standard deviations above which the noise is Gaussian to a millionth


@dataclass(frozen=True, slots=True)
class MotionRateModel:
    """Size z = |w + n| of the motion across the line of sight, w = v_perp / r^falloff.

    v_perp is the part of the target's velocity that is perpendicular to its direction from the
    sensor, r its distance: Cheng, Ghosh, Hu (3). With falloff 1, |w| is the size of the angular
    rate [rad/s]; in general it has the unit m^(1 - falloff)/s. The noise n ~ N(0, sigma^2 I) is in
    each of the d - 1 components across the line of sight, so a reading is never negative: far above
    sigma it is |w| + N(0, sigma^2), of a target at rest a half-normal (d = 2) or Rayleigh (d = 3).

    Below `threshold` a sensor stays silent; `max_range_m` is how far it sees.
    """

    falloff: float = 1.0
    sigma: float = 0.01
    threshold: float = 0.0
    max_range_m: float = math.inf


class MotionRateColumns(NamedTuple):
    """What each sensor's `MotionRateModel` says, as columns (n,) over the sensors."""

    falloff: Vector
    sigma: Vector
    threshold: Vector
    max_range_m: Vector


MotionRateModels = MotionRateModel | MotionRateColumns
"""One model for all sensors, or a column of models; every function of motion rates takes either.
"""


class SimulatedMotionRates(NamedTuple):
    """What the sensors measured along a path, (..., steps, n) each.

    `value` is what a sensor would have read, in range or not; `heard` says where the target was
    within `max_range_m` and the reading not below `threshold`.
    """

    value: Matrix
    heard: NDArray[np.bool_]


def columns(models: Sequence[MotionRateModel]) -> MotionRateColumns:
    """Columns (n,) of the models of n sensors."""
    names = MotionRateColumns._fields
    return MotionRateColumns(
        *(np.array([getattr(m, name) for m in models], float) for name in names)
    )


def strength(models: MotionRateModels, sensors: Matrix, *, states: Matrix) -> Matrix:
    """Size |v_perp| / r^falloff (..., n) without noise, of a target in `states` (..., 2 d).

    Cheng (3). A state is a position [m] and a velocity [m/s]. Zero within a micrometre of the
    sensor, where there is no line of sight.
    """
    return _strength(models, *_parts(sensors, states)).size


def strength_slope(models: MotionRateModels, offsets: Matrix, velocities: Matrix) -> Matrix:
    """Slope (..., 2 d) of `strength`, `offsets` (..., d) [m] from the sensor and at `velocities`.

    With e the direction of v_perp: (-(v.o) e / r^2 - p |v_perp| o / r^2) / r^p in the position and
    e / r^p in the velocity. Where nothing moves across, there is a kink, and the slope is given as
    zero.
    """
    at = _strength(models, offsets, velocities)
    along = np.sum(offsets * velocities, axis=-1, keepdims=True) * at.inverse2[..., None]
    steep = at.unit * at.scale[..., None]
    falloff = np.asarray(models.falloff) * at.size * at.inverse2
    place = -along * steep - falloff[..., None] * offsets
    return np.concatenate([place, np.broadcast_to(steep, place.shape)], axis=-1)


def expected(models: MotionRateModels, sensors: Matrix, *, states: Matrix) -> Matrix:
    """Mean reading (..., n) of `sensors` (n, d) with the target in `states` (..., 2 d).

    That of a folded normal (d = 2) or Rice distribution (d = 3) about `strength`: it never falls
    below .80 sigma or 1.25 sigma; in the plane it is `strength` to a thousandth of sigma from
    3 sigma on. Silence is left out of account.
    """
    return mean(models, strength(models, sensors, states=states), dimensions=sensors.shape[-1])


def jacobian(models: MotionRateModels, sensors: Matrix, *, states: Matrix) -> Matrix:
    """Slope (..., n, 2 d) of `expected` in position and velocity of the target.

    The noise rounds the kink of the norm: `strength_slope` times what goes to zero with
    |w| / sigma, in the plane erf(|w| / (sigma sqrt2)). Zero within a micrometre of the sensor.
    """
    offsets, velocities = _parts(sensors, states)
    d = sensors.shape[-1]
    h = _strength(models, offsets, velocities).size
    gain = mean_slope(models, h, dimensions=d)
    return gain[..., None] * strength_slope(models, offsets, velocities)


def mean(models: MotionRateModels, strength: Matrix, *, dimensions: int = 2) -> Matrix:
    """Mean (..., n) of readings whose `strength` (..., n) is known, folded normal or Rice."""
    s = np.asarray(models.sigma, float)
    if dimensions == 2:
        u = strength / s
        fold = np.sqrt(2.0 / np.pi) * s * np.exp(-0.5 * u**2)
        return np.asarray(fold + strength * erf(u / np.sqrt(2.0)))
    q = 0.5 * np.minimum(strength / s, _FAR) ** 2
    bessel = (1.0 + q) * ive(0, 0.5 * q) + q * ive(1, 0.5 * q)
    rice = np.sqrt(0.5 * np.pi) * s * bessel
    return np.where(strength < _FAR * s, rice, strength + 0.5 * s**2 / np.maximum(strength, s))


def mean_slope(models: MotionRateModels, strength: Matrix, *, dimensions: int = 2) -> Matrix:
    """Slope (..., n) of `mean` in the strength: 0 of a target at rest, 1 far above sigma."""
    u = strength / np.asarray(models.sigma, float)
    if dimensions == 2:
        return np.asarray(erf(u / np.sqrt(2.0)))
    q = 0.25 * np.minimum(u, _FAR) ** 2
    slope = np.sqrt(np.pi / 8.0) * u * (ive(0, q) + ive(1, q))
    return np.where(u < _FAR, slope, 1.0)


def variance(models: MotionRateModels, strength: Matrix, *, dimensions: int = 2) -> Matrix:
    """Variance (..., n) of a reading whose `strength` (..., n) is known: at most sigma^2.

    strength^2 + (d - 1) sigma^2 - mean^2: of a target at rest .36 sigma^2 (d = 2) or .43 sigma^2
    (d = 3), above 4 sigma within 4 % of sigma^2.
    """
    m = mean(models, strength, dimensions=dimensions)
    s2 = np.square(models.sigma)
    found = (strength - m) * (strength + m) + (dimensions - 1) * s2
    # far above sigma a small difference of large squares, but for a share of order 1 / _FAR^2
    return np.where(strength < _FAR * np.sqrt(s2), found, s2)


def p_silent(models: MotionRateModels, strength: Matrix, *, dimensions: int = 2) -> Matrix:
    """Probability (..., n) that a reading of known `strength` (..., n) is below the threshold.

    (z / sigma)^2 has the noncentral chi-square distribution of d - 1 degrees.
    """
    level = np.broadcast_to(models.threshold / np.asarray(models.sigma, float), strength.shape)
    return np.asarray(chndtr(level**2, dimensions - 1, (strength / models.sigma) ** 2))


def simulate(
    models: MotionRateModels, sensors: Matrix, *, path: Matrix, rng: np.random.Generator
) -> SimulatedMotionRates:
    """Draw what `sensors` (n, d) read of a target in the states `path` (..., steps, 2 d).

    Each leading index is a run of its own.
    """
    offsets, velocities = _parts(sensors, path)
    h = _strength(models, offsets, velocities).size
    # by symmetry the noise may be drawn along w and across it
    noise = rng.standard_normal((sensors.shape[-1] - 1, *h.shape)) * models.sigma
    noise[0] += h
    value = np.asarray(np.sqrt(np.sum(noise**2, axis=0)))
    near = np.linalg.norm(offsets, axis=-1) <= models.max_range_m
    return SimulatedMotionRates(value, np.asarray(near & (value >= models.threshold)))


class _Strength(NamedTuple):
    """`size` |v_perp| / r^p, r^-p and r^-2 (...), and the direction `unit` (..., d) of v_perp."""

    size: Matrix
    scale: Matrix
    inverse2: Matrix
    unit: Matrix


def _strength(models: MotionRateModels, offsets: Matrix, velocities: Matrix) -> _Strength:
    square = np.sum(offsets**2, axis=-1)
    inverse2 = np.where(square < _CORE_M**2, 0.0, 1.0 / np.maximum(square, _CORE_M**2))
    along = np.sum(offsets * velocities, axis=-1) * inverse2
    across = velocities - along[..., None] * offsets
    speed = np.sqrt(np.sum(across**2, axis=-1))
    least = 1e-12 * np.sqrt(np.sum(velocities**2, axis=-1))  # below it only rounding is left
    moving = speed > np.maximum(least, np.finfo(float).tiny)
    unit = np.where(moving[..., None], across, 0.0) / np.where(moving, speed, 1.0)[..., None]
    scale = inverse2 ** (0.5 * np.asarray(models.falloff))
    scale = np.where(inverse2 > 0.0, scale, 0.0)  # also with falloff 0
    return _Strength(speed * scale, scale, inverse2, unit)


def _parts(sensors: Matrix, states: Matrix) -> tuple[Matrix, Matrix]:
    """Offsets from the sensors (..., n, d) and velocities (..., n, d)."""
    d = sensors.shape[-1]
    if sensors.ndim != 2 or d not in {2, 3} or states.shape[-1:] != (2 * d,):
        raise InputError(
            f"sensors of shape {sensors.shape} and states of shape {states.shape}: "
            "expected (n, d) and (..., 2 d), positions and velocities, d = 2 or 3"
        )
    offsets = states[..., None, :d] - sensors
    return offsets, np.broadcast_to(states[..., None, d:], offsets.shape)
