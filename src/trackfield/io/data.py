"""Data of either kind, readings or reports, told apart by their columns."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

from trackfield.io.arrow import parquet_module
from trackfield.io.lines import Progress
from trackfield.io.measurements import readings_from_columns, stream_readings
from trackfield.io.reports import reports_from_columns, stream_reports
from trackfield.io.sources import suffix_of
from trackfield.types import Readings, Reports

_PEEK = 1 << 16  # bytes in which the columns stand


def stream_data(
    path: str | Path,
    *,
    sensor_ids: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Iterator[Readings] | Iterator[Reports]:
    """Read a file of readings or of reports in chunks, as `stream_readings` and `stream_reports`.

    A file is of reports if it has positions, columns `x_m` or `y_m`, and names no sensors.
    """
    if holds_reports(path):
        return stream_reports(path, progress=progress)
    return stream_readings(path, sensor_ids=sensor_ids, progress=progress)


def data_from_columns(
    columns: object, *, sensor_ids: Sequence[str] | None = None
) -> Readings | Reports:
    """Make readings or reports of a mapping of columns, a data frame, or a table of Arrow."""
    source = cast("Any", columns)
    names = source.column_names if hasattr(source, "column_names") else _keys(source)
    if _of_reports(names):
        return reports_from_columns(columns)
    return readings_from_columns(columns, sensor_ids=sensor_ids)


def holds_reports(path: str | Path) -> bool:
    """Tell whether a file is one of reports; one that cannot be told is left to its reader.

    A pipe cannot be told: what is looked at would be gone.
    """
    path = Path(path)
    suffix = suffix_of(path, geojson=False)
    if not path.is_file():
        return False
    try:
        if suffix == ".parquet":
            return _of_reports(parquet_module(path).read_schema(path).names)
        with path.open("rb") as file:
            text = file.read(_PEEK).decode("utf-8-sig", "replace")
    except (OSError, ValueError):
        return False
    first = next((line for line in text.splitlines() if line.strip()), "")
    if suffix == ".csv":
        return _of_reports(cell.strip().strip('"') for cell in first.split(","))
    try:
        return _of_reports(_keys(json.loads(first)))
    except json.JSONDecodeError:
        return False


def _of_reports(columns: Iterable[object]) -> bool:
    names = {str(column) for column in columns}
    return bool(names & {"x_m", "y_m"}) and "sensor_id" not in names


def _keys(value: Any) -> Iterable[object]:  # noqa: ANN401 - of whatever has keys
    return value.keys() if hasattr(value, "keys") else ()
