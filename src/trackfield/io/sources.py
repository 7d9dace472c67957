"""Tables from files of any kind that we read, told apart by their suffix."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from trackfield.errors import InputError
from trackfield.io.arrow import parquet_tables
from trackfield.io.csv_tables import csv_tables
from trackfield.io.lines import Progress
from trackfield.io.ndjson_tables import geojson_tables, ndjson_tables
from trackfield.io.tables import Schema, Table

SUFFIXES = (".csv", ".ndjson", ".jsonl", ".parquet")


def read_tables(
    path: Path, schema: Schema, *, geojson: bool = False, progress: Progress | None = None
) -> Iterator[Table]:
    """Read a file as tables of some rows each, none of them empty; memory stays bounded.

    `geojson` allows that suffix too. `InputError` as the readers of each kind say.
    """
    suffix = suffix_of(path, geojson=geojson)
    if suffix == ".csv":
        tables = csv_tables(path, schema, progress=progress)
    elif suffix == ".parquet":
        tables = parquet_tables(path, schema, progress=progress)
    elif suffix == ".geojson":
        tables = geojson_tables(path, schema)
    else:
        tables = ndjson_tables(path, schema, progress=progress)
    yield from (table for table in tables if len(table))


def suffix_of(path: Path, *, geojson: bool) -> str:
    """Suffix of a file in small letters; `InputError` for one that says no known kind."""
    suffix = path.suffix.lower()
    known = (*SUFFIXES, ".geojson") if geojson else SUFFIXES
    if suffix not in known:
        found = f"suffix {path.suffix!r}" if suffix else "no suffix"
        raise InputError(f"{path}: found {found}, expected one of {', '.join(known)}")
    return suffix
