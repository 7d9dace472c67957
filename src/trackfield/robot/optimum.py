"""The shortest path that visits discs in order: what a robot that knew all could not walk under.

    minimise sum_k |x_k - x_{k-1}|  over  |x_k - c_k| <= r_k,  x_0 given

is a second-order cone program. Newton's method follows its barrier; the dual variables that this
leaves bound every path from below, whatever the rounding, so that the answer proves itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield._core import _touring
from trackfield.errors import InputError
from trackfield.robot.rule import checked_track
from trackfield.types import Matrix, Vector

_STEPS = 400  # of Newton's method; 40 to 90 are usual


class Tour(NamedTuple):
    """A path (n, 2) [m], a place a disc, its length, and the length that none can be below [m].

    `met`: the two are as near as was asked.
    """

    path: Matrix
    length_m: float
    bound_m: float
    met: bool


def shortest_tour(
    start: Vector, centres: Matrix, *, radius_m: float | Vector, gap: float = 1e-5
) -> Tour:
    """Find the shortest path from `start` (2,) with its k-th place in the k-th disc, (n, 2) [m].

    Discs of `radius_m` (n,) around `centres` (n, 2). The path is feasible, and longer than the
    bound by `gap` of its length (or of the least radius) at most where `met`. Needs O(n) time a
    Newton step. `InputError` for radii that are not above 0.
    """
    place, discs = checked_track(start, centres)
    radii = np.array(np.broadcast_to(np.asarray(radius_m, np.float64), len(discs)))
    if not (np.isfinite(radii).all() and (radii > 0.0).all()):
        raise InputError(f"radius_m: found {radii.min()}, expected lengths [m] above 0")
    still = radii - np.linalg.norm(discs - place, axis=1)
    if (still >= 0.0).all():
        return Tour(np.tile(place, (len(discs), 1)), 0.0, 0.0, met=True)
    # what no path can do without: into the disc that is farthest from the start
    scale = max(float(-still.min()), float(radii.min()))
    path, length, bound, _, met = _touring.tour(
        place, np.ascontiguousarray(discs), radii, gap * scale, _STEPS
    )
    return Tour(path, length, max(bound, float(-still.min())), met)
