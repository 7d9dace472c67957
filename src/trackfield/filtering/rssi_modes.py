"""Two places where a beacon may as well be: clouds in two parts, and mirror images about a line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.filtering.rssi_cloud import Cloud
from trackfield.network.geometry import FLAT
from trackfield.raster import Region
from trackfield.types import Matrix, Vector

APART = 10.0  # deviations between two parts: no cloud of one place is so, whatever its shape
MIRRORED_APART = 3.0  # about a mirror; of one place about the line the halves are 2.7 apart
_APART_M = 1.0  # nearer together two places are one
_LEAST = 0.05  # share of the lighter part
_TINY = 1e-9


class Mirror(NamedTuple):
    """A line in the plane about which a beacon and its image sound the same."""

    point: Vector  # (2,) [m]
    along: Vector  # (2,) of length 1


def parted(position: Matrix, w: Vector, *, apart: float = APART) -> bool:
    """Tell whether particles (d, N), d >= 2, of probabilities `w` (N,) are in two places.

    The plane is cut across each main axis where the parts' variances are least (Otsu): they are two
    if their means are `apart` of their common deviations apart, and a metre, and neither is light.
    """
    centred = position[:2] - (position[:2] @ w)[:, None]
    _, axes = np.linalg.eigh((centred * w) @ centred.T)
    return any(_cut(axis @ centred, w, apart) for axis in axes.T)


def _cut(place: Vector, w: Vector, least: float) -> bool:
    """Tell whether `place` (N,) of mean 0 is in two parts."""
    order = np.argsort(place)
    sorted_w, x = w[order], place[order]
    low = np.cumsum(sorted_w)[:-1]
    sums = np.cumsum(sorted_w * x)[:-1]
    both = np.maximum(low * (1.0 - low), _TINY)
    between = np.square(sums) / both  # of the variance, what the two means explain
    if not between.size:
        return False
    k = int(np.argmax(between))
    if not _LEAST <= low[k] <= 1.0 - _LEAST:
        return False
    apart = float(abs(sums[k]) / both[k])
    within = max(float(sorted_w @ np.square(x) - between[k]), 0.0)
    return apart > _APART_M and apart * apart > least * least * within


def mirror(sensors: Matrix) -> Mirror | None:
    """Return the line on which all `sensors` (n, d) stand; None if they stand on none."""
    plane = sensors[:, :2]
    point = plane.mean(axis=0)
    _, size, axes = np.linalg.svd(plane - point, full_matrices=True)
    if size.size > 1 and size[1] > FLAT * size[0]:
        return None
    return Mirror(point, axes[0])


def mirrored(cloud: Cloud, line: Mirror, *, chosen: NDArray[np.bool_], area: Region) -> Cloud:
    """Put the `chosen` (N,) particles in the places of their images, where these are in `area`.

    What was heard says as much for the one as for the other.
    """
    off = cloud.position[:2] - line.point[:, None]
    image = line.point[:, None] + _reflected(off, line)
    inside = area.contains(image.T) & chosen
    position, velocity = cloud.position.copy(), cloud.velocity.copy()
    position[:2] = np.where(inside, image, position[:2])
    velocity[:2] = np.where(inside, _reflected(velocity[:2], line), velocity[:2])
    return cloud._replace(position=position, velocity=velocity)


def _reflected(vectors: Matrix, line: Mirror) -> Matrix:
    """Vectors (2, N) on the other side of the line."""
    return 2.0 * line.along[:, None] * (line.along @ vectors) - vectors
