"""Who is near whom in the plane, found in a tree: nothing here grows with the square of a field."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
from scipy import spatial

from trackfield.types import Indices, Matrix, Vector

_KDTree = cast("Any", spatial).KDTree  # which has no types


class Nearest(NamedTuple):
    """Number (n,) of the nearest point and its `distance` (n,) [m]; infinite where none is."""

    point: Indices
    distance: Vector


class Pairs(NamedTuple):
    """Index pairs (n,): point `first` is near place `second`, `distance` (n,) [m] apart."""

    first: Indices
    second: Indices
    distance: Vector


def nearest_point(points: Matrix, places: Matrix, *, within_m: float = math.inf) -> Nearest:
    """Find which of the `points` (m, 2) is nearest to each of `places` (n, 2), if `within_m`."""
    bound = math.nextafter(within_m, math.inf)  # the tree leaves out what is at the bound itself
    distance, index = _KDTree(points).query(places, distance_upper_bound=bound)
    return Nearest(np.asarray(index, np.int32), np.asarray(distance, np.float64))


def pairs_within(points: Matrix, radius_m: float) -> Pairs:
    """Find all pairs of different points (m, 2) that are within `radius_m`, each pair once."""
    found = np.asarray(_KDTree(points).query_pairs(radius_m, output_type="ndarray"), np.int32)
    first, second = found[:, 0], found[:, 1]
    return Pairs(first, second, _distance(points[first], points[second]))


def points_within(points: Matrix, places: Matrix, radius_m: float) -> Pairs:
    """Find all points (m, 2) within `radius_m` of each of `places` (n, 2), in order of places."""
    lists = _KDTree(points).query_ball_point(places, radius_m, return_sorted=True)
    counts = np.fromiter((len(one) for one in lists), np.int64, len(places))
    first = np.fromiter((i for one in lists for i in one), np.int32, int(counts.sum()))
    second = np.repeat(np.arange(len(places), dtype=np.int32), counts)
    return Pairs(first, second, _distance(points[first], places[second]))


def _distance(a: Matrix, b: Matrix) -> Vector:
    return np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1])
