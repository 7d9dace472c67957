"""Pham's Function-2D and Function-3D: sensors chosen by the angles at which they see the target.

They look at O(n^2) angles and at no covariance. `selection.select` looks at all sets in less time.
"""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.localization.trilateration import ordinary_covariance
from trackfield.types import Indices, Matrix, Vector


def function_2d(sensors: Matrix, position: Vector, *, printed: bool = False) -> Indices:
    """Three of `sensors` (n, 2) [m] for a target at `position` (2,), Pham 3.4, Function-2D.

    Steps 1 and 2 take the pair nearest to a right angle, |cos a| least. Step 4 takes the third, at
    signed angle b from the first of the pair as a is: cos(2b - a) LEAST for a < 90 deg, else most.
    Pham has it the other way round, which is `printed`, and the worst third sensor for the pair.
    Returns their rows, ascending; of equal ones the first. `InputError` for fewer than three
    sensors, or one where the target is.
    """
    u = _directions(sensors, position, 3)
    i, j = _squarest(u)
    angles = np.arctan2(u[:, 1], u[:, 0])
    a = _turned(angles[j] - angles[i])
    b = np.copysign(1.0, a) * (angles - angles[i])
    wanted = np.cos(2.0 * b - abs(a))
    if (abs(a) < 0.5 * np.pi) != printed:
        wanted = -wanted
    return _sorted(i, j, _first_most(wanted, (i, j)))


def function_3d(sensors: Matrix, position: Vector, *, printed: bool = False) -> Indices:
    """Four of `sensors` (n, 3) [m] for a target at `position` (3,), Pham 3.4, Function-3D.

    The pair nearest to a right angle; the third whose line of sight is nearest to the normal of
    their plane; the fourth of least trace: that of the bound of four ranges, or as `printed` that
    of trilateration, Theta (3.13), which is another matter in space: four sensors near a plane
    leave its least squares hardly anything. Returns their rows, ascending. `InputError` for fewer
    than four sensors, or one where the target is.
    """
    u = _directions(sensors, position, 4)
    i, j = _squarest(u)
    k = _first_most(np.abs(u @ np.cross(u[i], u[j])), (i, j))
    if not printed:
        return _sorted(i, j, k, _next(u, (i, j, k)))
    rest = [m for m in range(len(u)) if m not in (i, j, k)]
    return _sorted(i, j, k, min(rest, key=lambda m: _theta(sensors[[i, j, k, m]], position)))


def best_pair_and_next(sensors: Matrix, position: Vector, k: int) -> Indices:
    """Pick the best pair of `sensors` (n, d) [m], and the next of least trace until there are k.

    What the Functions approximate: in the plane the pair is the same. Rows, ascending.
    `InputError` for fewer than k sensors, k < 2, or a sensor where the target is.
    """
    if k < 2:
        raise InputError(f"sensors to select: found {k}, expected at least 2")
    u = _directions(sensors, position, k)
    chosen = _squarest(u)
    while len(chosen) < k:
        chosen = (*chosen, _next(u, chosen))
    return _sorted(*chosen)


def _directions(sensors: Matrix, position: Vector, least: int) -> Matrix:
    """Give unit vectors (n, d) from the target to the sensors."""
    offsets = np.asarray(sensors, float) - position
    r = np.linalg.norm(offsets, axis=1)
    if len(offsets) < least:
        raise InputError(f"sensors: found {len(offsets)}, expected at least {least}")
    if not (np.isfinite(r).all() and (r > 0.0).all()):
        i = int(np.flatnonzero(~(r > 0.0) | ~np.isfinite(r))[0])
        raise InputError(f"sensor {i}: found distance {r[i]:g}, expected it away from the target")
    return offsets / r[:, None]


def _squarest(u: Matrix) -> tuple[int, ...]:
    """Pair nearest to a right angle."""
    i, j = np.triu_indices(len(u), 1)
    least = int(np.argmin(np.abs((u @ u.T)[i, j])))
    return int(i[least]), int(j[least])


def _next(u: Matrix, chosen: tuple[int, ...]) -> int:
    """Sensor with which the trace of the bound is least."""
    rows = u[list(chosen)]
    informations = rows.T @ rows + u[:, :, None] * u[:, None, :]
    roots = np.linalg.eigvalsh(informations)
    return _first_most(-(1.0 / np.maximum(roots, 1e-12)).sum(axis=1), chosen)


def _theta(sensors: Matrix, position: Vector) -> float:
    """Trace of trilateration's covariance over sigma^2, to first order."""
    return float(np.trace(ordinary_covariance(sensors, position, sigma_m=1.0, first_order=True)))


def _first_most(wanted: Vector, taken: tuple[int, ...]) -> int:
    wanted = wanted.copy()
    wanted[list(taken)] = -np.inf
    return int(np.argmax(wanted))


def _turned(angle: float) -> float:
    """Bring an angle into -pi to pi."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _sorted(*chosen: int) -> Indices:
    return np.sort(np.array(chosen, np.int32))
