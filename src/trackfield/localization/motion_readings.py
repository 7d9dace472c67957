"""Readings of sensors that know no distance, of one target: bearings, angular rates, motion rates.

The common form of what `motion_snapshot` and `motion_window` solve: any kinds, any times, sensors
that stand or move.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import covariance_of
from trackfield.network.kinds import SensorModel, kind_of
from trackfield.sensing import angular_rate, bearing, motion_rate
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateColumns, MotionRateModel
from trackfield.types import Indices, Matrix, Vector

KINDS = ("bearing", "angular_rate", "motion")  # as _core/motion_terms.hpp counts them
BEARING, RATE, MOTION = range(3)
NEGATIVE = 5.0  # standard deviations below zero that noise may take the size of a motion


class MotionReadings(NamedTuple):
    """Readings (m,) of one target; made by `readings`, which checks them.

    `sensors` (m, d) [m] and `velocities` (m, d) [m/s] are those of the sensor when it read; `kind`
    counts in `KINDS`; `falloff` matters to motion rates only. `source` numbers the places.
    """

    t_s: Vector
    sensors: Matrix
    velocities: Matrix
    value: Vector
    sigma: Vector
    falloff: Vector
    kind: Indices
    source: Indices

    @property
    def dimensions(self) -> int:
        """Of the space in which sensors and target are, 2 or 3."""
        return self.sensors.shape[1]

    @property
    def reversible(self) -> bool:
        """Whether a state and the one with the opposite velocity are read alike.

        So it is where one moment's sizes of motion are all there is, and sensors stand.
        """
        sizes = bool((self.kind == MOTION).all() and not self.velocities.any())
        return sizes and bool(np.ptp(self.t_s) == 0.0)

    def rows(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> MotionReadings:
        """Take some of the readings."""
        return MotionReadings(
            self.t_s[chosen],
            self.sensors[chosen],
            self.velocities[chosen],
            self.value[chosen],
            self.sigma[chosen],
            self.falloff[chosen],
            self.kind[chosen],
            self.source[chosen],
        )

    def since(self, t_s: float) -> MotionReadings:
        """Count times from `t_s`."""
        return self._replace(t_s=self.t_s - t_s)


class Misfit(NamedTuple):
    """Of states (..., 2 d), in standard deviations: `residual` (..., m), `gain` (..., m, 2 d)."""

    residual: Matrix
    gain: Matrix


def readings(
    models: SensorModel | Sequence[SensorModel],
    sensors: Matrix,
    values: Vector,
    *,
    t_s: Vector | float = 0.0,
    sigma: Vector | None = None,
    velocities: Matrix | None = None,
) -> MotionReadings:
    """Lay out readings `values` (m,) of sensors at `sensors` (m, d), one model for all or one each.

    Models are of the kinds bearing, angular_rate and motion. `sigma` (m,) stands in for the
    model's where it is not NaN; `velocities` (m, d) [m/s] are those of sensors that move.

    `InputError` for shapes that do not fit, numbers that are not finite, standard deviations that
    are not positive, other kinds, and a size of motion below zero by more than 5 standard
    deviations, which no noise explains.
    """
    places, value = np.asarray(sensors, float), np.asarray(values, float)
    m = value.size
    each = list(models) if isinstance(models, Sequence) else [models] * m
    if value.ndim != 1 or places.shape not in {(m, 2), (m, 3)} or len(each) != m:
        raise InputError(
            f"found values of shape {value.shape}, sensors of shape {places.shape} and "
            f"{len(each)} models, expected (m,), (m, d), d = 2 or 3, and m"
        )
    drift = np.zeros(places.shape) if velocities is None else np.asarray(velocities, float)
    if drift.shape != places.shape:
        raise InputError(f"velocities of shape {drift.shape}: expected {places.shape}")
    kind, own, falloff, shift = _parameters(each)
    told = own if sigma is None else np.where(np.isnan(sigma), own, sigma)
    times = np.array(np.broadcast_to(np.asarray(t_s, float), (m,)))
    _, source = np.unique(places, axis=0, return_inverse=True)
    source = np.asarray(source.reshape(-1), np.int32)
    found = MotionReadings(times, places, drift, value - shift, told, falloff, kind, source)
    _check(found)
    return found


def misfit(given: MotionReadings, states: Matrix) -> Misfit:
    """Residuals (z - h) / sigma of `states` (..., 2 d) at time 0, and the slopes of h / sigma.

    A state keeps its velocity: at the time t of a reading it is at p + t v.
    """
    d = given.dimensions
    p, v = states[..., None, :d], states[..., None, d:]
    t = given.t_s[:, None]
    offsets, across = p + t * v - given.sensors, v - given.velocities
    shape = np.broadcast_shapes(offsets.shape, across.shape)
    offsets, across = np.broadcast_to(offsets, shape), np.broadcast_to(across, shape)
    error, place, speed = np.zeros(shape[:-1]), np.zeros(shape), np.zeros(shape)
    for kind, seen in enumerate((_bearings, _rates, _motions)):
        own = np.flatnonzero(given.kind == kind)
        if own.size:
            part = seen(given.rows(own), offsets[..., own, :], across[..., own, :])
            error[..., own], place[..., own, :], speed[..., own, :] = part
    gain = np.concatenate([place, t * place + speed], axis=-1)
    return Misfit(error / given.sigma, gain / given.sigma[:, None])


class Doubt(NamedTuple):
    """Covariance (..., 2 d, 2 d) of states, and whether every direction is `determined` (...)."""

    covariance: Matrix
    determined: NDArray[np.bool_]


def doubt(given: MotionReadings, states: Matrix, *, extent_m: float) -> Doubt:
    """Cramer-Rao bound of `states` (..., 2 d) at time 0.

    A size of motion says less the nearer it is to its noise, and nothing at zero, as
    `motion_rate.jacobian` tells. Directions are compared in units of `extent_m` and of the speed;
    one with less than 1e-9 of the best one's information is not determined.
    """
    d = given.dimensions
    gain = misfit(given, states).gain * _trust(given, states)[..., None]
    speed = np.linalg.norm(states[..., d:], axis=-1, keepdims=True)
    unit = np.concatenate(
        [np.full((*states.shape[:-1], d), extent_m), np.repeat(np.maximum(speed, 1e-9), d, -1)], -1
    )
    scaled = gain * unit[..., None, :]
    information = np.swapaxes(scaled, -1, -2) @ scaled
    roots = np.linalg.eigvalsh(information)
    covariance, _ = covariance_of(information)
    enough = roots[..., 0] > 1e-9 * np.maximum(roots[..., -1], np.finfo(float).tiny)
    return Doubt(covariance * unit[..., :, None] * unit[..., None, :], np.asarray(enough))


def _trust(given: MotionReadings, states: Matrix) -> Matrix:
    """Square root of the share (..., m) of a reading's information that noise leaves."""
    own = given.kind == MOTION
    share = np.ones((*states.shape[:-1], own.size))
    if own.any():
        part = given.rows(own)
        h = np.abs(part.value - misfit(part, states).residual * part.sigma)
        model = _columns(part)
        slope = motion_rate.mean_slope(model, h, dimensions=given.dimensions)
        variance = motion_rate.variance(model, h, dimensions=given.dimensions)
        share[..., own] = slope * part.sigma / np.sqrt(variance)
    return share


def _parameters(models: Sequence[SensorModel]) -> tuple[Indices, Vector, Vector, Vector]:
    """Kind, sigma, falloff and bias of each reading."""
    rows: list[tuple[int, float, float, float]] = []
    for model in models:
        match model:
            case BearingModel():
                rows.append((BEARING, model.sigma_rad, 1.0, model.bias_rad))
            case AngularRateModel():
                rows.append((RATE, model.sigma_rad_s, 1.0, 0.0))
            case MotionRateModel():
                rows.append((MOTION, model.sigma, model.falloff, 0.0))
            case _:
                raise InputError(
                    f"found a sensor of kind {kind_of(model)!r}, expected {', '.join(KINDS)}"
                )
    kind, sigma, falloff, bias = np.array(rows, float).reshape(-1, 4).T
    return kind.astype(np.int32), sigma, falloff, bias


def _check(given: MotionReadings) -> None:
    for name in ("t_s", "sensors", "velocities", "value", "sigma", "falloff"):
        column = getattr(given, name)
        if not np.isfinite(column).all():
            row = int(np.argmax(~np.isfinite(column).reshape(len(column), -1).all(axis=1)))
            raise InputError(f"reading {row}: {name} is {column[row]}, expected finite numbers")
    if not (given.sigma > 0.0).all():
        row = int(np.argmax(given.sigma <= 0.0))
        raise InputError(f"reading {row}: sigma is {given.sigma[row]}, expected more than zero")
    low = (given.kind == MOTION) & (given.value < -NEGATIVE * given.sigma)
    if low.any():
        row = int(np.argmax(low))
        raise InputError(
            f"reading {row}: the size of a motion is {given.value[row]}, expected none below zero"
        )


def _columns(given: MotionReadings) -> MotionRateColumns:
    nothing = np.zeros(len(given.sigma))
    return MotionRateColumns(given.falloff, given.sigma, nothing, nothing + np.inf)


def _bearings(
    given: MotionReadings, offsets: Matrix, velocities: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    seen = np.arctan2(offsets[..., 1], offsets[..., 0])
    return bearing.residual(given.value, seen), bearing.slope(offsets), np.zeros(offsets.shape)


def _rates(
    given: MotionReadings, offsets: Matrix, velocities: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    d = offsets.shape[-1]
    slope = angular_rate.slope(offsets, velocities)
    seen = np.sum(slope[..., d:] * velocities, axis=-1)  # a rate is linear in the velocity
    return given.value - seen, slope[..., :d], slope[..., d:]


def _motions(
    given: MotionReadings, offsets: Matrix, velocities: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    d = offsets.shape[-1]
    slope = motion_rate.strength_slope(_columns(given), offsets, velocities)
    seen = np.sum(slope[..., d:] * velocities, axis=-1)  # of the first degree in the velocity
    return given.value - seen, slope[..., :d], slope[..., d:]
