"""Following a target by integrating its velocity, which angular rates tell where it is known.

The paper's tracker, Cheng (30)-(34) in the plane: at a place x the rates of all sensors are linear
in the velocity, E(x) v = B(x), and v = (E'E)^-1 E'B is a differential equation for x. Nothing in it
pulls an estimate back: a start error stays, or grows. Kept to show just that; `angle_tracker` is
the tracker to use.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from trackfield.errors import InputError
from trackfield.filtering.matrices import apply, solve, transposed
from trackfield.types import Matrix, Vector

_LEAST = 1e-9  # of the larger eigenvalue of E'E, below which the velocity is not fixed


class RateRecord(NamedTuple):
    """What sensors read at times `t_s` (k,): `rates` (..., k, n) [rad/s], a run a leading index.

    `sensors` and `velocities` (k, n, 2) are where they were, and how they moved.
    """

    t_s: Vector
    rates: Matrix
    sensors: Matrix
    velocities: Matrix


class Observed(NamedTuple):
    """The path that was integrated: `position` and `velocity` (..., k, 2).

    `determined` (..., k): the rates fixed the velocity; where they do not, the target is left
    standing.
    """

    position: Matrix
    velocity: Matrix
    determined: NDArray[np.bool_]


def record(t_s: Vector, rates: Matrix, sensors: Matrix) -> RateRecord:
    """Make the record of sensors (n, 2) that stand, or (k, n, 2) that move along a spline.

    `InputError` for shapes that do not fit, fewer than two times or times that do not grow, and
    values that are not finite.
    """
    k = t_s.size
    n = sensors.shape[-2] if sensors.ndim in {2, 3} else 0
    if rates.shape[-2:] != (k, n) or sensors.shape not in {(n, 2), (k, n, 2)}:
        raise InputError(
            f"found times {t_s.shape}, rates {rates.shape} and sensors {sensors.shape}, "
            "expected (k,), (..., k, n) and (n, 2) or (k, n, 2)"
        )
    finite = all(np.isfinite(part).all() for part in (t_s, rates, sensors))
    if k < 2 or not finite or not (np.diff(t_s) > 0.0).all():
        raise InputError("found times that do not grow or values that are not finite")
    if sensors.ndim == 2:
        standing = np.broadcast_to(sensors, (k, n, 2))
        return RateRecord(t_s, rates, standing, np.zeros((k, n, 2)))
    moving = CubicSpline(t_s, sensors, axis=0)
    return RateRecord(t_s, rates, sensors, np.asarray(moving(t_s, 1), float))


def rows(offsets: Matrix) -> Matrix:
    """Rows E = [-y, x] (..., n, 2) of targets `offsets` (..., n, 2) away, Cheng (34)."""
    return np.stack([-offsets[..., 1], offsets[..., 0]], axis=-1)


def velocity_field(
    position: Vector, rates: Vector, *, sensors: Matrix, velocities: Matrix
) -> tuple[Vector, NDArray[np.bool_]]:
    """Velocity (..., 2) = (E'E)^-1 E'B at `position` (..., 2), and whether E has rank 2.

    B = x sy' - y sx' + rate (x^2 + y^2), (sx', sy') the sensor's own velocity. Cheng (33), (34).
    """
    offsets = position[..., None, :] - sensors
    E = rows(offsets)
    B = (E * velocities).sum(-1) + rates * (offsets**2).sum(-1)
    square = transposed(E) @ E
    roots = np.linalg.eigvalsh(square)
    good = np.asarray(roots[..., 0] > _LEAST * roots[..., 1])
    safe = np.where(good[..., None, None], square, np.eye(2))
    v = solve(safe, apply(transposed(E), B))
    return np.where(good[..., None], v, 0.0), good


def observe(given: RateRecord, start: Vector) -> Observed:
    """Integrate (33) from `start` (..., 2) over the record: Runge-Kutta steps of fourth order.

    Readings are joined by cubic splines, as in the paper's experiment.
    """
    t, runs = given.t_s, given.rates.shape[:-2]
    rates = CubicSpline(t, given.rates, axis=-2)
    places = CubicSpline(t, given.sensors, axis=0)
    moves = CubicSpline(t, given.velocities, axis=0)

    def field(time: float, x: Vector) -> tuple[Vector, NDArray[np.bool_]]:
        now = (np.asarray(part(time), float) for part in (rates, places, moves))
        z, sensors, velocities = now
        return velocity_field(x, z, sensors=sensors, velocities=velocities)

    x = np.broadcast_to(start, (*runs, 2)).astype(float)
    position, velocity = np.empty((2, *runs, t.size, 2))
    determined = np.empty((*runs, t.size), bool)
    for k, time in enumerate(t):
        v, good = field(float(time), x)
        position[..., k, :], velocity[..., k, :], determined[..., k] = x, v, good
        if k + 1 < t.size:
            dt = float(t[k + 1] - time)
            second, _ = field(time + 0.5 * dt, x + 0.5 * dt * v)
            third, _ = field(time + 0.5 * dt, x + 0.5 * dt * second)
            fourth, _ = field(time + dt, x + dt * third)
            x = x + dt / 6.0 * (v + 2.0 * second + 2.0 * third + fourth)
    return Observed(position, velocity, determined)
