"""Rooms: which one a place is in, how likely each is, and what is wrong with some."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from trackfield.network.site import Room
from trackfield.sensing.detection_regions import depth_in_polygon, polygon_fault
from trackfield.types import Indices, Matrix, Vector

_TOUCHING = 1e-6  # of a room's size: what rooms may overlap by rounding
_POINTS = 256  # of a Gaussian
_CHUNK = 4096  # Gaussians at once


def room_at(rooms: Sequence[Room], positions: Matrix) -> Indices:
    """Find the number (...) of the room that each of `positions` (..., 2) [m] is in; -1: in none.

    A place on a wall that two rooms share belongs to the first of them.
    """
    found = np.full(positions.shape[:-1], -1, np.int32)
    for number in range(len(rooms) - 1, -1, -1):
        found[depth_in_polygon(positions, np.array(rooms[number].polygon)) >= 0.0] = number
    return found


def room_shares(rooms: Sequence[Room], mean: Matrix, covariance: Matrix) -> Matrix:
    """Probabilities (m, k + 1) that N(mean, covariance) is in each of k rooms; last: in none.

    `mean` (m, 2) [m], `covariance` (m, 3) xx, xy, yy [m^2]. By 256 points of even spread, so that
    it is exact to about 1/100 and the same at every call.
    """
    xx, xy, yy = np.maximum(covariance, np.array([1e-12, -np.inf, 1e-12])).T
    down = np.sqrt(xx)
    lean = xy / down
    up = np.sqrt(np.maximum(yy - lean**2, 0.0))
    standard = _standard_points()
    shares = np.empty((len(mean), len(rooms) + 1))
    for first in range(0, len(mean), _CHUNK):
        rows = slice(first, first + _CHUNK)
        x = mean[rows, :1] + down[rows, None] * standard[:, 0]
        y = mean[rows, 1:2] + lean[rows, None] * standard[:, 0] + up[rows, None] * standard[:, 1]
        where = room_at(rooms, np.stack([x, y], axis=-1))
        for number in range(len(rooms)):
            shares[rows, number] = np.mean(where == number, axis=1)
        shares[rows, -1] = np.mean(where < 0, axis=1)
    return shares


def shares_of_places(rooms: Sequence[Room], places: Matrix, weights: Vector) -> Vector:
    """Probabilities (k + 1,) of rooms, last: of none, by `weights` (p,) of `places` (p, 2) [m]."""
    where = room_at(rooms, places)
    shares = np.bincount(np.where(where < 0, len(rooms), where), weights, minlength=len(rooms) + 1)
    return shares / shares.sum()


def room_faults(rooms: Sequence[Room]) -> Iterator[tuple[int, str]]:
    """Say what is wrong, with the number of the room: its polygon, its name, what it overlaps."""
    sound: list[int] = []
    for number, room in enumerate(rooms):
        fault = polygon_fault(np.array(room.polygon, float).reshape(-1, 2))
        if fault is not None:
            yield number, f"polygon: {fault}"
        else:
            sound.append(number)
        if not room.id.isprintable() or room.id.strip() != room.id or not room.id:
            yield number, f"id: found {room.id!r}, expected a name without outer spaces"
        if room.id in [other.id for other in rooms[:number]]:
            yield number, f"id: found {room.id!r} a second time"
    for first, second in combinations(sound, 2):
        if _overlap(np.array(rooms[first].polygon), np.array(rooms[second].polygon)):
            yield (
                second,
                f"polygon: found an overlap with {rooms[first].id!r}, "
                "expected rooms that share walls at most",
            )


def _standard_points() -> Matrix:
    """Points (256, 2) of a standard Gaussian: a golden lattice through its quantiles."""
    k = np.arange(_POINTS) + 0.5
    return ndtri(np.column_stack([k / _POINTS, (k * 0.6180339887498949) % 1.0]))


def _overlap(a: Matrix, b: Matrix) -> bool:
    """Tell whether two simple polygons share more than walls.

    If so, a piece of one's border is inside the other, or they are the same.
    """
    size = max(np.ptp(a, axis=0).max(), np.ptp(b, axis=0).max())
    apart = (a.min(axis=0) >= b.max(axis=0)) | (b.min(axis=0) >= a.max(axis=0))
    if apart.any():
        return False
    pieces = ((_middles(a, b), b), (_middles(b, a), a), (_inner_point(a), b))
    return any(
        bool((depth_in_polygon(points, other) > _TOUCHING * size).any()) for points, other in pieces
    )


def _middles(a: Matrix, b: Matrix) -> Matrix:
    """Middles of the pieces that the sides of `b` cut the sides of `a` into."""
    found: list[Matrix] = []
    for start, end in zip(a, np.roll(a, -1, axis=0), strict=True):
        cuts = np.unique(np.concatenate([[0.0, 1.0], _cuts(start, end, b)]))
        middles = 0.5 * (cuts[1:] + cuts[:-1])
        found.append(start + middles[:, None] * (end - start))
    return np.concatenate(found)


def _cuts(start: Vector, end: Vector, b: Matrix) -> Vector:
    """Shares of the way from `start` to `end` at which it meets lines through the sides of `b`."""
    along, side = end - start, np.roll(b, -1, axis=0) - b
    across = along[0] * side[:, 1] - along[1] * side[:, 0]
    offset = b - start
    with np.errstate(divide="ignore", invalid="ignore"):  # of sides that run alike
        share = (offset[:, 0] * side[:, 1] - offset[:, 1] * side[:, 0]) / across
    return share[(share > 0.0) & (share < 1.0)]


def _inner_point(a: Matrix) -> Matrix:
    """Return a point (1, 2) well inside a simple polygon: the deepest middle of a level line."""
    levels = np.unique(a[:, 1])
    points: list[NDArray[np.float64]] = []
    for y in 0.5 * (levels[1:] + levels[:-1]):
        ends = np.roll(a, -1, axis=0)
        crossed = (a[:, 1] > y) != (ends[:, 1] > y)
        start, end = a[crossed], ends[crossed]
        x = np.sort(start[:, 0] + (y - start[:, 1]) * (end - start)[:, 0] / (end - start)[:, 1])
        points += [np.array([middle, y]) for middle in 0.5 * (x[::2] + x[1::2])]
    every = np.array(points)
    return every[[int(depth_in_polygon(every, a).argmax())]]
