"""The watched region, and quantities that vary over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Matrix, Vector


class Region(NamedTuple):
    """An upright rectangle, the part of the plane that is watched [m]."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return (self.x_max - self.x_min) * (self.y_max - self.y_min)

    def contains(self, positions: Matrix) -> NDArray[np.bool_]:
        """Tell which positions (..., 2) [m] lie inside or on the border, (...)."""
        x, y = positions[..., 0], positions[..., 1]
        inside = (x >= self.x_min) & (x <= self.x_max) & (y >= self.y_min) & (y <= self.y_max)
        return np.asarray(inside)


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """A quantity over a region: `values` (rows, columns), rows to the north, columns to the east.

    Constant within a cell; a position outside has the value of the nearest cell.
    """

    region: Region
    values: Matrix

    def at(self, positions: Matrix) -> Vector:
        """Values (...) at positions (..., 2) [m]."""
        x_min, y_min, x_max, y_max = self.region
        rows, columns = self.values.shape
        i = _cell((positions[..., 1] - y_min) / (y_max - y_min), rows)
        j = _cell((positions[..., 0] - x_min) / (x_max - x_min), columns)
        return self.values[i, j]

    def centres(self) -> Matrix:
        """Centres (rows * columns, 2) [m] of the cells, row by row."""
        return _centres(self.region, *self.values.shape)

    def mean(self) -> float:
        """Mean over the region."""
        return float(self.values.mean())


Field = float | Raster
"""The same number everywhere, or a map of it."""


def cell_centres(region: Region, cell_m: float) -> tuple[Matrix, tuple[int, int]]:
    """Centres (rows * columns, 2) [m] of cells about `cell_m` wide, and (rows, columns)."""
    x_min, y_min, x_max, y_max = region
    columns = max(1, round((x_max - x_min) / cell_m))
    rows = max(1, round((y_max - y_min) / cell_m))
    return _centres(region, rows, columns), (rows, columns)


def value_at(quantity: Field, positions: Matrix) -> Vector:
    """Values (...) of a number or a map at positions (..., 2) [m]."""
    if isinstance(quantity, Raster):
        return quantity.at(positions)
    return np.full(positions.shape[:-1], float(quantity))


def _centres(region: Region, rows: int, columns: int) -> Matrix:
    x_min, y_min, x_max, y_max = region
    x = x_min + (np.arange(columns) + 0.5) * (x_max - x_min) / columns
    y = y_min + (np.arange(rows) + 0.5) * (y_max - y_min) / rows
    grid_x, grid_y = np.meshgrid(x, y)
    return np.column_stack([grid_x.ravel(), grid_y.ravel()])


def _cell(share: Vector, cells: int) -> NDArray[np.intp]:
    return np.clip(np.floor(share * cells), 0, cells - 1).astype(np.intp)
