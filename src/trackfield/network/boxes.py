"""Upright boxes, in the plane and in space: where nodes are set up and targets are watched."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.raster import Region
from trackfield.types import Matrix, Vector


class Box(NamedTuple):
    """All points between `low` (d,) and `high` (d,) [m], d = 2 or 3."""

    low: Vector
    high: Vector

    @property
    def dimensions(self) -> int:
        """Two or three."""
        return int(self.low.size)

    @property
    def size(self) -> Vector:
        """Lengths (d,) of the sides [m]."""
        return self.high - self.low

    @property
    def measure(self) -> float:
        """Area [m^2], in space the volume [m^3]."""
        return float(self.size.prod())

    def corners(self) -> Matrix:
        """Corners (2^d, d) [m]."""
        ends = np.stack([self.low, self.high])
        return np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, self.dimensions)

    def outside(self, points: Matrix) -> Vector:
        """Distances (...) [m] of points (..., d) to the box, 0 within it."""
        short = np.maximum(self.low - points, points - self.high)
        return np.linalg.norm(np.maximum(short, 0.0), axis=-1)


def box_of(region: Region | Box) -> Box:
    """Make a box of a region; `InputError` where it has no extent in some direction."""
    if isinstance(region, Region):
        x_min, y_min, x_max, y_max = region
        region = Box(np.array([x_min, y_min]), np.array([x_max, y_max]))
    low, high = np.asarray(region.low, np.float64), np.asarray(region.high, np.float64)
    if low.shape not in {(2,), (3,)} or high.shape != low.shape:
        raise InputError(
            f"box from {low.shape} to {high.shape} coordinates, expected two or three of each"
        )
    if not np.isfinite([low, high]).all() or not (low < high).all():
        raise InputError(
            f"box: found {low.tolist()} to {high.tolist()}, expected finite ones, low below high"
        )
    return Box(low, high)
