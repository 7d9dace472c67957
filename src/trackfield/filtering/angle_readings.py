"""Bearings, angular rates and scalar motion, mixed as they come: what sensors say of a state.

States (..., n) are a position and a velocity, [x, y, vx, vy] or [x, y, z, vx, vy, vz]. Sensors may
move: their places and velocities belong to the readings of one time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError, InputError
from trackfield.network.kinds import SensorModel, kind_of
from trackfield.network.site import Site
from trackfield.sensing import angular_rate, bearing
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.types import Indices, Matrix, Vector

_CORE_M = 1e-6  # nearer to a sensor than this there is no direction to speak of [m]


class Says(IntEnum):
    """What a sensor says of a target."""

    BEARING = 0  # [rad]
    RATE = 1  # of the bearing [rad/s]
    MOTION = 2  # |v_perp| / r^falloff


class AngleSensors(NamedTuple):
    """Sensors of directions and their rates, a row each: of all of a site, or of some readings.

    `says` (m,) holds `Says`; `place` (m, 3) [m] is seen from the plane of the targets where they
    are in one, `velocity` (m, 3) [m/s]. `sigma`, `bias`, `falloff`, `threshold` (0: never silent)
    and `reach` (m,) are those of the models, in the units of the readings, [m] for the reach.
    """

    says: Indices
    place: Matrix
    velocity: Matrix
    sigma: Vector
    bias: Vector
    falloff: Vector
    threshold: Vector
    reach: Vector


@dataclass(frozen=True, slots=True, eq=False)
class AngleReadings:
    """Readings `value` (m,) of `sensors`: a `Sensor` of `filtering.extended`.

    Each was made `after_s` (m,) the time of the states, or all at it. Bearings are told by the turn
    that is nearest to the reading, so that residuals are never longer than half a turn.
    """

    sensors: AngleSensors
    value: Vector
    after_s: Vector | None = None

    def predict(self, state: Vector) -> Vector:
        """Return expected readings (..., m)."""
        mean = expected(self.sensors, state, after_s=self.after_s)
        apart = self.value - mean
        turned = self.value - bearing.wrapped(apart)
        return np.where(self.sensors.says == Says.BEARING, turned, mean)

    def jacobian(self, state: Vector) -> Matrix:
        """Return slopes (..., m, n)."""
        return slopes(self.sensors, state, after_s=self.after_s)

    def variance(self, reading: Vector) -> Vector:
        """Return sigma^2 (..., m), whatever the reading."""
        return np.broadcast_to(self.sensors.sigma**2, reading.shape)


def expected(sensors: AngleSensors, states: Vector, *, after_s: Vector | None = None) -> Vector:
    """Mean readings (..., m) of a target in `states` (..., n), gone straight on for `after_s` (m,).

    atan2(y, x) + bias; (x vy - y vx)/(x^2 + y^2); |v - (v.u) u|/r^falloff, u the line of sight, v
    and (x, y, z) as seen from the sensor. Cheng (3), (28).
    """
    offset, velocity = _seen(sensors, states, after_s)
    out = np.empty(offset.shape[:-1])
    for says, rows in _parts(sensors):
        x, v = offset[..., rows, :], velocity[..., rows, :]
        match says:
            case Says.BEARING:
                angle = np.arctan2(x[..., 1], x[..., 0])
                out[..., rows] = bearing.wrapped(angle + sensors.bias[rows])
            case Says.RATE:
                square = x[..., 0] ** 2 + x[..., 1] ** 2
                across = x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]
                near = square < _CORE_M**2
                out[..., rows] = np.where(near, 0.0, across / np.maximum(square, _CORE_M**2))
            case Says.MOTION:
                out[..., rows] = _motion(x, v, sensors.falloff[rows]).rate
    return out


def slopes(sensors: AngleSensors, states: Vector, *, after_s: Vector | None = None) -> Matrix:
    """Slopes (..., m, n) of `expected`; zero within a micrometre of the sensor."""
    offset, velocity = _seen(sensors, states, after_s)
    d = states.shape[-1] // 2
    out = np.zeros((*offset.shape[:-1], 2 * d))
    for says, rows in _parts(sensors):
        x, v = offset[..., rows, :], velocity[..., rows, :]
        match says:
            case Says.BEARING:
                out[..., rows, :d] = bearing.slope(x)[..., :d]
            case Says.RATE:
                both = angular_rate.slope(x, v)
                out[..., rows, :d], out[..., rows, d:] = both[..., :d], both[..., 3 : 3 + d]
            case Says.MOTION:
                found = _motion(x, v, sensors.falloff[rows])
                out[..., rows, :d] = found.in_place[..., :d]
                out[..., rows, d:] = found.in_velocity[..., :d]
    if after_s is not None:
        out[..., d:] += after_s[:, None] * out[..., :d]
    return out


def of_site(site: Site) -> AngleSensors:
    """Lay out the sensors of a site; `ConfigurationError` for kinds that say no angles.

    In the plane, places are seen from the height of the targets; a sensor without one is in it.
    """
    problems = [
        f"site {site.name}: found sensor {name!r} of kind {kind_of(model)!r}, expected 'bearing', "
        "'angular_rate' or 'motion' of all: targets are tracked by one family of kinds"
        for name, model in zip(site.sensor_ids, site.models, strict=True)
        if not isinstance(model, BearingModel | AngularRateModel | MotionRateModel)
    ]
    if problems:
        raise ConfigurationError(problems[:1])
    place = np.array(site.positions, float)
    if site.target.dimensions == 2:
        height = site.target.height_m
        known = np.isfinite(place[:, 2]) & (height is not None)
        place[:, 2] = np.where(known, place[:, 2] - (height or 0.0), 0.0)
    rows = np.array([_row(model) for model in site.models], float).reshape(-1, 6)
    return AngleSensors(
        rows[:, 0].astype(np.int32), place, np.zeros_like(place), *(rows[:, i] for i in range(1, 6))
    )


def chosen(
    sensors: AngleSensors,
    rows: Sequence[int] | NDArray[np.integer[Any]],
    sigma: Vector | None = None,
) -> AngleSensors:
    """Take rows of sensors, any number of times; `sigma` (m,) replaces theirs where it is told."""
    places = np.asarray(rows, np.intp)
    columns: list[Vector] = [column[places] for column in sensors[1:]]
    taken = AngleSensors(sensors.says[places], *columns)
    if sigma is None:
        return taken
    return taken._replace(sigma=np.where(np.isnan(sigma), taken.sigma, sigma))


def require_readings(sensors: AngleSensors, value: Vector) -> None:
    """Raise `InputError` for readings that are no numbers, or not one of each sensor."""
    if value.shape != sensors.says.shape:
        raise InputError(f"found {value.size} readings of {sensors.says.size} sensors")
    if not (np.isfinite(value).all() and (sensors.sigma > 0.0).all()):
        raise InputError("found readings or sigmas that are not finite, expected finite numbers")


class _Motion(NamedTuple):
    """|v_perp| / r^p (...) and its slopes (..., 3) in place and velocity."""

    rate: Vector
    in_place: Matrix
    in_velocity: Matrix


def _motion(x: Matrix, v: Matrix, falloff: Vector) -> _Motion:
    """With w = v_perp: |w| r^-p, slopes -r^-p ((v.u) w/|w| + p |w| u) / r and r^-p w/|w|.

    A target that does not move across has no slope: there the reading has a kink.
    """
    r = np.sqrt((x**2).sum(-1))
    near = r < _CORE_M
    r = np.maximum(r, _CORE_M)
    u = x / r[..., None]
    along = (v * u).sum(-1)
    w = v - along[..., None] * u
    speed = np.sqrt((w**2).sum(-1))
    scale = np.where(near, 0.0, r**-falloff)
    direction = w / np.maximum(speed, 1e-12)[..., None]
    turned = along[..., None] * direction + (falloff * speed)[..., None] * u
    return _Motion(scale * speed, -(scale / r)[..., None] * turned, scale[..., None] * direction)


def _seen(sensors: AngleSensors, states: Vector, after_s: Vector | None) -> tuple[Matrix, Matrix]:
    """Offsets and velocities (..., m, 3) of the target as the sensors see it."""
    n = states.shape[-1]
    if n not in {4, 6}:
        raise InputError(f"found states of {n} numbers, expected 4 or 6: position and velocity")
    d = n // 2
    goes = states[..., None, d:]
    stands = states[..., None, :d]
    if after_s is not None:
        stands = stands + after_s[:, None] * goes
    offset = np.zeros((*states.shape[:-1], *sensors.place.shape)) - sensors.place
    velocity = np.zeros_like(offset) - sensors.velocity
    offset[..., :d] += stands
    velocity[..., :d] += goes
    return offset, velocity


def _parts(sensors: AngleSensors) -> list[tuple[Says, slice | Indices]]:
    """Rows of each kind that is there."""
    there = np.unique(sensors.says)
    if there.size == 1:
        return [(Says(int(there[0])), slice(None))]
    return [(Says(int(k)), np.flatnonzero(sensors.says == k).astype(np.int32)) for k in there]


def _row(model: SensorModel) -> tuple[float, ...]:
    """Say what a sensor says: kind, sigma, bias, falloff, threshold, reach."""
    match model:
        case BearingModel():
            return (Says.BEARING, model.sigma_rad, model.bias_rad, 0.0, 0.0, model.max_range_m)
        case AngularRateModel():
            return (
                *(Says.RATE, model.sigma_rad_s, 0.0, 1.0),
                *(model.threshold_rad_s, model.max_range_m),
            )
        case MotionRateModel():
            return (
                *(Says.MOTION, model.sigma, 0.0, model.falloff),
                *(model.threshold, model.max_range_m),
            )
        case _:
            return (math.nan,) * 6
