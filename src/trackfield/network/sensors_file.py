"""Sensors as people list them, in a CSV file or in the site's own file, checked alike."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, cast

from trackfield.network.faults import find_faults, nearest, path_text
from trackfield.network.site_schema import SENSOR

_NUMBERS = ("x_m", "y_m", "z_m")
_SAME_PLACE_M = 1e-6  # sensors nearer than this are one sensor listed twice


class Sensor(NamedTuple):
    """One sensor as listed; `where` names its line or table for messages; z is NaN if not given."""

    where: str
    sensor_id: str
    position: tuple[float, float, float]
    model: str | None
    group: str | None


def read_text(path: Path) -> tuple[str, list[str]]:
    """Read a file of UTF-8 text; the text, or why there is none."""
    try:
        return path.read_text(encoding="utf-8-sig"), []
    except FileNotFoundError:
        return "", [f"{path}: found no such file"]
    except IsADirectoryError:
        return "", [f"{path}: found a folder, expected a file"]
    except OSError as error:
        return "", [f"{path}: cannot be read: {error.strerror}"]
    except UnicodeDecodeError as error:
        return "", [f"{path}: found binary data at byte {error.start}, expected text in UTF-8"]


def sensors_from_csv(text: str, name: str) -> tuple[list[Sensor], list[str]]:
    """Read sensor_id,x_m,y_m[,z_m][,model][,group]; sound rows, and what is wrong with others."""
    rows = csv.reader(text.splitlines())
    try:
        header = [column.strip() for column in next(rows, list[str]())]
        problems = _header_problems(header, name)
        if problems:
            return [], problems
        found: list[Sensor] = []
        for row in rows:
            where = f"{name}, line {rows.line_num}"
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(header):
                problems.append(f"{where}: found {len(row)} cells, expected {len(header)}")
                continue
            cells = {k: v.strip() for k, v in zip(header, row, strict=True) if v.strip()}
            sensor, faults = _sensor({k: _parsed(k, v) for k, v in cells.items()}, where)
            found += [sensor] if sensor else []
            problems += faults
    except csv.Error as error:
        return [], [f"{name}, line {rows.line_num}: {error}, expected comma-separated values"]
    return found, problems


def sensors_from_tables(tables: object, name: str) -> tuple[list[Sensor], list[str]]:
    """Read the `[[sensors]]` of file `name`; sound ones, and what is wrong with others."""
    if not isinstance(tables, list):
        return [], [f"{name}: sensors: expected a list of tables, each [[sensors]]"]
    entries = cast("list[dict[str, Any]]", tables)
    found: list[Sensor] = []
    problems: list[str] = []
    for number, table in enumerate(entries, start=1):
        sensor, faults = _sensor(table, f"{name}: sensors[{number}]")
        found += [sensor] if sensor else []
        problems += faults
    return found, problems


def repeated_sensors(sensors: list[Sensor]) -> Iterator[str]:
    """Say which sensors share a name or a place."""
    by_id: dict[str, Sensor] = {}
    by_place: dict[tuple[int, ...], Sensor] = {}
    for sensor in sensors:
        first = by_id.setdefault(sensor.sensor_id, sensor)
        if first is not sensor:
            yield (
                f"{sensor.where}: sensor_id: found {sensor.sensor_id!r} a second time, "
                f"expected every sensor once; the first: {first.where}"
            )
            continue
        x, y, z = sensor.position
        cell = tuple(round(c / _SAME_PLACE_M) for c in (x, y, 0.0 if math.isnan(z) else z))
        first = by_place.setdefault(cell, sensor)
        if first is not sensor:
            place = ", ".join(f"{c:g}" for c in sensor.position if not math.isnan(c))
            yield (
                f"{sensor.where}: found {sensor.sensor_id!r} at ({place}) m, the place of "
                f"{first.sensor_id!r} ({first.where}), expected two sensors to stand apart"
            )


def _header_problems(header: list[str], name: str) -> list[str]:
    if not any(header):
        return [f"{name}: found no header, expected sensor_id,x_m,y_m[,z_m][,model][,group]"]
    known = list(SENSOR.model_fields)
    where = f"{name}, line 1"
    unknown = [
        f"{where}: found an unknown column {column!r}; {nearest(column, known)}"
        for column in header
        if column not in known
    ]
    twice = [
        f"{where}: found column {column!r} twice, expected it once"
        for column in dict.fromkeys(header)
        if header.count(column) > 1
    ]
    missing = [
        f"{where}: found no column {column!r}, expected sensor_id,x_m,y_m[,z_m][,model][,group]"
        for column in ("sensor_id", "x_m", "y_m")
        if column not in header
    ]
    return unknown + twice + missing


def _parsed(column: str, cell: str) -> float | str:
    """Make the number of a cell, or leave it as it stands for the message."""
    if column not in _NUMBERS:
        return cell
    try:
        return float(cell)
    except ValueError:
        return cell


def _sensor(table: dict[str, Any], where: str) -> tuple[Sensor | None, list[str]]:
    faults = find_faults(SENSOR, table)
    if faults:
        dot = "." if where.endswith("]") else ": "
        return None, [
            f"{where}{dot}{path_text(path)}: {sentence}" if path else f"{where}: {sentence}"
            for path, sentence in faults
        ]
    position = (float(table["x_m"]), float(table["y_m"]), float(table.get("z_m", math.nan)))
    sensor = Sensor(where, table["sensor_id"], position, table.get("model"), table.get("group"))
    return sensor, []
