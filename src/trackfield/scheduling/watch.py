"""Who watches the border while nobody is inside: shifts of nodes that see whatever comes in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.node_index import NodeIndex, each_reach
from trackfield.raster import Region, cell_centres
from trackfield.types import Indices, Matrix, Vector

_FINENESS = 20  # cells to a reach, if nobody asks for another size
# Tried in turn, while there are fewer shifts than there may be.
_PRICES = (1.0, 10.0, 0.1, 100.0, 0.0)
_MOST_CELLS = 2_000_000


class _Rows(NamedTuple):
    """What belongs to each of n things: of thing i, `items[start[i] : start[i + 1]]`."""

    start: NDArray[np.int64]
    items: Indices

    def of(self, i: int) -> Indices:
        """Items of a thing."""
        return self.items[self.start[i] : self.start[i + 1]]


class Watch(NamedTuple):
    """Disjoint `shifts` of nodes, each of which sees the whole belt along the border.

    There are at most `most` shifts: so many nodes, counted exactly, see the cell of the belt that
    the fewest see. `open` (c, 2) [m] are centres of cells that no node sees for certain: what comes
    in there may go unseen, and the shifts see all the others.
    """

    shifts: tuple[Indices, ...]
    most: int
    open: Matrix


def watch_border(
    nodes: NodeIndex,
    region: Region,
    *,
    reach_m: float | Vector,
    depth_m: float,
    most: int = 1000,
    cell_m: float | None = None,
) -> Watch:
    """Share out nodes (n, 2) in shifts that each see all within `depth_m` inside of the border.

    Where `depth_m` = v_max times the step between looks, whoever comes in at most that fast stands
    in the belt at the first look, and is seen within a step. `reach_m` is one number or (n,). The
    belt is cut in cells, about `cell_m` wide, and a node sees those that lie in its disc as a
    whole: a shift misses nothing between the centres, at the price of half a cell's diagonal of
    reach. Shifts are found greedily, the cells that few nodes see first; at most `most` of them.
    """
    if nodes.dimensions != 2:
        raise InputError("found nodes in space, expected (n, 2): a border is watched in the plane")
    if not depth_m > 0.0:
        raise InputError(f"found a depth of {depth_m:g} m, expected one above 0")
    reach = each_reach(nodes, reach_m)
    cells, half = _belt(
        region, depth_m, float(reach.max()) / _FINENESS if cell_m is None else cell_m
    )
    watcher, cell = _seen(nodes.positions, cells, reach - half)
    watchers = np.bincount(cell, minlength=len(cells))
    seen = watchers > 0
    bound = int(watchers[seen].min()) if seen.any() else 0
    number = np.cumsum(seen, dtype=np.int32) - 1  # of a cell among those that somebody sees
    shifts = _shifts(
        _rows(watcher, number[cell], len(nodes)),
        _rows(number[cell], watcher, int(seen.sum())),
        most=min(bound, most),
    )
    return Watch(shifts, bound, cells[~seen])


def on_duty(watch: Watch, turn: int) -> Indices:
    """Nodes of the shift of a turn, round robin; none where there is no shift."""
    if not watch.shifts:
        return np.empty(0, np.int32)
    return watch.shifts[turn % len(watch.shifts)]


def _belt(region: Region, depth_m: float, cell_m: float) -> tuple[Matrix, float]:
    """Centres (c, 2) of the cells that touch the belt, and half a cell's diagonal [m]."""
    x_min, y_min, x_max, y_max = region
    if not (cell_m > 0.0 and region.area > 0.0 and region.area / cell_m**2 <= _MOST_CELLS):
        raise InputError(
            f"found cells of {cell_m:g} m in a region {list(region)}, expected a region with an "
            f"area, and at most {_MOST_CELLS} cells in it"
        )
    centres, (rows, columns) = cell_centres(region, cell_m)
    size = np.array([(x_max - x_min) / columns, (y_max - y_min) / rows])
    inside = np.minimum(centres - region[:2], region[2:] - centres) - size / 2.0
    return centres[inside.min(axis=1) < depth_m], float(np.hypot(*size)) / 2.0


def _seen(nodes: Matrix, cells: Matrix, reach: Vector) -> tuple[Indices, Indices]:
    """Pairs (m,) of a node (n, 2) and a cell (c, 2) whose centre is within its `reach` (n,)."""
    able = np.flatnonzero(reach >= 0.0)
    found = NodeIndex(cells).within(nodes[able], reach[able])
    return able[found.place].astype(np.int32), found.node


def _rows(owner: Indices, items: Indices, count: int) -> _Rows:
    order = np.argsort(owner, kind="stable")
    ends = np.cumsum(np.bincount(owner, minlength=count), dtype=np.int64)
    return _Rows(np.append(np.int64(0), ends), items[order])


def _shifts(sees: _Rows, seen_by: _Rows, *, most: int) -> tuple[Indices, ...]:
    """Find up to `most` disjoint sets of nodes that each see all cells, the most of a few tries."""
    best: tuple[Indices, ...] = ()
    for price in _PRICES:
        found = _disjoint(sees, seen_by, most=most, price=price)
        best = max(best, found, key=len)
        if len(best) == most:
            break
    return best


def _disjoint(sees: _Rows, seen_by: _Rows, *, most: int, price: float) -> tuple[Indices, ...]:
    """Take sets that see all cells out of the nodes, one after the other, until there is none."""
    free = np.ones(sees.start.size - 1, np.bool_)
    spare = np.diff(seen_by.start)  # free nodes that see a cell
    shifts: list[Indices] = []
    while len(shifts) < most:
        chosen = _cover(sees, seen_by, (free, spare), wanted=most - len(shifts), price=price)
        if not chosen:
            break
        shifts.append(np.sort(np.array(chosen, np.int32)))
    return tuple(shifts)


def _cover(
    sees: _Rows,
    seen_by: _Rows,
    pool: tuple[NDArray[np.bool_], NDArray[np.int64]],
    *,
    wanted: int,
    price: float,
) -> list[int]:
    """Take nodes that see all cells out of the pool of free ones; none if there are no such.

    For the cell that has the fewest free nodes left, the node that sees most cells anew, less a
    `price` for those that it sees in vain: in full where no more free nodes than shifts `wanted`
    are left, so that a scarce cell is not seen twice in one shift and never in another.
    """
    free, spare = pool
    times = np.zeros(spare.size, np.int64)
    chosen: list[int] = []
    while not times.all():
        unseen = np.flatnonzero(times == 0)
        able = seen_by.of(int(unseen[np.argmin(spare[unseen])]))
        able = able[free[able]]
        if not able.size:
            return []
        worth = np.where(times == 0, 1.0, -price * (1.0 + np.maximum(spare - wanted, 0)) ** -2.0)
        gains = [float(worth[sees.of(node)].sum()) for node in able.tolist()]
        node = int(able[np.argmax(gains)])
        own = sees.of(node)
        chosen.append(node)
        free[node] = False
        spare[own] -= 1
        times[own] += 1
    for node in chosen:
        own = sees.of(node)
        if (times[own] > 1).all():  # others that came later see all that it sees
            free[node] = True
            spare[own] += 1
            times[own] -= 1
    return [node for node in chosen if not free[node]]
