"""Columns of Python values or arrays, as JSON, Parquet and callers give them."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Vector


@dataclass(frozen=True, slots=True, eq=False)
class ValueColumn:
    """Cells as they come; None and NaN are empty cells."""

    cells: Sequence[object] | NDArray[Any]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the cells; (n,) for what can be a column."""
        return self.cells.shape if isinstance(self.cells, np.ndarray) else (len(self.cells),)

    def numbers(self) -> tuple[Vector, int | None]:
        """Values, NaN where a cell is empty; and the first row that has no number."""
        if isinstance(self.cells, np.ndarray) and self.cells.dtype.kind in "fiu":
            return self.cells.astype(np.float64), None
        cells = self._list()
        values = np.full(len(cells), np.nan)
        if self._is_clock():
            return values, 0
        if set(map(type, cells)) <= {float}:
            values[:] = cells
            return values, None
        for row, cell in enumerate(cells):
            value = _number(cell)
            if value is None:
                return values, row
            values[row] = value
        return values, None

    def names(self, known: dict[str, int]) -> tuple[Indices, int | None]:
        """Places of names in `known`, which grows; -1 for empty cells; whole numbers are names."""
        cells = self._list()
        places = np.full(len(cells), -1, np.int32)
        if self._is_clock():
            return places, 0
        seen: dict[object, int] = {}
        for row, cell in enumerate(cells):
            key = cell if type(cell) is str else (type(cell), str(cell))
            place = seen.get(key)
            if place is None:
                name = _name(cell)
                if name is None:
                    return places, row
                place = seen[key] = known.setdefault(name, len(known)) if name else -1
            places[row] = place
        return places, None

    def text(self, row: int) -> str:
        """Say what stands in a cell."""
        cell = self.cells[row]
        return "" if cell is None else str(cell)

    def _is_clock(self) -> bool:
        """Dates and times: NumPy would make bare counts of nanoseconds of them."""
        return isinstance(self.cells, np.ndarray) and self.cells.dtype.kind in "mM"

    def _list(self) -> Sequence[object]:
        if isinstance(self.cells, np.ndarray):
            return cast("list[object]", self.cells.tolist())
        return self.cells


def column_of(cells: Iterable[object]) -> ValueColumn:
    """Make a column of a list, an array, or a column of pandas or Arrow."""
    if isinstance(cells, list | tuple):  # NumPy would make text of [1, "2"]
        return ValueColumn(cast("Sequence[object]", cells))
    array = np.asarray(cells)
    if array.dtype.kind == "O" and hasattr(cells, "notna"):
        # The missing value of pandas is neither equal to itself nor different.
        series = cast("Any", cells)
        array = np.asarray(series.astype(object).where(series.notna(), None))
    return ValueColumn(array)


def _number(cell: object) -> float | None:
    """Make a float; NaN of an empty cell, None of what is no number."""
    if cell is None:
        return math.nan
    if type(cell) is not bool and isinstance(cell, numbers.Real):
        try:
            return float(cell)
        except OverflowError:
            return math.inf
    return None


def _name(cell: object) -> str | None:
    """Make a name; empty of an empty cell, None of what is no name."""
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    if type(cell) is not bool and isinstance(cell, numbers.Integral):
        return str(cell)
    if isinstance(cell, str) and cell.isprintable():
        return cell.strip()
    return None
