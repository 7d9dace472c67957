"""What a field of nodes sees: how much of the region, how many times, and where it does not.

A node sees what is within its reach. In the plane shares are exact; in space, and for the shape of
holes, the region is cut in cells, and what that leaves open is said.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.boxes import Box, box_of
from trackfield.network.discs import depths
from trackfield.network.node_index import NodeIndex, each_reach
from trackfield.raster import Raster, Region
from trackfield.types import Indices, Matrix, Vector

_FINENESS = {2: 20, 3: 8}  # cells to a mean reach, if nobody asks for another size
_SLACK = 1e-9  # of a reach: what is just within it is, rounded or not
_MOST_CELLS = 4_000_000


class Coverage(NamedTuple):
    """Shares of a region that at least 1, 2, .. nodes see.

    `share` (times,) lies between `low` and `high`, which are the same where it is exact. Every
    place is seen by `least` nodes; `cell_m` (d,) is the size of cells, 0 where none are needed.
    """

    share: Vector
    low: Vector
    high: Vector
    least: int
    cell_m: Vector


class Counts(NamedTuple):
    """Of each cell of a box, shape (.., y, x): how many nodes see its middle.

    At least `low` see the whole of it, and at most `high` any of it.
    """

    middle: NDArray[np.int32]
    low: NDArray[np.int32]
    high: NDArray[np.int32]
    box: Box

    @property
    def cell_m(self) -> Vector:
        """Size of a cell (d,) [m]."""
        return self.box.size / np.array(self.middle.shape[::-1])


def coverage(
    nodes: NodeIndex,
    region: Region | Box,
    *,
    reach_m: float | Vector,
    times: int = 4,
    cell_m: float | None = None,
) -> Coverage:
    """Measure how much of a region is within reach of at least 1 to `times` nodes (n, d).

    `reach_m` is one number or (n,). In the plane the shares are exact to rounding: areas between
    arcs. In space they are those of the middles of cells about `cell_m` wide, see `count_cells`;
    `low` and `high` hold for certain, since they count cells that are seen as a whole, and at all.
    """
    reach = each_reach(nodes, reach_m)
    if times < 1:
        raise InputError(f"found times = {times}, expected 1 or more")
    box = _box(nodes, region)
    if box.dimensions == 2:
        plane = Region(*box.low.tolist(), *box.high.tolist())
        found = depths(nodes, reach, region=plane, most=times)
        share = found.areas / plane.area
        return Coverage(share, share, share, found.least, np.zeros(2))
    counts = count_cells(nodes, box, reach_m=reach, cell_m=cell_m)
    return Coverage(
        share=_shares(counts.middle, times),
        low=_shares(counts.low, times),
        high=_shares(counts.high, times),
        least=int(counts.low.min()),
        cell_m=counts.cell_m,
    )


def times_seen(nodes: NodeIndex, places: Matrix, *, reach_m: float | Vector) -> Indices:
    """Count how many nodes (n, d) see each of `places` (p, d), of a surface or anywhere, (p,)."""
    reach = each_reach(nodes, reach_m)
    near = nodes.within(places, float(reach.max()))
    seen = np.linalg.norm(near.offset, axis=1) <= reach[near.node] * (1.0 + _SLACK)
    return np.bincount(near.place[seen], minlength=len(places)).astype(np.int32)


def count_cells(
    nodes: NodeIndex,
    region: Region | Box,
    *,
    reach_m: float | Vector,
    cell_m: float | None = None,
) -> Counts:
    """Count how many nodes see each cell of a region, about `cell_m` wide.

    If nothing is said, 20 cells go to the mean reach in the plane and 8 in space, or as many as
    keep the whole below four million.
    """
    reach, box = each_reach(nodes, reach_m), _box(nodes, region)
    usual = float(reach.mean()) / _FINENESS[box.dimensions]
    least = (box.measure / (0.9 * _MOST_CELLS)) ** (1.0 / box.dimensions)
    wide = max(usual, least) if cell_m is None else cell_m
    if not (wide > 0.0 and box.measure / wide**box.dimensions <= _MOST_CELLS):
        raise InputError(
            f"found cells of {wide:g} m in a region of {box.size.tolist()} m, expected at most "
            f"{_MOST_CELLS} cells"
        )
    shape = tuple(max(1, round(size / wide)) for size in box.size[::-1].tolist())
    middle, low, high = np.zeros((3, *shape), np.int32)
    counts = Counts(middle, low, high, box)
    half = float(np.linalg.norm(counts.cell_m)) / 2.0
    for place, radius in zip(nodes.positions - box.low, reach, strict=True):
        _stamp(counts, place, (float(radius), half))
    return counts


def count_map(
    nodes: NodeIndex, region: Region, *, reach_m: float | Vector, cell_m: float | None = None
) -> Raster:
    """Map how many nodes see the middle of each cell of a region of the plane."""
    counts = count_cells(nodes, region, reach_m=reach_m, cell_m=cell_m)
    return Raster(region, counts.middle.astype(np.float64))


def _stamp(counts: Counts, place: Vector, radii: tuple[float, float]) -> None:
    """Count a node at a place, from the box's low corner, in the cells around it."""
    reach, half = radii
    window: list[slice] = []
    distance2 = np.zeros(())
    sizes = zip(place[::-1], counts.cell_m[::-1], counts.middle.shape, strict=True)
    for where, cell, cells in sizes:
        first = max(0, math.floor((where - reach - half) / cell))
        last = min(cells, math.ceil((where + reach + half) / cell))
        offsets = (np.arange(first, max(first, last)) + 0.5) * cell - where
        window.append(slice(first, max(first, last)))
        distance2 = distance2[..., None] + offsets**2
    there = tuple(window)
    counts.middle[there] += distance2 <= reach**2
    counts.high[there] += distance2 <= (reach + half) ** 2
    if reach >= half:
        counts.low[there] += distance2 <= (reach - half) ** 2


def _shares(counts: NDArray[np.int32], times: int) -> Vector:
    """Share of cells that at least 1 to `times` nodes see."""
    seen = np.bincount(np.minimum(counts, times).ravel(), minlength=times + 1)
    return seen[::-1].cumsum()[::-1][1:] / counts.size


def _box(nodes: NodeIndex, region: Region | Box) -> Box:
    box = box_of(region)
    if box.dimensions != nodes.dimensions:
        raise InputError(
            f"found nodes of {nodes.dimensions} dimensions in a region of {box.dimensions}"
        )
    return box
