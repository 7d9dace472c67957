"""Fingerprints: how strongly receivers heard a beacon that was held at surveyed places."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.network.bounds import FARTHEST_M
from trackfield.network.faults import nearest
from trackfield.types import Indices, Matrix, Vector

HEADER = "sensor_id,x_m,y_m[,z_m],mean_dbm[,std_db][,n]"
_REQUIRED = ("sensor_id", "x_m", "y_m", "mean_dbm")
_MOST = 2000  # of one receiver: a radio map inverts a matrix of that size


@dataclass(frozen=True, slots=True, eq=False)
class Fingerprints:
    """One row (m,) a receiver and surveyed place.

    `sensor` counts in the site; `position` (m, 3) [m], z NaN where untold; `mean_dbm` of `count`
    readings that scatter by `std_db`, both NaN where untold.
    """

    sensor: Indices
    position: Matrix
    mean_dbm: Vector
    std_db: Vector
    count: Vector

    def __len__(self) -> int:
        return int(self.sensor.size)


class _Cell(NamedTuple):
    """What a column may hold."""

    least: float
    most: float
    expected: str


_PLACE = _Cell(-FARTHEST_M, FARTHEST_M, "a finite number of metres, from -1e9 to 1e9")
_CELLS = {
    "x_m": _PLACE,
    "y_m": _PLACE,
    "z_m": _PLACE,
    "mean_dbm": _Cell(-200.0, 0.0, "a strength in dBm, -200 to 0"),
    "std_db": _Cell(0.0, 200.0, "a standard deviation in dB, 0 to 200, or nothing"),
    "n": _Cell(1.0, 1e12, "a number of readings, 1 or more, or nothing"),
}


def is_fingerprints(header: str) -> bool:
    """Tell a file of fingerprints by its first line."""
    columns = {column.strip() for column in header.split(",")}
    return {"mean_dbm", "x_m", "y_m"} <= columns


def fingerprints_from_csv(
    text: str, name: str, sensor_ids: tuple[str, ...]
) -> tuple[Fingerprints, list[str]]:
    """Read sensor_id,x_m,y_m[,z_m],mean_dbm[,std_db][,n]; sound rows, and what is wrong.

    Other columns are ignored. `name` is what messages call the file.
    """
    rows = csv.reader(text.splitlines())
    place = {sensor_id: i for i, sensor_id in enumerate(sensor_ids)}
    sensor: list[int] = []
    numbers: list[list[float]] = []
    problems: list[str] = []
    try:
        header = [column.strip() for column in next(rows, list[str]())]
        problems += [
            f"{name}, line 1: found no column {column!r}, expected {HEADER}"
            for column in _REQUIRED
            if column not in header
        ]
        for row in rows if not problems else ():
            where = f"{name}, line {rows.line_num}"
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(header):
                problems.append(f"{where}: found {len(row)} cells, expected {len(header)}")
                continue
            cells = {k: v.strip() for k, v in zip(header, row, strict=True)}
            known = place.get(cells["sensor_id"])
            values, faults = _numbers(cells)
            if known is None:
                faults += [
                    f"sensor_id: found {cells['sensor_id']!r}, expected a sensor of the site; "
                    f"{nearest(cells['sensor_id'], sensor_ids)}"
                ]
            problems += [f"{where}: {fault}" for fault in faults]
            if known is not None and not faults:
                sensor.append(known)
                numbers.append(values)
    except csv.Error as error:
        problems.append(f"{name}, line {rows.line_num}: {error}, expected comma-separated values")
    found = _table(sensor, numbers)
    return found, problems or _sizes(found, name, sensor_ids)


def _numbers(cells: Mapping[str, str]) -> tuple[list[float], list[str]]:
    """Read the numbers of a row in the order of `_CELLS`, NaN where untold; and what is wrong."""
    values: list[float] = []
    faults: list[str] = []
    for column, (least, most, expected) in _CELLS.items():
        text = cells.get(column, "")
        try:
            value = float(text) if text else math.nan
        except ValueError:
            value = math.inf
        untold = not text and column not in _REQUIRED
        if not (untold or least <= value <= most):
            faults.append(f"{column}: found {text[:60]!r}, expected {expected}")
        values.append(value)
    return values, faults


def _table(sensor: list[int], numbers: list[list[float]]) -> Fingerprints:
    values = np.array(numbers, float).reshape(-1, len(_CELLS))
    mean_dbm, std_db, count = values[:, 3:].T
    return Fingerprints(np.array(sensor, np.int32), values[:, :3], mean_dbm, std_db, count)


def _sizes(found: Fingerprints, name: str, sensor_ids: tuple[str, ...]) -> list[str]:
    if not len(found):
        return [f"{name}: found no rows, expected a line a receiver and place"]
    return [
        f"{name}: found {count} places of {sensor_ids[place]!r}, expected {_MOST} at most"
        for place, count in enumerate(np.bincount(found.sensor).tolist())
        if count > _MOST
    ]
