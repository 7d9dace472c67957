"""How likely a report is there by now: sensing x delivery x arrived, by node, age and place."""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from trackfield.errors import InputError
from trackfield.network.channel import arrived_within, delivery_probability
from trackfield.network.near import nearest_point
from trackfield.network.topology import Network
from trackfield.raster import Field, Raster, Region, cell_centres, value_at
from trackfield.types import Indices, Matrix

_TAIL = 1e-3  # of the messages that arrive at all: what is later than the last age
_MOST_AGES = 64
_MOST_CELLS = 10_000  # of a map, where no cell is told: hops change over many sensors


def detection_by_age(
    network: Network, ages: int, *, step_s: float, p_sensing: Field = 1.0
) -> Matrix:
    """P(a report of node i has been made and has arrived `a` steps after its own), (ages, n).

    Entry (a, i) is p_sensing(s_i) p_cs(k_i) P(delay <= a steps), Oh III.A and (2), corrected.
    `p_sensing` is the probability that a target at a place gives a report there.
    """
    elapsed_s = step_s * np.arange(ages)[:, None]
    arrived = arrived_within(network.channel, network.routes.hops, elapsed_s)
    return arrived * value_at(p_sensing, network.positions)


def ages_that_matter(network: Network, *, step_s: float) -> int:
    """How many ages there are until all but .001 of the messages that arrive are there.

    At most 64, so that work stays bounded where nearly every message is put off for ever.
    """
    hops = np.unique(network.routes.hops)
    whole = delivery_probability(network.channel, hops)
    for age in range(_MOST_AGES - 1):
        if (arrived_within(network.channel, hops, age * step_s) >= (1.0 - _TAIL) * whole).all():
            return age + 1
    return _MOST_AGES


def leaders_at(network: Network, positions: Matrix) -> Indices:
    """Which node (n,) speaks for a target at each position (n, 2): the nearest one that lives."""
    if not network.alive.any():
        raise InputError("found no sensor that lives, expected at least one")
    living = np.flatnonzero(network.alive)
    return living[nearest_point(network.positions[living], positions).point].astype(np.int32)


def detection_maps(
    network: Network,
    region: Region,
    *,
    step_s: float,
    cell_m: float | None = None,
    p_sensing: Field = 1.0,
) -> tuple[Raster, ...]:
    """Map `detection_by_age` over `region`, one map an age: what association is handed.

    A target is reported by the node that is nearest to it. Cells are `cell_m` wide, if not given
    about half of what a sensor has for itself, but 10,000 cells are enough; the last map holds from
    its age on.
    """
    if cell_m is None:
        living = max(int(network.alive.sum()), 1)
        cell_m = math.sqrt(region.area / min(4 * living, _MOST_CELLS))
    places, shape = cell_centres(region, cell_m)
    node = leaders_at(network, places)
    elapsed_s = step_s * np.arange(ages_that_matter(network, step_s=step_s))[:, None]
    arrived = arrived_within(network.channel, network.routes.hops, elapsed_s)[:, node]
    maps = arrived * value_at(p_sensing, places)
    return tuple(Raster(region, cast("Matrix", values).reshape(shape)) for values in maps)
