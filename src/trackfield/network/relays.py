"""Who passes a message on: the nodes of a shortest path, each of which spends on it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.near import nearest_point
from trackfield.network.topology import UNREACHED
from trackfield.types import Indices, Matrix

_SLACK = 1e-9  # of a hop, as in `topology`


class Relays(NamedTuple):
    """Where each node sends what is for a sink, by the fewest hops and the nearest next node.

    `next_node` (n,) is a node, or n + j for sink j itself; `hops` (n,) counts to the sink. Both are
    -1 of nodes from which no path leads to a sink.
    """

    next_node: Indices
    hops: Indices

    @property
    def cut_off(self) -> NDArray[np.intp]:
        """Nodes whose messages reach no sink."""
        return np.flatnonzero(self.hops == UNREACHED)


def relays(
    positions: Matrix, sinks: Matrix, *, hop_m: float, works: NDArray[np.bool_] | None = None
) -> Relays:
    """Find the way of every node (n, 2) [m] to a sink (s, 2) [m], the fewest hops away.

    Nodes that do not work, `works` (n,), relay nothing and have no way.
    """
    if not hop_m > 0.0:
        raise InputError(f"hop_m: found {hop_m}, expected a length above 0")
    count = len(positions)
    next_node = np.full(count, UNREACHED, np.int32)
    hops = np.full(count, UNREACHED, np.int32)
    rest = np.arange(count) if works is None else np.flatnonzero(works)
    frontier, places = count + np.arange(len(sinks)), np.asarray(sinks, np.float64)
    reach, layer = hop_m * (1.0 + _SLACK), 0
    while frontier.size and rest.size:
        layer += 1
        found = nearest_point(places, positions[rest], within_m=reach)
        near = np.isfinite(found.distance)
        next_node[rest[near]] = frontier[found.point[near]]
        hops[rest[near]] = layer
        frontier, rest = rest[near], rest[~near]
        places = positions[frontier]
    return Relays(next_node, hops)


def path_of(way: Relays, node: int) -> list[int]:
    """Nodes that a message of `node` passes, with `node` first and n + j, its sink, last.

    `node` alone where no path leads to a sink.
    """
    path = [node]
    while path[-1] < way.next_node.size and way.next_node[path[-1]] != UNREACHED:
        path.append(int(way.next_node[path[-1]]))
    return path


def path_between(
    positions: Matrix,
    ends: tuple[int, int],
    *,
    hop_m: float = math.inf,
    works: NDArray[np.bool_] | None = None,
) -> list[int] | None:
    """Nodes of a shortest path from the first to the second of `ends`, both included.

    None where no path leads; nodes (n, 2) [m] that do not work, `works` (n,), relay nothing.
    """
    first, second = ends
    if first == second:
        return [first]
    others = np.ones(len(positions), np.bool_) if works is None else works.copy()
    others[second] = False  # it is where paths end
    others[first] = True
    found = relays(positions, positions[second : second + 1], hop_m=hop_m, works=others)
    if found.hops[first] == UNREACHED:
        return None
    return [*path_of(found, first)[:-1], second]
