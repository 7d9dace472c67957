"""Who watches what: the cell of each tracking group, and what its neighbours need to know."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackfield.association.model import Scene
from trackfield.errors import ConfigurationError
from trackfield.raster import Field, Raster, Region
from trackfield.types import Matrix, Vector

OPEN_BIRTHS_PER_S = 0.2
"""Births in the whole region that groups share out where none are told."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells of the leaders at `centres` (g, 2) [m]: a place belongs to the nearest, Oh III.A.

    Leaders must differ: `ConfigurationError` names those that stand at one place.
    """

    centres: Matrix

    def __post_init__(self) -> None:
        if self.centres.ndim != 2 or self.centres.shape[1] != 2 or not len(self.centres):
            raise ConfigurationError(
                [f"leaders of shape {self.centres.shape}, expected (groups, 2) with groups > 0"]
            )
        if not np.isfinite(self.centres).all():
            raise ConfigurationError(["found a leader without a finite place"])
        gaps = np.linalg.norm(self.centres[:, None] - self.centres, axis=-1)
        same = np.argwhere(np.triu(gaps == 0.0, 1))
        if len(same):
            pairs = ", ".join(f"{i + 1} and {j + 1}" for i, j in same)
            raise ConfigurationError([f"found leaders at one place: {pairs}"])

    def __len__(self) -> int:
        return len(self.centres)

    def owner(self, positions: Matrix) -> NDArray[np.intp]:
        """Find the group (...) whose leader is nearest to each of `positions` (..., 2) [m]."""
        offsets = positions[..., None, :] - self.centres
        return np.argmin((offsets**2).sum(axis=-1), axis=-1)

    def region(self, group: int, whole: Region, *, margin_m: float) -> Region:
        """Box around the cell of `group` and `margin_m` more, inside the whole region [m].

        The group hears of everything in it, so that no map has to say where it is deaf.
        """
        x_min, y_min, x_max, y_max = whole
        corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
        own = self.centres[group]
        for other in np.delete(self.centres, group, axis=0):
            gap = other - own  # nearer to `own`: x . gap <= the value half-way between the two
            corners = _cut(corners, gap, float(gap @ (own + other)) / 2.0)
        if not len(corners):
            raise ConfigurationError(
                [f"found group {group + 1} without a place in the region, expected a leader nearer"]
            )
        (x_low, y_low), (x_high, y_high) = corners.min(axis=0), corners.max(axis=0)
        return Region(
            max(float(x_low) - margin_m, x_min),
            max(float(y_low) - margin_m, y_min),
            min(float(x_high) + margin_m, x_max),
            min(float(y_high) + margin_m, y_max),
        )

    def scene(self, group: int, whole: Scene, *, margin_m: float) -> Scene:
        """Cut the whole scene to what `group` is told: that of its `region`.

        Births that are None are shared out as `OPEN_BIRTHS_PER_S`: a group sees too few to learn
        them, and would take hand-overs that were lost for births.
        """
        reporting, targets = whole.reporting, whole.targets
        region = self.region(group, reporting.region, margin_m=margin_m)
        false, births = reporting.false_per_scan, targets.births_per_s
        born = _share(targets.birth_map, region, reporting.region)
        heard = _share(reporting.false_map, region, reporting.region)
        return Scene(
            replace(
                reporting, region=region, false_per_scan=None if false is None else false * heard
            ),
            replace(
                targets,
                births_per_s=(OPEN_BIRTHS_PER_S if births is None else births) * born,
                initial_count=targets.initial_count * born,
            ),
        )


def _cut(corners: Matrix, normal: Vector, limit: float) -> Matrix:
    """Cut a convex polygon (n, 2) to where x . normal <= limit; empty where nothing is left."""
    if not len(corners):
        return corners
    over = corners @ normal - limit
    kept: list[Vector] = []
    for i in range(len(corners)):
        here, before = over[i], over[i - 1]
        if (here > 0.0) != (before > 0.0):
            share = before / (before - here)
            kept.append(corners[i - 1] + share * (corners[i] - corners[i - 1]))
        if here <= 0.0:
            kept.append(corners[i])
    return np.array(kept).reshape(-1, 2)


def _share(density: Field, part: Region, whole: Region) -> float:
    """Which share of a quantity with this density over the whole region lies in a part of it."""
    if not isinstance(density, Raster):
        return part.area / whole.area
    every, own = density.values, density.values * _overlaps(density, part)
    total = float((every * _overlaps(density, whole)).sum())
    return float(own.sum()) / total if total > 0.0 else 0.0


def _overlaps(raster: Raster, part: Region) -> Matrix:
    """Which share of each cell of a raster lies in a part of the plane."""
    x_min, y_min, x_max, y_max = raster.region
    rows, columns = raster.values.shape
    x: Vector = np.linspace(x_min, x_max, columns + 1)
    y: Vector = np.linspace(y_min, y_max, rows + 1)
    across = np.diff(np.clip(x, part.x_min, part.x_max)) / np.diff(x)
    up = np.diff(np.clip(y, part.y_min, part.y_max)) / np.diff(y)
    return np.outer(up, across)
