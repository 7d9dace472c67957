"""From the robot to the sink over the nodes of the network, and what a robot spares them.

Pham's chapter 4: the robot carries the filter, so that no master hands over, and the radio to the
sink, so that no node passes on what is known. Where it has no such radio, it gives its reports to a
node within a hop, and they travel by the fewest hops.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.topology import UNREACHED, hops_to_leaders
from trackfield.types import Indices, Matrix, Vector

DIRECT = -1  # relay of a robot that hears the sink itself, or that hears nobody


class Relays(NamedTuple):
    """Nodes at `positions` (n, 2) [m], `hops` (n,) away from a `sink` (2,); -1 without a way."""

    positions: Matrix
    sink: Vector
    hop_m: float
    hops: Indices


class Route(NamedTuple):
    """Through which node a robot reaches the sink, (k,), and in how many hops, (k,).

    `relay` is -1 where it hears the sink itself (one hop), and where there is no way (-1 hops).
    """

    relay: Indices
    hops: Indices


class Traffic(NamedTuple):
    """Messages times hops, in all: of readings, hand-overs and reports to the sink.

    `unreported` counts the steps from which no report came through.
    """

    readings: int
    hand_overs: int
    reports: int
    unreported: int

    @property
    def total(self) -> int:
        """All messages times hops."""
        return self.readings + self.hand_overs + self.reports


def relays(
    positions: Matrix, sink: Vector, *, hop_m: float, alive: NDArray[np.bool_] | None = None
) -> Relays:
    """Count the fewest hops of `hop_m` from each node (n, 2) [m] to the sink.

    Nodes that are not `alive` pass nothing on.
    """
    if not 0.0 < hop_m < math.inf:
        raise InputError(f"hop_m: found {hop_m}, expected a length [m] above 0")
    base = np.asarray(sink, np.float64)
    hops = hops_to_leaders(positions, base[None], hop_m=hop_m, alive=alive)[0]
    if alive is not None:
        hops = np.where(alive, hops, UNREACHED).astype(np.int32)
    return Relays(positions, base, hop_m, hops)


def route(net: Relays, robots: Matrix) -> Route:
    """Through which node robots at (k, 2) [m] reach the sink: the fewest hops, then the nearest."""
    places = np.asarray(robots, np.float64)
    direct = np.linalg.norm(places - net.sink, axis=1) <= net.hop_m
    away = np.linalg.norm(net.positions - places[:, None], axis=-1)
    usable = (away <= net.hop_m) & (net.hops != UNREACHED)
    cost = np.where(usable, net.hops + away / (2.0 * net.hop_m), np.inf)
    relay = cost.argmin(axis=1)
    found = np.isfinite(cost.min(axis=1))
    hops = np.where(found, net.hops[relay] + 1, UNREACHED)
    return Route(
        np.where(direct | ~found, DIRECT, relay).astype(np.int32),
        np.where(direct, 1, hops).astype(np.int32),
    )


def robot_traffic(net: Relays, robots: Matrix, sensing: Indices, *, radio: bool) -> Traffic:
    """Count what the nodes send with a robot at (k, 2) [m] that hears `sensing` (k,) of them.

    Each reading goes one hop, to the robot. With a `radio` to the sink of its own there is no more.
    """
    if radio:
        return Traffic(int(np.sum(sensing)), 0, 0, 0)
    hops = route(net, robots).hops
    passed = np.maximum(hops - 1, 0)[hops != UNREACHED]  # the first hop is the robot's own
    return Traffic(int(np.sum(sensing)), 0, int(passed.sum()), int(np.sum(hops == UNREACHED)))


def master_traffic(net: Relays, masters: Indices, sensing: Indices) -> Traffic:
    """Count what the nodes send without a robot: `masters` (k,) are nodes, `sensing` (k,) counts.

    The master is one of the `sensing` ones: its own reading goes nowhere, the others' go one hop.
    A hand-over goes the hops that the distance between the masters needs at least.
    """
    hops = net.hops[masters]
    moved = np.linalg.norm(np.diff(net.positions[masters], axis=0), axis=1)
    hand_overs = np.ceil(moved / net.hop_m - 1e-9).astype(int)
    readings = int(np.sum(np.maximum(np.asarray(sensing) - 1, 0)))
    reached = hops != UNREACHED
    return Traffic(readings, int(hand_overs.sum()), int(hops[reached].sum()), int((~reached).sum()))
