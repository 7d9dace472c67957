"""How much of a rectangle lies in one disc of many, in two, and so on: exactly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.network.node_index import NodeIndex
from trackfield.raster import Region
from trackfield.types import Vector

_OUTSIDE = 1 << 40  # depth of what lies outside of the rectangle: no number of discs comes near
_CHUNK = 500  # circles at a time: memory stays bounded
_SHORT = 1e-6  # of a radius or side: circles that touch are cut this short by rounding, and less
_TURN = 2.0 * math.pi


class Depths(NamedTuple):
    """`areas` (most,) [m^2] in at least 1, 2, .. discs; `least` discs that any part lies in."""

    areas: Vector
    least: int


class _Pieces(NamedTuple):
    """Pieces of circles or sides from `start` to `end` (m,), and how many discs hold them."""

    owner: NDArray[np.intp]
    start: Vector
    end: Vector
    depth: NDArray[np.int64]


class _Covers(NamedTuple):
    """What holds a part of circles or sides: an interval (m,) of `owner`, counted `weight` times.

    All within [0, length); an interval whose end is below its start goes round.
    """

    owner: NDArray[np.intp]
    start: Vector
    end: Vector
    weight: NDArray[np.int64]


def depths(nodes: NodeIndex, radii: Vector, *, region: Region, most: int) -> Depths:
    """Areas of a region that lie in at least 1 to `most` discs about nodes (n, 2), by Green.

    The border of what lies in k discs or more is made of the arcs of circles that lie in exactly
    k - 1 others, and of the parts of the region's sides that lie in k or more: the area is half the
    integral of x dy - y dx along it. Radii (n,) [m] are above 0.
    """
    middle = np.array([region.x_min + region.x_max, region.y_min + region.y_max]) / 2.0
    half = np.array([region.x_max - region.x_min, region.y_max - region.y_min]) / 2.0
    areas, least = np.zeros(most + 1), np.iinfo(np.int64).max
    for first in range(0, len(nodes), _CHUNK):
        mine = np.arange(first, min(first + _CHUNK, len(nodes)))
        covers = _joined(_discs(nodes, radii, mine), _sides(nodes, radii, mine, middle, half))
        arcs = _pieces(covers, len(mine), _TURN)
        c, r = nodes.positions[mine][arcs.owner] - middle, radii[mine][arcs.owner]
        swept = r**2 * (arcs.end - arcs.start)
        swept += r * c[:, 0] * (np.sin(arcs.end) - np.sin(arcs.start))
        swept -= r * c[:, 1] * (np.cos(arcs.end) - np.cos(arcs.start))
        inside = arcs.depth < _OUTSIDE
        depth = np.minimum(arcs.depth[inside], most)
        areas += np.bincount(depth, weights=swept[inside] / 2.0, minlength=most + 1)[: most + 1]
        real = inside & (arcs.end - arcs.start > _SHORT)
        least = min(least, int(arcs.depth[real].min(initial=least)))
    edges = _edges(nodes, radii, middle, half)
    length = edges.end - edges.start
    swept = length * half[edges.owner % 2] / 2.0
    held = np.bincount(np.minimum(edges.depth, most), weights=swept, minlength=most + 1)
    areas[:most] += held[::-1].cumsum()[::-1][1:]  # a side's part counts in all k up to its depth
    real = length > _SHORT * half.min()
    return Depths(np.clip(areas[:most], 0.0, region.area), min(least, int(edges.depth[real].min())))


def _discs(nodes: NodeIndex, radii: Vector, mine: NDArray[np.intp]) -> _Covers:
    """Where circles `mine` lie in discs of other nodes."""
    near = nodes.within(nodes.positions[mine], radii[mine] + radii.max())
    i, j = mine[near.place], near.node
    d, r, other = np.linalg.norm(near.offset, axis=1), radii[i], radii[j]
    # Of discs that are the same, the earlier ones hold the later ones.
    whole = (d <= other - r) & ((d > 0.0) | (other > r) | (j < i)) & (i != j)
    cut = (d < r + other) & (d > np.abs(r - other))
    cosine = (r**2 + d**2 - other**2) / np.where(cut, 2.0 * r * d, 1.0)
    wide = np.arccos(np.clip(cosine, -1.0, 1.0))
    to = np.arctan2(near.offset[:, 1], near.offset[:, 0])
    return _around(near.place, to, wide, (cut, whole))


def _sides(
    nodes: NodeIndex, radii: Vector, mine: NDArray[np.intp], middle: Vector, half: Vector
) -> _Covers:
    """Where circles `mine` lie outside of the rectangle, side by side."""
    c, r = nodes.positions[mine] - middle, radii[mine]
    parts: list[_Covers] = []
    for side in range(4):  # to the east, north, west, south
        axis, sign = side % 2, 1.0 - 2.0 * (side // 2)
        within = half[axis] - sign * c[:, axis]  # how far the centre is inside of the side
        cut = np.abs(within) < r
        wide = np.arccos(np.clip(within / r, -1.0, 1.0))
        owner = np.arange(len(mine))
        to = np.full(len(mine), side * math.pi / 2.0)
        part = _around(owner, to, wide, (cut, within <= -r))
        parts.append(part._replace(weight=part.weight * _OUTSIDE))
    return _joined(*parts)


def _edges(nodes: NodeIndex, radii: Vector, middle: Vector, half: Vector) -> _Pieces:
    """Pieces of the four sides (east, north, west, south), by how many discs hold them."""
    c = nodes.positions - middle
    parts: list[_Covers] = []
    for side in range(4):
        axis, sign = side % 2, 1.0 - 2.0 * (side // 2)
        off = sign * half[axis] - c[:, axis]
        reaches = np.flatnonzero(np.abs(off) < radii)
        wide = np.sqrt(radii[reaches] ** 2 - off[reaches] ** 2)
        along, long = c[reaches, 1 - axis] + half[1 - axis], 2.0 * half[1 - axis]
        start, end = np.clip(along - wide, 0.0, long), np.clip(along + wide, 0.0, long)
        kept = np.flatnonzero(end > start)
        ones = np.ones(kept.size, np.int64)
        parts.append(_Covers(np.full(kept.size, side), start[kept], end[kept], ones))
    return _pieces(_joined(*parts), 4, 2.0 * np.array([half[1], half[0], half[1], half[0]]))


def _around(
    owner: NDArray[np.integer], to: Vector, wide: Vector, which: tuple[NDArray[np.bool_], ...]
) -> _Covers:
    """Intervals of circles: `wide` about the angle `to` where they are cut, or the whole."""
    cut, whole = which
    start, end = (to - wide)[cut] % _TURN, (to + wide)[cut] % _TURN
    count = int(whole.sum())
    return _Covers(
        np.concatenate([owner[cut], owner[whole]]).astype(np.intp),
        np.concatenate([start, np.zeros(count)]),
        np.concatenate([end, np.full(count, _TURN)]),
        np.ones(start.size + count, np.int64),
    )


def _joined(*parts: _Covers) -> _Covers:
    return _Covers(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _pieces(covers: _Covers, count: int, length: float | Vector) -> _Pieces:
    """Cut each of `count` circles or sides of some `length` where intervals begin and end."""
    lengths = np.broadcast_to(np.asarray(length, np.float64), (count,))
    round_about = np.where(covers.end < covers.start, covers.weight, 0)
    held = np.bincount(covers.owner, weights=round_about, minlength=count).astype(np.int64)
    own = np.arange(count)
    owner = np.concatenate([own, covers.owner, covers.owner, own])
    place = np.concatenate([np.zeros(count), covers.start, covers.end, lengths])
    change = np.concatenate([held, covers.weight, -covers.weight, np.zeros(count, np.int64)])
    order = np.lexsort((place, owner))
    owner, place = owner[order], place[order]
    depth = np.cumsum(change[order])
    # What is left of one circle at its end is not of the next one.
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    before = np.concatenate([np.zeros(1, np.int64), depth])[first]
    depth = depth - before[owner]
    inner = np.flatnonzero(owner[:-1] == owner[1:])
    return _Pieces(owner[inner], place[inner], place[inner + 1], depth[inner])
