"""Obstacles in the plane: what is free, what is clear, and the shortest way around.

Polygons and a margin (the radius of a robot) become convex parts; all tests clip segments at their
half-planes. Shortest ways turn at corners only, where they touch: the graph of corners that see
each other is made once, with all of its shortest ways, so that a query costs two looks around.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csgraph

from trackfield._core import _clipping
from trackfield.errors import InputError
from trackfield.robot.convex_parts import Part, grown, parts_of
from trackfield.types import Matrix, Vector

_SLACK = 1e-9  # of the size of all: what touches a border does not run through
_GRAZE = 100.0  # slacks of a way: a corner that is cut by less is only touched
_dijkstra = cast("Any", csgraph).dijkstra  # which has no types


class Way(NamedTuple):
    """A way around obstacles: places (k, 2) [m] from start to end, and its length [m].

    Without a way `found` is false, the length infinite and `places` the start alone.
    """

    places: Matrix
    length_m: float
    found: bool


class Obstacles:
    """Polygons, (m, 2) [m] each, that a robot of radius `margin_m` must keep clear of; immutable.

    Borders may be touched. Polygons may overlap and need not be convex; none at all is a free
    plane. A margin is exact along edges and up to 8 % wider at corners. `InputError` for a margin
    below 0, and for polygons as `parts_of` says.
    """

    def __init__(self, polygons: Sequence[ArrayLike] = (), *, margin_m: float = 0.0) -> None:
        if not 0.0 <= margin_m < math.inf:
            raise InputError(f"margin_m: found {margin_m}, expected a length [m], 0 or more")
        parts = [grown(part, margin_m) for polygon in polygons for part in parts_of(polygon)]
        self.parts: tuple[Part, ...] = tuple(parts)
        everything = np.concatenate([part.corners for part in parts] or [np.zeros((1, 2))])
        self._slack = _SLACK * max(1e-3, float(np.abs(everything).max()))
        self._normals, self._limits = _half_planes(self.parts, self._slack)
        self.corners, self._beside = self._turning_points()
        self._distance, self._before = self._shortest_ways()

    def free(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points (..., 2) [m] are in no obstacle, (...); a border is free."""
        places = np.asarray(points, np.float64)
        if not self.parts:
            return np.ones(places.shape[:-1], np.bool_)
        over = np.einsum("pmd,...d->...pm", self._normals, places) - self._limits
        return np.asarray(~(over < 0.0).all(axis=-1).any(axis=-1))

    def clear(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.bool_]:
        """Tell which segments (..., 2), (..., 2) [m] run through no obstacle, (...)."""
        a, b = np.broadcast_arrays(np.asarray(starts, np.float64), np.asarray(ends, np.float64))
        shape, a, b = a.shape[:-1], a.reshape(-1, 2), b.reshape(-1, 2)
        if not self.parts or not len(a):
            return np.ones(shape, np.bool_)
        found = np.empty(len(a), np.uint8)
        segments = np.ascontiguousarray(a), np.ascontiguousarray(b)
        _clipping.clear(*segments, self._normals, self._limits, _GRAZE * self._slack, found)
        return found.astype(np.bool_).reshape(shape)

    def distance(self, points: ArrayLike) -> Vector:
        """How far (...) [m] points (..., 2) are from any obstacle; 0 inside, inf of none."""
        places = np.asarray(points, np.float64)
        if not self.parts:
            return np.full(places.shape[:-1], np.inf)
        _, away = self._on_borders(places)
        return np.where(self.free(places), away.min(axis=-1), 0.0)

    def nearest_free(self, point: ArrayLike) -> Vector:
        """Find the free place (2,) [m] nearest to a point (2,), which may be free itself."""
        place = np.asarray(point, np.float64)
        if self.free(place):
            return place
        on, away = self._on_borders(place)
        crossings = self._crossings()
        on = np.vstack([on, crossings])
        away = np.append(away, np.linalg.norm(crossings - place, axis=1))
        order = np.argsort(away)
        free = self.free(on[order])
        return on[order[int(np.argmax(free))]]

    def shortest_path(self, start: ArrayLike, end: ArrayLike) -> Way:
        """Shortest way from a place (2,) to another, [m]; none where one of them is not free."""
        a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
        if not self.free(np.stack([a, b])).all():
            return Way(a[None], math.inf, found=False)
        if self.clear(a, b):
            return Way(np.stack([a, b]), math.dist(a, b), found=True)
        first, out = self.seen_from(a)
        last, back = self.seen_from(b)
        if not (first.size and last.size):
            return Way(a[None], math.inf, found=False)
        total = out[:, None] + self._distance[np.ix_(first, last)] + back
        i, j = np.unravel_index(int(np.argmin(total)), total.shape)
        if not np.isfinite(total[i, j]):
            return Way(a[None], math.inf, found=False)
        between = self.corners[self._chain(int(first[i]), int(last[j]))]
        return Way(np.vstack([a, between, b]), float(total[i, j]), found=True)

    def seen_from(self, place: Vector) -> tuple[NDArray[np.intp], Vector]:
        """Corners (k,) that a way from `place` (2,) may turn at first, and how far (k,) [m]."""
        offset = self.corners - place
        near = np.flatnonzero(_touches(offset, self._beside, self._slack))
        near = near[self.clear(place, self.corners[near])]
        return near, np.linalg.norm(offset[near], axis=1)

    def ways_from(self, place: Vector) -> tuple[Vector, NDArray[np.intp]]:
        """Length [m] of the shortest way from `place` (2,) to each corner (n,); its first corner.

        Infinite where there is none.
        """
        first, out = self.seen_from(place)
        if not first.size:
            return np.full(len(self.corners), np.inf), np.zeros(len(self.corners), np.intp)
        total = out[:, None] + self._distance[first]
        best = total.argmin(axis=0)
        return total[best, np.arange(len(self.corners))], first[best]

    def between(self, first: int, last: int) -> Matrix:
        """Corners (k, 2) [m] of the shortest way from one corner to another, both included."""
        return self.corners[self._chain(first, last)]

    def edges(self) -> tuple[Matrix, Matrix]:
        """Start (e, 2) and end (e, 2) [m] of all edges of the parts, cuts included."""
        starts = np.concatenate([part.corners for part in self.parts])
        ends = np.concatenate([np.roll(part.corners, -1, axis=0) for part in self.parts])
        return starts, ends

    def _chain(self, first: int, last: int) -> list[int]:
        chain = [last]
        while chain[-1] != first:
            chain.append(int(self._before[first, chain[-1]]))
        return chain[::-1]

    def _on_borders(self, places: Matrix) -> tuple[Matrix, Vector]:
        """Nearest point (..., e, 2) on each edge of a part to places (..., 2), and how far."""
        starts, ends = self.edges()
        along = ends - starts
        offset = places[..., None, :] - starts
        share = (offset * along).sum(axis=-1) / (along * along).sum(axis=-1)
        on = starts + np.clip(share, 0.0, 1.0)[..., None] * along
        return on, np.linalg.norm(places[..., None, :] - on, axis=-1)

    def _crossings(self) -> Matrix:
        """Points (k, 2) where edges of parts cross: the inner corners of what they unite to."""
        starts, ends = self.edges()
        along = ends - starts
        offset = starts[None] - starts[:, None]
        det = _cross(along[:, None], along[None])
        det = np.where(det == 0.0, np.inf, det)
        here, there = _cross(offset, along[None]) / det, _cross(offset, along[:, None]) / det
        i, j = np.nonzero((here >= 0.0) & (here <= 1.0) & (there >= 0.0) & (there <= 1.0))
        return starts[i] + here[i, j][:, None] * along[i]

    def _turning_points(self) -> tuple[Matrix, Matrix]:
        """Corners (n, 2) that a shortest way can turn at, and the edges (n, 2, 2) beside them."""
        if not self.parts:
            return np.empty((0, 2)), np.empty((0, 2, 2))
        corners = np.concatenate([part.corners for part in self.parts])
        after = np.concatenate([np.roll(p.corners, -1, axis=0) - p.corners for p in self.parts])
        before = np.concatenate([np.roll(p.corners, 1, axis=0) - p.corners for p in self.parts])
        unit = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in (after, before)]
        outwards = -(unit[0] + unit[1])
        length = np.linalg.norm(outwards, axis=1, keepdims=True)
        turning = length[:, 0] > 1e-7  # not straight on
        outwards = outwards / np.where(length > 0.0, length, 1.0)
        kept = turning & self.free(corners) & self.free(corners + 10.0 * self._slack * outwards)
        return corners[kept], np.stack([after, before], axis=1)[kept]

    def _shortest_ways(self) -> tuple[Matrix, NDArray[np.int32]]:
        """Length (n, n) of the shortest way between each two corners, and the corner before."""
        n = len(self.corners)
        if not n:
            return np.empty((0, 0)), np.empty((0, 0), np.int32)
        offset = self.corners[None] - self.corners[:, None]
        touching = _touches(offset, self._beside, self._slack)
        i, j = np.nonzero(np.triu(touching & touching.T, 1))
        seen = self.clear(self.corners[i], self.corners[j])
        i, j = i[seen], j[seen]
        graph = np.zeros((n, n))
        graph[i, j] = graph[j, i] = np.maximum(np.linalg.norm(offset[i, j], axis=1), 1e-300)
        found = _dijkstra(graph, directed=False, return_predecessors=True)
        return np.asarray(found[0], np.float64), np.asarray(found[1], np.int32)


def _cross(a: Matrix, b: Matrix) -> Vector:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _touches(offset: Matrix, beside: Matrix, slack: float) -> NDArray[np.bool_]:
    """Whether lines along offsets (..., n, 2) to corners leave both edges beside on one side."""
    one, other = _cross(offset, beside[:, 0]), _cross(offset, beside[:, 1])
    small = slack * np.linalg.norm(beside, axis=-1).max(initial=0.0)
    return (one >= -small) & (other >= -small) | (one <= small) & (other <= small)


def _half_planes(parts: Sequence[Part], slack: float) -> tuple[Matrix, Matrix]:
    """Give normals (p, m, 2) and limits (p, m) of parts, filled up with planes that all is behind.

    Outer borders are `slack` further in, so that what touches them is free; cuts as much further
    out, so that nothing slips between two parts.
    """
    most = max((len(part.corners) for part in parts), default=0)
    normals, limits = np.zeros((len(parts), most, 2)), np.ones((len(parts), most))
    for k, (corners, inner) in enumerate(parts):
        edges = np.roll(corners, -1, axis=0) - corners
        unit = edges / np.linalg.norm(edges, axis=1, keepdims=True)
        normals[k, : len(corners)] = np.column_stack([unit[:, 1], -unit[:, 0]])
        behind = (normals[k, : len(corners)] * corners).sum(axis=1)
        limits[k, : len(corners)] = behind + np.where(inner, slack, -slack)
    return normals, limits
