"""Readings from and to files: `measurements.csv`, its NDJSON and Parquet kin, and from columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from trackfield.io.arrow import table_of_columns
from trackfield.io.lines import Progress
from trackfield.io.sources import read_tables
from trackfield.io.tables import (
    OPTIONAL_NUMBER,
    Checks,
    Rule,
    Schema,
    Table,
    refuse_empty,
)
from trackfield.io.writing import write_table
from trackfield.network.kinds import KINDS
from trackfield.types import Readings, join_rows

SCHEMA = Schema(("t_s", "sensor_id", "kind", "value"), ("sigma", "target_id", "arrival_s"))
_SIGMA = Rule("a number above 0 or nothing", required=False, least=0.0, above=True)


def stream_readings(
    path: str | Path,
    *,
    sensor_ids: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Iterator[Readings]:
    """Read a file of readings in chunks of about a megabyte; memory does not grow with the file.

    All chunks share their tables of names: an index means the same name in every chunk, and the
    `target_ids` of a later chunk may only have more names at the end. With `sensor_ids`, those of a
    site, `Readings.sensor` indexes that very tuple and other sensors are refused; without, the
    table grows in order of appearance. `kinds` is always that of all known kinds. Rows stay in the
    order of the file; readings that come twice or late are for the tracker to judge.

    `progress` is told the share of the file read so far. `InputError`, when a chunk is asked for,
    names file, line, column, what was found and what was expected.
    """
    path = Path(path)
    sensors, targets = _numbered(sensor_ids or ()), dict[str, int]()
    empty = True
    for table in read_tables(path, SCHEMA, progress=progress):
        empty = False
        yield _readings(table, sensors, targets, fixed=sensor_ids is not None)
    if empty:
        refuse_empty(str(path), SCHEMA)


def read_readings(
    path: str | Path,
    *,
    sensor_ids: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Readings:
    """Read a file of readings as a whole; else as `stream_readings`."""
    return join_rows(list(stream_readings(path, sensor_ids=sensor_ids, progress=progress)))


def readings_from_columns(columns: object, *, sensor_ids: Sequence[str] | None = None) -> Readings:
    """Make readings of a mapping of columns, a data frame of pandas or a table of Arrow.

    Columns are those of `measurements.csv`; None and NaN are empty cells. `InputError` names row
    (counted from 0), column, what was found and what was expected.
    """
    table = table_of_columns(columns, SCHEMA, "readings")
    if not len(table):
        refuse_empty(table.file, SCHEMA)
    return _readings(table, _numbered(sensor_ids or ()), {}, fixed=sensor_ids is not None)


def write_readings(path: str | Path, readings: Readings) -> None:
    """Write readings as CSV, NDJSON or Parquet, by the suffix; every number comes back exactly.

    The file gets its name when it is complete. `InputError` where it cannot be written.
    """
    write_table(Path(path), readings.columns())


def _readings(
    table: Table, sensors: dict[str, int], targets: dict[str, int], *, fixed: bool
) -> Readings:
    checks = Checks(table)
    t_s = checks.numbers("t_s")
    if fixed:
        sensor = checks.one_of("sensor_id", sensors, what="a sensor of the site")
    else:
        sensor = checks.names("sensor_id", sensors)
    kind = checks.one_of("kind", KINDS, what="a kind of reading")
    value = checks.numbers("value")
    for place, (_, _, (expected, least, binary, most), *_) in enumerate(KINDS.values()):
        outside = (value < least) | (value > most)
        wrong = (value != 0.0) & (value != 1.0) if binary else outside
        checks.refuse((kind == place) & wrong, "value", expected)
    sigma = checks.numbers("sigma", _SIGMA)
    target = checks.names("target_id", targets, required=False)
    arrival_s = checks.numbers("arrival_s", OPTIONAL_NUMBER)
    checks.finish()
    return Readings(
        t_s=t_s,
        sensor=sensor,
        value=value,
        target=target,
        kind=kind,
        sigma=sigma,
        arrival_s=arrival_s,
        sensor_ids=tuple(sensors),
        target_ids=tuple(targets),
        kinds=tuple(KINDS),
    )


def _numbered(names: Iterable[str]) -> dict[str, int]:
    return {name: place for place, name in enumerate(names)}
