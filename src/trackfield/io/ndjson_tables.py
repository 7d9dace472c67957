"""Files with one JSON object a line as tables, block by block."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from trackfield.errors import InputError
from trackfield.io.lines import Progress, line_blocks
from trackfield.io.tables import Schema, Table, check_columns
from trackfield.io.values import ValueColumn

_Row = dict[str, Any]


def ndjson_tables(
    path: Path, schema: Schema, *, progress: Progress | None = None
) -> Iterator[Table]:
    """Read a file of JSON objects, some rows at a time; an absent key is an empty cell.

    Empty lines are skipped. `InputError` for what is no JSON object and for keys that `schema` does
    not know.
    """
    for block in line_blocks(path, progress=progress):
        texts = block.data.decode().split("\n")
        lines = [block.line + i for i, text in enumerate(texts) if text.strip()]
        rows = _rows([text for text in texts if text.strip()], lines, path)
        table = table_of_rows(rows, schema, lines, place=(str(path), "line"))
        if len(table):
            yield table


def geojson_tables(path: Path, schema: Schema) -> Iterator[Table]:
    """Read the properties of all features of a GeoJSON file, which is read as a whole."""
    text = b"".join(block.data for block in line_blocks(path)).decode()
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        where = f"{path}, line {error.lineno}"
        raise InputError(f"{where}: {error.msg}, expected a GeoJSON object") from None
    features = _member(document, "features")
    if not isinstance(features, list):
        raise InputError(f"{path}: found no list of features, expected a FeatureCollection")
    rows = [_member(feature, "properties") for feature in cast("list[object]", features)]
    for place, row in enumerate(rows):
        if not isinstance(row, dict):
            where = f"{path}, feature index {place}"
            raise InputError(f"{where}: found no properties, expected {schema}")
    place = (str(path), "feature index")
    yield table_of_rows(cast("list[_Row]", rows), schema, range(len(rows)), place=place)


def table_of_rows(
    rows: Sequence[_Row], schema: Schema, numbers: Iterable[int], *, place: tuple[str, str]
) -> Table:
    """Turn rows into columns; `place` is the file and what `numbers` count in it."""
    numbers = np.array(list(numbers), np.int64)
    allowed = frozenset(schema.columns)
    for row, number in zip(rows, numbers, strict=True):
        if not row.keys() <= allowed:
            keys = dict.fromkeys([*schema.required, *row])
            check_columns(keys, schema, f"{place[0]}, {place[1]} {number}")
    columns = {name: ValueColumn([row.get(name) for row in rows]) for name in schema.columns}
    return Table(place[0], place[1], numbers, columns)


def _rows(texts: list[str], lines: list[int], path: Path) -> list[_Row]:
    """Parse lines as one array, which takes half the time; one by one to find a fault."""
    try:
        parsed = cast("list[object]", json.loads("[" + ",".join(texts) + "]"))
    except (json.JSONDecodeError, RecursionError):
        parsed = []
    rows = [cast("_Row", row) for row in parsed if isinstance(row, dict)]
    if len(rows) == len(parsed) == len(texts):
        return rows
    return [_row(text, f"{path}, line {line}") for text, line in zip(texts, lines, strict=True)]


def _row(text: str, where: str) -> _Row:
    try:
        row = json.loads(text)
    except (json.JSONDecodeError, RecursionError):
        row = None
    if not isinstance(row, dict):
        raise InputError(f"{where}: found {text.strip()[:60]!r}, expected a JSON object")
    return cast("_Row", row)


def _member(value: object, key: str) -> object:
    return cast("_Row", value).get(key) if isinstance(value, dict) else None
