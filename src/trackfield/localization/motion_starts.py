"""States from which maxima of the likelihood are searched: places on a grid, velocities solved for.

Each is built from the readings nearest to time 0.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from trackfield.linalg import solve
from trackfield.localization.motion_readings import BEARING, MOTION, RATE, MotionReadings
from trackfield.types import Matrix, Vector

if TYPE_CHECKING:
    from trackfield.localization.motion_search import MotionSearch

_INNER, _OUTER = 1.5, (0.25, 0.5, 1.0)  # grid in halves of the diagonal, rings in reaches
_AROUND = (0.04, 0.16)  # rings about each sensor, in halves of the diagonal
_SIDES = 6  # of a ring
_NEAR = 2  # readings of each sensor from which velocities are solved
_RIDGE = 1e-10


def start_states(
    given: MotionReadings, centre: Vector, half_m: float, *, reach_m: float, search: MotionSearch
) -> Matrix:
    """States (k, 2 d) at time 0 to start from; see the module."""
    p = places(given, centre, half_m, reach_m=reach_m, cells=search.cells)
    rows = given.value.size
    kept = min(rows, max(_NEAR * (int(given.source.max()) + 1), 2 * given.dimensions))
    near = given.rows(np.argsort(np.abs(given.t_s), kind="stable")[:kept])
    velocities: list[Matrix] = []
    if np.sum(near.kind == RATE) >= given.dimensions:
        velocities.append(from_rates(near.rows(near.kind == RATE), p))
    if np.sum(near.kind == MOTION) >= given.dimensions:
        v = from_sizes(near.rows(near.kind == MOTION), p)
        velocities += [v] if given.reversible else [v, -v]
    units = _directions(given.dimensions, search.headings, half=given.reversible)
    speeds = from_heading(near, p, units)
    if speeds is None:  # bearings alone: as fast as to cross the field while they were read
        duration = float(np.ptp(given.t_s))
        usual = 0.5 * half_m / duration if duration > 0.0 else 0.0
        speeds = np.full((len(units), len(p)), usual)
    velocities += [speed[:, None] * unit for speed, unit in zip(speeds, units, strict=True)]
    return np.concatenate([np.hstack([p, v]) for v in velocities])


def places(
    given: MotionReadings, centre: Vector, half_m: float, *, reach_m: float, cells: int
) -> Matrix:
    """Places (k, d): a grid over the sensors, rings about each sensor and far out."""
    d = given.dimensions
    side = np.linspace(-1.0, 1.0, cells if d == 2 else max(cells // 2, 2))
    grid = np.stack(np.meshgrid(*[side] * d), axis=-1).reshape(-1, d)
    units = _directions(d, _SIDES // 2, half=False)
    sensors = np.unique(given.sensors, axis=0)[:64]
    about = [sensors[:, None] + half_m * share * units for share in _AROUND]
    out = [centre + reach_m * share * _directions(d, _SIDES, half=False) for share in _OUTER]
    inner = centre + min(_INNER * half_m, reach_m) * grid
    return np.concatenate([inner, *(ring.reshape(-1, d) for ring in (*about, *out))])


def from_rates(given: MotionReadings, p: Matrix) -> Matrix:
    """Velocities (k, d) that fit angular rates best with the target at places `p` (k, d).

    (o x v) / r^2 = rate is linear in v, o the place from the sensor.
    """
    o = (p[:, None] - given.sensors)[..., :2]
    r2 = np.maximum(np.sum(o**2, axis=-1), np.finfo(float).tiny)
    rows = np.stack([-o[..., 1], o[..., 0]], axis=-1) / r2[..., None]
    told = given.value + np.sum(rows * given.velocities[:, :2], axis=-1)
    weight = 1.0 / np.hypot(given.sigma, 0.2 * np.abs(given.value))
    plane = _least_squares(rows * weight[:, None], told * weight)
    return np.pad(plane, ((0, 0), (0, p.shape[1] - 2)))


def from_sizes(given: MotionReadings, p: Matrix) -> Matrix:
    """Velocities (k, d), but for their signs, that fit sizes of motion with the target at `p`.

    z^2 r^(2 f + 2) = v' (r^2 I - o o') v is linear in V = v v': least squares, then the nearest V
    of rank one, then the length that fits best.
    """
    d = p.shape[1]
    o = p[:, None] - given.sensors
    r2 = np.maximum(np.sum(o**2, axis=-1), np.finfo(float).tiny)
    seen = r2[..., None, None] * np.eye(d) - o[..., :, None] * o[..., None, :]
    i, j = np.triu_indices(d)
    rows = seen[..., i, j] * np.where(i == j, 1.0, 2.0) / (r2 ** (given.falloff + 1.0))[..., None]
    size = np.abs(given.value)
    weight = 1.0 / np.maximum(size, 0.1 * size.max() + np.finfo(float).tiny)
    found = _least_squares(rows * weight[:, None], size**2 * weight)
    V = np.zeros((len(p), d, d))
    V[:, i, j] = V[:, j, i] = found
    roots, axes = np.linalg.eigh(V)
    v = axes[..., -1] * np.sqrt(np.maximum(roots[:, -1:], 0.0))
    return v * _length(_sizes(given, o, v), size)[:, None]


def from_heading(given: MotionReadings, p: Matrix, units: Matrix) -> Matrix | None:
    """Speeds (h, k) that fit best for headings `units` (h, d) at places `p`; None of bearings."""
    own = given.rows(given.kind != BEARING)
    if not own.value.size:
        return None
    o = p[:, None] - own.sensors
    r2 = np.maximum(np.sum(o[..., :2] ** 2, axis=-1), np.finfo(float).tiny)
    size, signed = np.abs(own.value), own.kind == RATE
    out: list[Vector] = []
    for unit in units:
        turn = (o[..., 0] * unit[1] - o[..., 1] * unit[0]) / r2
        h = np.where(signed, turn, _sizes(own, o, np.broadcast_to(unit, p.shape)))
        out.append(_length(h, np.where(signed, own.value, size)))
    return np.array(out)


def _sizes(given: MotionReadings, o: Matrix, v: Matrix) -> Matrix:
    """Sizes (k, m) of motions at `v` (k, d) across the lines of sight `o` (k, m, d)."""
    r2 = np.maximum(np.sum(o**2, axis=-1), np.finfo(float).tiny)
    along = np.sum(o * v[:, None], axis=-1)
    across = np.sum(v**2, axis=-1)[:, None] - along**2 / r2
    return np.sqrt(np.maximum(across, 0.0)) / r2 ** (0.5 * given.falloff)


def _length(h: Matrix, z: Vector) -> Vector:
    """Factor (k,) by which `h` (k, m) comes nearest to `z` (m,)."""
    return np.asarray((h @ z) / np.maximum(np.sum(h**2, axis=-1), np.finfo(float).tiny))


def _least_squares(rows: Matrix, right: Matrix) -> Matrix:
    """Solve `rows` (k, m, u) x = `right` (k, m) or (m,), hardly damped."""
    square = np.swapaxes(rows, -1, -2) @ rows
    size = np.trace(square, axis1=-2, axis2=-1) + np.finfo(float).tiny
    ridge = _RIDGE * size[:, None, None] * np.eye(rows.shape[-1])
    other = np.sum(rows * np.broadcast_to(right, rows.shape[:-1])[..., None], axis=-2)
    return solve(square + ridge, other[..., None]).value[..., 0]


def _directions(d: int, count: int, *, half: bool) -> Matrix:
    """Spread unit vectors (k, d) over a circle or sphere, 2 `count` of them or over `half` of it.

    On a sphere, Fibonacci's lattice.
    """
    k = count if half else 2 * count
    if d == 2:
        angle = np.arange(k) * (math.pi / count)
        return np.column_stack([np.cos(angle), np.sin(angle)])
    z = (np.arange(k) + 0.5) / k * (1.0 if half else 2.0) - (0.0 if half else 1.0)
    turn = np.arange(k) * (math.pi * (3.0 - math.sqrt(5.0)))
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
