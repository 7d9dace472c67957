"""Where all targets were at given times, and when that is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Matrix, Vector


class Paths(NamedTuple):
    """Places (steps, k, 2) [m] of k targets, NaN while a target is not there.

    `known` (steps,) tells where truth speaks at all: within its time, outside its gaps. `speed`
    (steps, k) [m/s] is NaN with the place.
    """

    position: NDArray[np.float64]
    speed: Matrix
    known: NDArray[np.bool_]


def paths_at(
    truth_s: Vector, target: Indices, *, position: Matrix, t_s: Vector, gap_s: float = 2.0
) -> Paths:
    """Interpolate truth, rows of `truth_s`, `target`, `position` (m, 2), at times `t_s` (steps,).

    A target is there from its first row to its last. A gap of its rows longer than `gap_s` leaves
    those steps unknown, and so are steps before the first row of any target and after the last.
    """
    known = (t_s >= truth_s.min()) & (t_s <= truth_s.max())
    places: list[Matrix] = []
    speeds: list[Vector] = []
    for k in np.unique(target):
        rows = np.flatnonzero(target == k)
        rows = rows[np.argsort(truth_s[rows], kind="stable")]
        times, points = truth_s[rows], position[rows]
        here = (t_s >= times[0]) & (t_s <= times[-1])
        place = np.stack([np.interp(t_s, times, points[:, a]) for a in (0, 1)], axis=1)
        speed = np.zeros(t_s.size)
        if times.size > 1:
            after = np.clip(np.searchsorted(times, t_s), 1, times.size - 1)
            spacing = times[after] - times[after - 1]
            known &= ~here | (spacing <= gap_s)
            way = np.linalg.norm(points[after] - points[after - 1], axis=1)
            speed = way / np.maximum(spacing, 1e-9)
        places.append(np.where(here[:, None], place, np.nan))
        speeds.append(np.where(here, speed, np.nan))
    return Paths(np.stack(places, axis=1), np.stack(speeds, axis=1), known)
