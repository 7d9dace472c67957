"""A target's state from one moment's readings of motion sensors, Cheng, Ghosh, Hu: all of them.

Four sizes of motion are as many as a state in the plane has entries, and have about eight exact
states, each with either sign of the velocity; from six on there is one. So every solution comes
back, with its weight, and a verdict.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.localization.motion_modes import MotionFit
from trackfield.localization.motion_readings import readings
from trackfield.localization.motion_search import MotionSearch
from trackfield.localization.motion_window import window_fit
from trackfield.network.kinds import SensorModel
from trackfield.types import Matrix, Vector

USUAL = MotionSearch()
FEW = MotionSearch(cells=20, headings=8, finalists=100)
"""Where there are hardly more readings than unknowns, solutions are many and close together."""

_FLAT = 1e-9  # of the largest singular value


class VectorFix(NamedTuple):
    """`state` (2 n,) from vector outputs; `residual` (N,) is what they leave, in their own unit.

    Not `determined`: some direction is not fixed, and the state is the one with the shortest way to
    the middle of the sensors, or the least speed.
    """

    state: Vector
    residual: Vector
    determined: bool


def locate(
    sensors: Matrix,
    values: Vector,
    model: SensorModel,
    *,
    velocities: Matrix | None = None,
    search: MotionSearch | None = None,
) -> MotionFit:
    """Find all states (2 d,), d = 2 or 3, that explain one moment's `values` (N,).

    `model` is that of motion rates, angular rates or bearings, the same for all sensors (N, d); see
    `motion_window.window_fit` for any mixture. Sizes of motion do not tell v from -v: each state is
    then followed by the one with the opposite velocity, and the verdict is at best `EITHER_WAY`.
    """
    given = readings(model, sensors, values, velocities=velocities)
    if search is None:
        search = FEW if given.value.size < 3 * given.dimensions else USUAL
    return window_fit(given, search=search)


def locate_vectors(sensors: Matrix, outputs: Matrix, *, falloff: float = 1.0) -> VectorFix:
    """Solve vector outputs (2) (N, n) of one moment for the state (2 n,), in n dimensions.

    An output is perpendicular to the line of sight, y'(r - s) = 0, which is linear in the place r;
    then |n|^p y = v - n <n, v>/|n|^2 is linear in v: least squares both, no start, no ambiguity.
    Two sensors are enough, not in line with the target.
    """
    places, y = np.asarray(sensors, float), np.asarray(outputs, float)
    if places.ndim != 2 or places.shape != y.shape or places.shape[1] < 2:
        raise InputError(
            f"found sensors of shape {places.shape} and outputs of shape {y.shape}, "
            "expected (N, n) twice, n >= 2"
        )
    if not (np.isfinite(places).all() and np.isfinite(y).all()):
        raise InputError("sensors and outputs must be finite, found NaN or infinity")
    n, centre = places.shape[1], places.mean(axis=0)
    size = np.linalg.norm(y, axis=1, keepdims=True)
    unit = np.where(size > _FLAT * size.max(), y, 0.0) / np.where(size > 0.0, size, 1.0)
    lines = _least_squares(unit, np.sum(unit * (places - centre), axis=1))
    offsets = centre + lines.value - places
    r2 = np.maximum(np.sum(offsets**2, axis=1), np.finfo(float).tiny)
    across = np.eye(n) - offsets[:, :, None] * offsets[:, None, :] / r2[:, None, None]
    power = r2[:, None] ** (0.5 * falloff)
    speeds = _least_squares((across / power[:, :, None]).reshape(-1, n), y.ravel())
    seen = across @ speeds.value / power
    state = np.concatenate([centre + lines.value, speeds.value])
    residual = np.linalg.norm(y - seen, axis=1)
    return VectorFix(state, residual, lines.full and speeds.full)


class _Solution(NamedTuple):
    value: Vector
    full: bool


def _least_squares(rows: Matrix, right: Vector) -> _Solution:
    found, _, rank, _ = np.linalg.lstsq(rows, right, rcond=_FLAT)
    return _Solution(np.asarray(found, np.float64), int(rank) == rows.shape[1])
