"""Sensing regions: how far inside a disc, a sector or a polygon a place lies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Matrix, Vector


def depth_in_disc(offsets: Matrix, radius_m: Vector) -> Vector:
    """Distance to the border (...) [m], positive inside, of places `offsets` (..., 2) [m]."""
    return radius_m - np.hypot(offsets[..., 0], offsets[..., 1])


def depth_in_sector(offsets: Matrix, radius_m: Vector, *, heading: Vector, width: Vector) -> Vector:
    """Distance to the border (...) [m], positive inside, of a sector about `heading` [rad].

    Exact on both sides, for any `width` [rad] below a full turn: folded about the axis, a place is
    nearest to the arc or to one straight side.
    """
    cos, sin = np.cos(heading), np.sin(heading)
    along = offsets[..., 0] * cos + offsets[..., 1] * sin
    across = np.abs(offsets[..., 1] * cos - offsets[..., 0] * sin)
    c, s = np.cos(width / 2.0), np.sin(width / 2.0)
    on_side = np.clip(along * c + across * s, 0.0, radius_m)
    to_side = np.hypot(along - on_side * c, across - on_side * s)
    inward = np.where(along * s - across * c >= 0.0, to_side, -to_side)
    return np.minimum(radius_m - np.hypot(along, across), inward)


def depth_in_polygon(offsets: Matrix, corners: Matrix) -> Vector:
    """Distance to the border (...) [m], positive inside, of a polygon of `corners` (k, 2) [m].

    The border itself is inside; the corners may run either way round.
    """
    x, y = offsets[..., 0], offsets[..., 1]
    nearest = np.full(x.shape, np.inf)
    odd = np.zeros(x.shape, bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        dx, dy = bx - ax, by - ay
        share = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - ax - share * dx, y - ay - share * dy))
        if dy != 0.0:
            odd ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * dx / dy)
    return np.where(odd, nearest, -nearest)


def polygon_fault(corners: Matrix) -> str | None:
    """Say what is wrong with a polygon of `corners` (k, 2), None if nothing."""
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        return "found corners that are not pairs of finite numbers, expected (x, y) in m"
    if len(corners) < 3:
        return f"found {len(corners)} corners, expected at least 3"
    following = np.roll(corners, -1, axis=0)
    if (np.linalg.norm(following - corners, axis=1) == 0.0).any():
        return "found two equal corners in a row, expected each corner once"
    if _crosses_itself(corners, following):
        return "found sides that cross or touch, expected a border that does not meet itself"
    x, y = corners.T
    if abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 1e-9 * np.ptp(corners, axis=0).max() ** 2:
        return "found corners on one line, expected an area"
    return None


def _crosses_itself(start: Matrix, end: Matrix) -> bool:
    """Tell whether two sides that are not neighbours meet, or neighbours fold back."""
    k = len(start)
    for i in range(k):
        rest = np.array([j for j in range(k) if j not in {i, (i + 1) % k, (i - 1) % k}], int)
        if _meet((start[i], end[i]), (start[rest], end[rest])).any():
            return True
        along, back = end[i] - start[i], end[(i + 1) % k] - end[i]
        if along[0] * back[1] == along[1] * back[0] and along @ back < 0.0:
            return True
    return False


def _meet(one: tuple[Vector, Vector], others: tuple[Matrix, Matrix]) -> NDArray[np.bool_]:
    """Which segments of `others` share a point with `one`."""
    (a, b), (c, d) = one, others
    a_side, b_side = _turn(c, d, a), _turn(c, d, b)
    c_side, d_side = _turn(a, b, c), _turn(a, b, d)
    proper = (a_side * b_side < 0.0) & (c_side * d_side < 0.0)
    touch = ((a_side == 0.0) & _between(c, d, a)) | ((b_side == 0.0) & _between(c, d, b))
    touch |= ((c_side == 0.0) & _between(a, b, c)) | ((d_side == 0.0) & _between(a, b, d))
    return np.asarray(proper | touch)


def _turn(a: Matrix, b: Matrix, p: Matrix) -> Vector:
    """Sign of the area of the triangles a, b, p."""
    return np.sign(
        (b[..., 0] - a[..., 0]) * (p[..., 1] - a[..., 1])
        - (b[..., 1] - a[..., 1]) * (p[..., 0] - a[..., 0])
    )


def _between(a: Matrix, b: Matrix, p: Matrix) -> NDArray[np.bool_]:
    """Tell whether p, known to be on the line a b, lies in its segment."""
    return np.asarray(((p >= np.minimum(a, b)) & (p <= np.maximum(a, b))).all(axis=-1))
