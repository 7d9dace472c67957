"""Who hears whom: groups of sensors around tier-2 nodes, and the hops of their shortest paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from trackfield.errors import InputError
from trackfield.network.channel import Channel
from trackfield.network.near import nearest_point, pairs_within
from trackfield.types import Indices, Matrix

UNREACHED = -1  # hops of a node that no message of it comes through

_SLACK = 1e-9  # of a hop: nodes set up at just this distance hear each other, rounded or not


class Routes(NamedTuple):
    """Where each sensor's messages go: `group` (n,) of its leader, `hops` (n,) to it, -1 none."""

    group: Indices
    hops: Indices


class Network(NamedTuple):
    """A radio network laid out: where nodes stand (n, 2) [m], who lives, where messages go."""

    channel: Channel
    positions: Matrix
    alive: NDArray[np.bool_]
    routes: Routes

    @property
    def cut_off(self) -> NDArray[np.intp]:
        """Nodes that live and whose messages reach no leader."""
        return np.flatnonzero(self.alive & (self.routes.hops == UNREACHED))


def lay_out(
    channel: Channel, positions: Matrix, leaders: Matrix, *, dead: Sequence[int] = ()
) -> Network:
    """Group sensors (n, 2 or 3) [m] around leaders (g, 2) [m], all of which relay messages.

    Sensors that are `dead` say and relay nothing. Without leaders there is one base that every
    sensor reaches in one hop.
    """
    places = _finite(positions, "sensors")
    alive = np.ones(len(places), np.bool_)
    alive[list(dead)] = False
    if not len(leaders):
        hops = np.where(alive, 1, UNREACHED).astype(np.int32)
        return Network(channel, places, alive, Routes(np.zeros(len(places), np.int32), hops))
    heads = _finite(leaders, "tier-2 nodes")
    group = nearest(places, heads)
    if channel.fewest_links:
        hops = hops_to_leaders(places, heads, hop_m=channel.hop_m, alive=alive)
        far = np.where(hops == UNREACHED, len(places) + len(heads), hops)
        near = np.linalg.norm(places - heads[:, None], axis=2)
        best = far == far.min(axis=0)
        group = np.argmin(np.where(best, near, np.inf), axis=0).astype(np.int32)
        routes = Routes(group, hops[group, np.arange(len(places))])
    else:
        routes = Routes(group, _hops_to_own(places, heads, group, channel.hop_m, alive))
    return Network(channel, places, alive, routes)


def nearest(positions: Matrix, leaders: Matrix) -> Indices:
    """Index (n,) of the leader (g, 2) that is nearest to each position (n, 2), Oh III.A g(i)."""
    return nearest_point(leaders, positions).point


def links(positions: Matrix, hop_m: float) -> csr_array:
    """Communication graph: (n, n), 1 where two of the positions (n, 2) are within `hop_m`."""
    pairs = pairs_within(positions, _reach(hop_m))
    rows = np.concatenate([pairs.first, pairs.second])
    columns = np.concatenate([pairs.second, pairs.first])
    shape = (len(positions), len(positions))
    return csr_array((np.ones(rows.size, np.int8), (rows, columns)), shape=shape)


def hops_to_leaders(
    positions: Matrix, leaders: Matrix, *, hop_m: float, alive: NDArray[np.bool_] | None = None
) -> Indices:
    """Hops (g, n) of the shortest path from every sensor (n, 2) to every leader (g, 2).

    -1 where there is none. Nodes that are not `alive` relay nothing.
    """
    nodes = np.concatenate([positions, leaders])
    works = np.ones(len(nodes), np.bool_)
    if alive is not None:
        works[: len(positions)] = alive
    count = len(positions)
    found = [
        _layers(nodes, count + j, hop_m=hop_m, works=works, wanted=works)[:count]
        for j in range(len(leaders))
    ]
    return np.array(found, np.int32).reshape(len(leaders), count)


def misplaced(positions: Matrix, sigma_m: float, *, rng: np.random.Generator) -> Matrix:
    """Positions (n, 2) [m] where nodes really stand that a site believes at `positions`."""
    return positions + sigma_m * rng.standard_normal(positions.shape)


def _hops_to_own(
    positions: Matrix, leaders: Matrix, group: Indices, hop_m: float, alive: NDArray[np.bool_]
) -> Indices:
    """Hops (n,) to the leader of the group that a sensor is in."""
    count = len(positions)
    nodes = np.concatenate([positions, leaders])
    works = np.concatenate([alive, np.ones(len(leaders), np.bool_)])
    hops = np.full(count, UNREACHED, np.int32)
    for j in range(len(leaders)):
        own = np.append(group == j, np.zeros(len(leaders), np.bool_))
        found = _layers(nodes, count + j, hop_m=hop_m, works=works, wanted=own)[:count]
        hops[group == j] = found[group == j]
    return hops


def _layers(
    nodes: Matrix,
    source: int,
    *,
    hop_m: float,
    works: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
) -> Indices:
    """Hops (n,) from `source`, layer by layer until all `wanted` nodes have theirs.

    A layer is what is within a hop of the last one, found in a tree of that layer: the graph
    itself, which has millions of edges in a dense field, is never made.
    """
    hops = np.full(len(nodes), UNREACHED, np.int32)
    hops[source] = 0
    frontier = np.array([source])
    rest = np.flatnonzero(works & (hops == UNREACHED))
    reach = _reach(hop_m)
    layer = 0
    while frontier.size and wanted[rest].any():
        layer += 1
        near = np.isfinite(nearest_point(nodes[frontier], nodes[rest], within_m=reach).distance)
        frontier, rest = rest[near], rest[~near]
        hops[frontier] = layer
    return hops


def _reach(hop_m: float) -> float:
    return hop_m * (1.0 + _SLACK)


def _finite(positions: Matrix, what: str) -> Matrix:
    """Positions in the plane (n, 2); `InputError` where one is no number."""
    places = np.asarray(positions, np.float64)[:, :2]
    wrong = np.flatnonzero(~np.isfinite(places).all(axis=1))
    if wrong.size:
        raise InputError(
            f"{what}: found a position {places[wrong[0]].tolist()} (number {wrong[0]}), "
            "expected finite ones"
        )
    return places
