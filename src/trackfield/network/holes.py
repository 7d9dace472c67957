"""Holes: connected parts of a region that too few nodes see, and how deep they are."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize
from scipy.sparse import csr_array

from trackfield.errors import InputError
from trackfield.network.boxes import Box
from trackfield.network.coverage import count_cells
from trackfield.network.node_index import NodeIndex
from trackfield.raster import Region
from trackfield.types import Matrix, Vector

_ndimage, _optimize = cast("Any", ndimage), cast("Any", optimize)  # which have no types

_JUDGES = 8  # nearest nodes that tell, beside as many as are wanted, how deep a cell is
_STEP = 2.0  # cells that a climb goes at once
_ROUNDS = 60
_FINE = 1e-12  # of a cell: who climbs less has arrived


class Hole(NamedTuple):
    """A connected part of a region that too few nodes see; `measure` [m^2], in space [m^3].

    `measure` and `centroid` (d,) [m] are those of its cells. At `deepest` (d,) [m] the reach of the
    nodes would have to grow most, by `gap_m`, and `nearest_m` is the distance to the node whose
    reach would get there (with equal reach, the nearest one).
    """

    measure: float
    centroid: Vector
    deepest: Vector
    gap_m: float
    nearest_m: float


def holes(
    nodes: NodeIndex,
    region: Region | Box,
    *,
    reach_m: float | Vector,
    times: int = 1,
    cell_m: float | None = None,
) -> tuple[Hole, ...]:
    """Find parts of a region that fewer than `times` nodes (n, d) see, the largest first.

    They are made of cells about `cell_m` wide (see `count_cells`) whose middles are not seen and
    that meet at a side: one that lies between all middles is missed. Deepest points are exact, the
    vertices where the reaches of several nodes would meet, or on the border: each is climbed to
    from the deepest cell of its hole.
    """
    if not 1 <= times <= len(nodes):
        raise InputError(f"found times = {times}, expected from 1 to the number of nodes")
    counts = count_cells(nodes, region, reach_m=reach_m, cell_m=cell_m)
    reach = np.broadcast_to(np.asarray(reach_m, np.float64), (len(nodes),))
    field = _Field(nodes, reach, times, counts.box)
    parts = _parts(counts.middle < times)
    places = [counts.box.low + (part + 0.5) * counts.cell_m for part in parts]
    depth = [_depth(middles, field) for middles in places]
    start = [middles[np.argmax(deep)] for middles, deep in zip(places, depth, strict=True)]
    peaks = _climb(np.array(start).reshape(-1, nodes.dimensions), counts.cell_m, field)
    cell = float(counts.cell_m.prod())
    found = [
        Hole(len(middles) * cell, middles.mean(axis=0), peaks.place[i], *peaks.depth[i].tolist())
        for i, middles in enumerate(places)
    ]
    return tuple(sorted(found, key=lambda hole: -hole.measure))


class _Field(NamedTuple):
    """Nodes, how far they see (n,), how many are wanted, and where."""

    nodes: NodeIndex
    reach: Vector
    times: int
    box: Box


class _Peaks(NamedTuple):
    """Deepest points (h, d) of holes; `depth` (h, 2) is the gap there, and the way to its node."""

    place: Matrix
    depth: Matrix


class _Rows(NamedTuple):
    """Nodes (m,) that bound how deep holes can be around places, and the last one of each hole.

    `hole` (m,), `gap` (m,) [m] and its `slope` (m, d) in the place; `depth` (h, 2) as in `_Peaks`.
    """

    hole: NDArray[np.int32]
    gap: Vector
    slope: Matrix
    depth: Matrix


def _parts(unseen: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Find connected parts of cells: places (c, d) of the cells of each, in the order x, y, z."""
    label, number = _ndimage.label(unseen)
    cells = np.flatnonzero(label)
    own = label.ravel()[cells] - 1
    places = np.stack(np.unravel_index(cells, unseen.shape)[::-1], axis=-1)
    ends = np.cumsum(np.bincount(own, minlength=number))
    return np.split(places[np.argsort(own, kind="stable")], ends[:-1]) if number else []


def _depth(middles: Matrix, field: _Field) -> Vector:
    """How much reach is missing (m,) at the middles of cells, judged by some of the nearest nodes.

    With unlike reach it may be missing less, of nodes farther away: good enough to begin from.
    """
    count, k = min(len(field.nodes), field.times + _JUDGES), field.times - 1
    distance, node = field.nodes.nearest(middles, count=count)
    return np.partition(distance - field.reach[node], k, axis=1)[:, k]


def _climb(start: Matrix, cell_m: Vector, field: _Field) -> _Peaks:
    """Climb from places (h, d) to where most reach is missing around, all at once.

    The gap to a node is convex, so that it grows at least as its slope says: steps that maximise
    the least gap of linear ones (one linear program for all holes) never lead down, and end at a
    vertex. Nodes that see a place already, all but the last one wanted, do not count.
    """
    place, step = start.copy(), _STEP * cell_m
    rows = _around(place, step, field, _depth(start, field) if len(start) else np.zeros(0))
    depth = rows.depth
    going = np.arange(len(place))
    for _ in range(_ROUNDS):
        if not going.size:
            break
        moved = place[going] + _ascent(place[going], rows, step, field.box)
        rows = _around(moved, step, field, depth[going, 0] + float(np.linalg.norm(step)))
        better = rows.depth[:, 0] > depth[going, 0]
        far = better & (rows.depth[:, 0] - depth[going, 0] > _FINE * cell_m.min())
        place[going[better]], depth[going[better]] = moved[better], rows.depth[better]
        going, rows = going[far], _of(rows, far)
    return _Peaks(place, depth)


def _around(place: Matrix, step: Vector, field: _Field, most: Vector) -> _Rows:
    """Nodes whose gap can be the deciding one within a step of places (h, d) of gap <= `most`."""
    span = 2.0 * float(np.linalg.norm(step))
    near = field.nodes.within(place, np.maximum(most + span, 0.0) + float(field.reach.max()))
    distance = np.linalg.norm(near.offset, axis=1)
    gap = distance - field.reach[near.node]
    order = np.lexsort((gap, near.place))
    hole, gap, distance = near.place[order], gap[order], distance[order]
    first = np.searchsorted(hole, np.arange(len(place)))
    last = first + field.times - 1
    rank = np.arange(hole.size) - first[hole]
    kept = np.flatnonzero((rank >= field.times - 1) & (gap <= gap[last][hole] + span))
    away = distance[kept]
    slope = -near.offset[order][kept] / np.where(away > 0.0, away, 1.0)[:, None]
    return _Rows(hole[kept], gap[kept], slope, np.column_stack([gap[last], distance[last]]))


def _of(rows: _Rows, chosen: NDArray[np.bool_]) -> _Rows:
    """Rows of the holes that are chosen (h,), which are numbered anew."""
    number = np.cumsum(chosen, dtype=np.int32) - 1
    kept = chosen[rows.hole]
    return _Rows(number[rows.hole[kept]], rows.gap[kept], rows.slope[kept], rows.depth[chosen])


def _ascent(place: Matrix, rows: _Rows, step: Vector, box: Box) -> Matrix:
    """Find moves (h, d), in the box and a step, that maximise the least linear gap of each hole."""
    h, d = place.shape
    m = rows.hole.size
    first = d * rows.hole.astype(np.intp)
    columns = np.column_stack([*(first + axis for axis in range(d)), d * h + rows.hole])
    values = np.column_stack([-rows.slope, np.ones(m)])
    entries = (values.ravel(), columns.ravel(), (d + 1) * np.arange(m + 1))
    limits = csr_array(entries, shape=(m, (d + 1) * h))
    low, high = np.maximum(box.low - place, -step), np.minimum(box.high - place, step)
    free = np.full(h, np.inf)
    found = _optimize.linprog(
        np.concatenate([np.zeros(d * h), -np.ones(h)]),
        A_ub=limits,
        b_ub=rows.gap,
        bounds=np.column_stack([np.append(low.ravel(), -free), np.append(high.ravel(), free)]),
        method="highs",
    )
    # Should the solver give up, nobody moves: who stays has arrived.
    moves = np.zeros(d * h) if found.x is None else np.asarray(found.x[: d * h], np.float64)
    return np.clip(moves.reshape(h, d), low, high)
