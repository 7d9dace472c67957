"""How many nodes a field needs for a wanted accuracy, and what it reaches with so many."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.localization.bounds import Bound
from trackfield.localization.information import pair_gains, position_bound
from trackfield.localization.mixed_models import mixed, reach
from trackfield.network.boxes import Box, box_of
from trackfield.network.kinds import SensorModel
from trackfield.network.layouts import (
    Lattice,
    lattice,
    lattice_count,
    lattice_spacing,
    random_places,
)
from trackfield.network.node_index import NodeIndex
from trackfield.raster import Region
from trackfield.types import Matrix

Layout = Lattice | Literal["random"]

_PLACES = 4000  # of a region at which accuracy is judged: shares are known to 1/4000
_MOST = 1_000_000  # nodes
_PAIRS = 500_000  # of a place and a node that are looked at together
_RINGS = 200  # distances at which a node's gain is averaged
_BALL = {2: math.pi, 3: 4.0 * math.pi / 3.0}


class Wanted(NamedTuple):
    """An accuracy: the root of the trace of the bound is at most `rms_m` in a `share` of places."""

    rms_m: float
    share: float = 0.95


class Reached(NamedTuple):
    """What a field reaches: `share` of places within the wanted rms, `rms_m` in the wanted share.

    `rms_m` is infinite where a position does not follow in so many places.
    """

    share: float
    rms_m: float


class Provision(NamedTuple):
    """The least `number` of nodes found that is `enough`, and where they stand (n, d) [m].

    Where none is enough, `number` is the most that was allowed, and `reached` the best there is.
    `guess` is the count that the mean information of a random field asks for. `spacing_m` is that
    of a lattice, 0 for random nodes.
    """

    enough: bool
    number: int
    nodes: Matrix
    spacing_m: float
    reached: Reached
    guess: int


def nodes_needed(
    region: Region | Box,
    model: SensorModel,
    *,
    wanted: Wanted,
    layout: Layout = "hexagonal",
    most: int = 20_000,
    rng: np.random.Generator | None = None,
) -> Provision:
    """Find how few nodes locate a target as wanted, where each in reach takes one reading.

    Counts are bisected; the bound is judged at 4000 places spread evenly, the border included. Of
    random nodes (which need `rng`) the first n of one draw are tried: more of them never locate
    worse, so that the least count is exact for that draw. Lattices are shifted as their spacing
    changes: a smaller count that happens to do is not ruled out.
    """
    box = box_of(region)
    _check(wanted, most)
    drawn = None if rng is None else random_places(box, most, rng=rng)

    def trial(count: int) -> Provision:
        nodes, spacing = _set_up(box, (count, most), layout, drawn)
        reached = field_reaches(nodes, box, model=model, wanted=wanted)
        enough = reached.share >= wanted.share
        return Provision(enough, len(nodes), nodes, spacing, reached, guess)

    guess = first_guess(box, model, wanted=wanted, most=most)
    low, high = 0, guess
    best = trial(high)
    while not best.enough and high < most:
        low, high = high, min(2 * high, most)
        best = trial(high)
    while best.enough and high - low > 1:
        middle = (low + high) // 2
        tried = trial(middle)
        low, high, best = (low, middle, tried) if tried.enough else (middle, high, best)
    return best


def first_guess(region: Region | Box, model: SensorModel, *, wanted: Wanted, most: int) -> int:
    """Count n whose mean information allows the wanted rms: tr (E J)^-1 = rms^2, `most` at most.

    Of random nodes, E[J] = I n / |region| times the integral of |gain|^2 / d over the ball of
    reach, for ranges n / |region| pi r^2 / (2 sigma^2) I in the plane. As the trace of the inverse
    is convex, no field of independent nodes has less on average; a share of all places needs more.
    """
    box = box_of(region)
    d = box.dimensions
    far = min(float(reach(mixed([model]))[0]), float(np.linalg.norm(box.size)))
    r = far * (np.arange(_RINGS) + 0.5) / _RINGS
    offsets = np.zeros((_RINGS, d))
    offsets[:, 0] = r
    gain2 = (pair_gains(model, np.zeros((_RINGS, d)), offsets) ** 2).sum(axis=1)
    told = _BALL[d] * far**d * float((gain2 * r ** (d - 1)).sum() / (r ** (d - 1)).sum()) / d
    count = d * box.measure / told / wanted.rms_m / wanted.rms_m if told > 0.0 else math.inf
    return max(1, math.ceil(min(count, most)))


def field_reaches(
    nodes: Matrix, region: Region | Box, *, model: SensorModel, wanted: Wanted
) -> Reached:
    """Judge `nodes` (n, d) [m], all of one model, at 4000 places spread evenly over a region."""
    box = box_of(region)
    if not len(nodes):
        return Reached(0.0, math.inf)
    found = field_bound(nodes, _places(box), model=model)
    rms = np.sqrt(np.trace(found.covariance, axis1=-2, axis2=-1))
    ordered = np.sort(np.where(found.determined, rms, np.inf))
    needed = math.ceil(wanted.share * len(ordered) - 1e-9)
    return Reached(float((ordered <= wanted.rms_m).mean()), float(ordered[needed - 1]))


def field_bound(nodes: Matrix, places: Matrix, *, model: SensorModel) -> Bound:
    """Cramer-Rao bound (p, d, d) [m^2] of positions at `places` (p, d) from the nodes in reach.

    Each of `nodes` (n, d) takes one reading by the same model; only pairs in reach are looked at.
    """
    index, d = NodeIndex(nodes), nodes.shape[1]
    every = np.concatenate([nodes, places])
    across = float(np.linalg.norm(every.max(axis=0) - every.min(axis=0)))
    far = min(float(reach(mixed([model]))[0]), across)
    share = min(1.0, (2.0 * far) ** d / max(float(np.ptp(nodes, axis=0).prod()), 1e-300))
    step = max(1, int(_PAIRS / (1.0 + share * len(nodes))))
    information = np.zeros((len(places), d, d))
    for first in range(0, len(places), step):
        part = places[first : first + step]
        near = index.within(part, far)
        gains = pair_gains(model, nodes[near.node], part[near.place])
        for i, j in zip(*np.triu_indices(d), strict=True):
            summed = np.bincount(near.place, gains[:, i] * gains[:, j], minlength=len(part))
            information[first : first + step, i, j] = summed
            information[first : first + step, j, i] = summed
    return position_bound(information)


def _set_up(
    box: Box, numbers: tuple[int, int], layout: Layout, drawn: Matrix | None
) -> tuple[Matrix, float]:
    """Set up as many nodes as asked, of a lattice the next number that is allowed; its spacing."""
    number, most = numbers
    if layout == "random":
        if drawn is None:
            raise InputError("found no rng, expected one for random nodes")
        return drawn[:number], 0.0
    spacing = lattice_spacing(box, number, layout=layout)
    if lattice_count(box, spacing, layout=layout) > most:  # many come at once: the next wider one
        spacing *= 1.0 + 1e-6
    return lattice(box, spacing, layout=layout), spacing


def _places(box: Box) -> Matrix:
    """Places (p, d) [m] spread evenly over a box: Roberts' sequence, with no lattice in step.

    The i-th is i times the inverse powers of the root of x^(d + 1) = x + 1, modulo the box.
    """
    d = box.dimensions
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (d + 1))
    shares = (0.5 + np.arange(1, _PLACES + 1)[:, None] * root ** -np.arange(1.0, d + 1)) % 1.0
    return box.low + box.size * shares


def _check(wanted: Wanted, most: int) -> None:
    if not (wanted.rms_m > 0.0 and math.isfinite(wanted.rms_m) and 0.0 < wanted.share <= 1.0):
        raise InputError(
            f"found {wanted}, expected a finite rms_m above 0 and a share above 0, up to 1"
        )
    if not 1 <= most <= _MOST:
        raise InputError(f"found most = {most}, expected from 1 to {_MOST}")
