"""Who stands near a place, asked again and again: an index of nodes that is built once."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple, cast

import numpy as np
from scipy import spatial

from trackfield.errors import InputError
from trackfield.types import Indices, Matrix, Vector

_KDTree = cast("Any", spatial).KDTree  # which has no types

_SLACK = 1e-9  # of a radius: nodes set up at just this distance are within it, rounded or not


class Near(NamedTuple):
    """Pairs (m,) of a place and a node within its radius; `offset` (m, d) [m] from place to node.

    In order of places; the nodes of a place in their own order.
    """

    place: Indices
    node: Indices
    offset: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class NodeIndex:
    """Nodes at `positions` (n, d) [m], in the plane (d = 2) or in space (3).

    `InputError` where there is no node, or one stands nowhere.
    """

    positions: Matrix
    _tree: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        places = self.positions
        if places.ndim != 2 or places.shape[1] not in {2, 3} or not len(places):
            raise InputError(f"nodes of shape {places.shape}, expected (n, 2) or (n, 3) with n > 0")
        wrong = np.flatnonzero(~np.isfinite(places).all(axis=1))
        if wrong.size:
            raise InputError(
                f"nodes: found {places[wrong[0]].tolist()} (number {wrong[0]}), "
                "expected finite positions"
            )
        object.__setattr__(self, "_tree", _KDTree(places))

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def dimensions(self) -> int:
        """Two or three."""
        return int(self.positions.shape[1])

    def within(self, places: Matrix, radius_m: float | Vector) -> Near:
        """Find all nodes within `radius_m`, one number or (p,), of each of `places` (p, d)."""
        if places.ndim != 2 or places.shape[1] != self.dimensions:
            raise InputError(
                f"places of shape {places.shape}, expected (p, {self.dimensions}) as of the nodes"
            )
        if not np.isfinite(places).all() or not (np.asarray(radius_m) >= 0.0).all():
            raise InputError("found a place or a radius that is no number, expected finite ones")
        radius = np.asarray(radius_m) * (1.0 + _SLACK)
        lists = self._tree.query_ball_point(places, radius, return_sorted=True)
        counts = np.fromiter((len(one) for one in lists), np.int64, len(places))
        node = np.fromiter(chain.from_iterable(lists), np.int32, int(counts.sum()))
        place = np.repeat(np.arange(len(places), dtype=np.int32), counts)
        return Near(place, node, self.positions[node] - places[place])

    def nearest(self, places: Matrix, *, count: int = 1) -> tuple[Matrix, Indices]:
        """Distances [m] and numbers, (p, count) each, of the nodes nearest to `places` (p, d)."""
        distance, node = self._tree.query(places, k=np.arange(1, count + 1))
        return np.asarray(distance, np.float64), np.asarray(node, np.int32)


def each_reach(nodes: NodeIndex, reach_m: float | Vector) -> Vector:
    """Reach (n,) [m] of each node, of one number for all or (n,); `InputError` unless above 0."""
    reach = np.asarray(reach_m, np.float64)
    if reach.shape not in {(), (len(nodes),)}:
        raise InputError(f"reach of shape {reach.shape}, expected one number or {len(nodes)}")
    if not (np.isfinite(reach) & (reach > 0.0)).all():
        raise InputError("found a reach that is no number above 0, expected finite ones")
    return np.broadcast_to(reach, (len(nodes),))
