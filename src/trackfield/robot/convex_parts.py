"""Simple polygons as convex parts: what a machine that must keep clear of them computes with.

A part is where n_i . x < b_i for all of its half-planes. A polygon is cut into triangles by ears,
which are put together again while they stay convex; a margin moves the half-planes outwards and
bevels the corners by planes that touch the circle around them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_BEVEL = math.pi / 4.0  # a corner is cut so that it turns by this at most: 8 % beyond the margin
_FLAT = 1e-12  # of the square of the size: an area that is none


class Part(NamedTuple):
    """A convex polygon: `corners` (m, 2) counter-clockwise, `inner` (m,): edge i to i + 1 is a cut.

    Behind an inner edge lies the next part of the same polygon.
    """

    corners: Matrix
    inner: tuple[bool, ...]


def parts_of(polygon: ArrayLike) -> list[Part]:
    """Cut a simple polygon (m, 2) [m] into convex parts, in either order of its corners.

    `InputError` for fewer than three corners, corners that are not finite, no area, and edges that
    cross each other.
    """
    corners = _checked(polygon)
    cells = _merged(corners, _ears(corners))
    m = len(corners)
    return [
        Part(
            corners[cell],
            tuple((b - a) % m != 1 for a, b in zip(cell, [*cell[1:], cell[0]], strict=True)),
        )
        for cell in cells
    ]


def grown(part: Part, margin_m: float) -> Part:
    """Corners of the part and all that is within `margin_m` of it, a little more at corners."""
    if margin_m == 0.0:
        return part
    edges = np.roll(part.corners, -1, axis=0) - part.corners
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    corners: list[Vector] = []
    for k, corner in enumerate(part.corners):
        turn = (heading[k] - heading[k - 1]) % (2.0 * math.pi)
        pieces = math.ceil(turn / _BEVEL - 1e-9) or 1
        step = turn / pieces
        away = margin_m / math.cos(step / 2.0)
        bearing = heading[k - 1] - math.pi / 2.0 + step * (np.arange(pieces) + 0.5)
        corners.extend(corner + away * np.column_stack([np.cos(bearing), np.sin(bearing)]))
    return Part(np.array(corners), (False,) * len(corners))


def _checked(polygon: ArrayLike) -> Matrix:
    corners = np.asarray(polygon, np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise InputError(
            f"a polygon of shape {corners.shape}: expected corners (m, 2) [m] with m >= 3"
        )
    if not np.isfinite(corners).all():
        raise InputError("a polygon with a corner that is not finite: expected metres")
    if (corners[0] == corners[-1]).all():  # closed by a repeated corner
        corners = corners[:-1]
    area = _area(corners)
    size = float(np.ptp(corners, axis=0).max())
    if abs(area) <= _FLAT * size**2 or len(corners) < 3:
        raise InputError(f"a polygon without an area: found corners {corners.tolist()[:4]}")
    corners = corners if area > 0.0 else corners[::-1]
    m = len(corners)
    for i in range(m):
        for j in range(i + 2, m - (i == 0)):
            if _cross_over(corners[i], corners[i + 1], corners[j], corners[(j + 1) % m]):
                raise InputError(
                    f"a polygon whose edges from {corners[i].tolist()} and {corners[j].tolist()} "
                    "cross: expected a simple one"
                )
    return corners


def _area(corners: Matrix) -> float:
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2.0


def _side(a: Vector, b: Vector, c: Vector) -> float:
    """Above 0 where c lies to the left of the line from a to b."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _cross_over(a: Vector, b: Vector, c: Vector, d: Vector) -> bool:
    return _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0


def _ears(corners: Matrix) -> list[list[int]]:
    """Triangles, as corner numbers, by cutting ears off: O(m^3) at worst, at set-up."""
    left = list(range(len(corners)))
    triangles: list[list[int]] = []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(corners, left, k)), None)
        if ear is None:  # rounding only: a corner that is flat
            ear = int(np.argmin([abs(_turn(corners, left, k)) for k in range(len(left))]))
        a, b, c = left[ear - 1], left[ear], left[(ear + 1) % len(left)]
        if _side(corners[a], corners[b], corners[c]) > 0.0:
            triangles.append([a, b, c])
        del left[ear]
    return [*triangles, left]


def _turn(corners: Matrix, left: Sequence[int], k: int) -> float:
    return _side(corners[left[k - 1]], corners[left[k]], corners[left[(k + 1) % len(left)]])


def _is_ear(corners: Matrix, left: Sequence[int], k: int) -> bool:
    if _turn(corners, left, k) <= 0.0:
        return False
    ring = [left[k - 1], left[k], left[(k + 1) % len(left)]]
    a, b, c = corners[ring]
    others = [corners[i] for i in left if i not in ring]
    return not any(
        _side(a, b, p) >= 0.0 and _side(b, c, p) >= 0.0 and _side(c, a, p) >= 0.0 for p in others
    )


def _merged(corners: Matrix, cells: list[list[int]]) -> list[list[int]]:
    """Put cells together over a shared edge while what comes out is convex (Hertel, Mehlhorn)."""
    k = 0
    while k < len(cells):
        for j in range(k + 1, len(cells)):
            joined = _joined(corners, cells[k], cells[j])
            if joined:
                cells = [*cells[:k], joined, *cells[k + 1 : j], *cells[j + 1 :]]
                break
        else:
            k += 1
    return cells


def _joined(corners: Matrix, one: list[int], other: list[int]) -> list[int]:
    for k, a in enumerate(one):
        b = one[(k + 1) % len(one)]
        if a in other and other[other.index(a) - 1] == b:
            start, first = one.index(b), other.index(a)
            ring = one[start:] + one[:start]  # from b round to a
            rest = other[first + 1 :] + other[:first]  # after a, up to b
            joined = ring + [i for i in rest if i != b]
            if all(_turn(corners, joined, i) >= 0.0 for i in range(len(joined))):
                return joined
    return []
