"""Tables that go out: as rows of CSV or JSON, or as Parquet."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.io.arrow import parquet_module
from trackfield.io.cells import Cells, fixed_cells, packed, text_cells
from trackfield.io.output import replacing, saying
from trackfield.io.sources import suffix_of
from trackfield.types import Columns, Names, arrow_table

_CHUNK_ROWS = 1 << 12


class Dialect(NamedTuple):
    """How rows are written: an empty cell, a name, the first line, and what stands round cells."""

    blank: bytes
    name: Callable[[str], str]
    header: Callable[[Sequence[str]], bytes]
    marks: Callable[[Sequence[str]], list[bytes]]  # one more than columns


def _csv_name(name: str) -> str:
    quoted = name.replace('"', '""')
    return f'"{quoted}"' if "," in quoted or '"' in quoted else name


def _csv_header(columns: Sequence[str]) -> bytes:
    return ",".join(columns).encode() + b"\n"


def _csv_marks(columns: Sequence[str]) -> list[bytes]:
    return [b"", *[b","] * (len(columns) - 1), b"\n"]


def _no_header(_: Sequence[str]) -> bytes:
    return b""


def _ndjson_marks(columns: Sequence[str]) -> list[bytes]:
    return [*json_marks(columns), b"}\n"]


def json_marks(columns: Sequence[str]) -> list[bytes]:
    """Make what stands before each cell of a JSON object."""
    return [f'{"," if place else "{"}"{name}":'.encode() for place, name in enumerate(columns)]


CSV = Dialect(blank=b"", name=_csv_name, header=_csv_header, marks=_csv_marks)
NDJSON = Dialect(blank=b"null", name=json.dumps, header=_no_header, marks=_ndjson_marks)


def cells_of(
    column: NDArray[Any] | Names, dialect: Dialect, *, decimals: int | None = None
) -> Cells:
    """Cells of a column; numbers come back exactly if their `decimals` are not said."""
    blank = dialect.blank
    if isinstance(column, Names):
        return name_cells(column.names, dialect)[column.places]
    if decimals is not None:
        return fixed_cells(column, decimals, blank=blank)
    if column.dtype.kind != "f":
        return text_cells([b"%d" % value for value in column.tolist()])
    if np.isinf(column).any():
        raise InputError("found an infinite number, expected finite ones")
    texts = [repr(value).encode() for value in column.tolist()]
    return text_cells([blank if text == b"nan" else text for text in texts])


def name_cells(names: Sequence[str], dialect: Dialect) -> Cells:
    """Cells of names, and at last that of none: the place -1 of a column."""
    for name in names:
        _check_name(name)
    return text_cells([*(dialect.name(name).encode() for name in names), dialect.blank])


def rows_of(columns: Mapping[str, Cells], dialect: Dialect) -> bytes:
    """Text of the rows of some columns."""
    *marks, last = dialect.marks(list(columns))
    pieces = [
        piece for pair in zip(marks, columns.values(), strict=True) for piece in pair if len(piece)
    ]
    rows = len(next(iter(columns.values())))
    return packed([*pieces, last], rows) if rows else b""


def write_table(path: Path, columns: Columns) -> None:
    """Write a whole table as CSV, NDJSON or Parquet, by the suffix; complete or not at all."""
    suffix = suffix_of(path, geojson=False)
    if suffix == ".parquet":
        parquet = parquet_module(path)
        with replacing(path) as file, saying(path):
            parquet.write_table(arrow_table(columns), file)
        return
    write_tables(path, [columns])


def write_tables(path: Path, tables: Iterable[Columns]) -> None:
    """Write tables that have the same columns, one below the other, as CSV or NDJSON.

    They are written as they come, and the file gets its name when it is complete.
    """
    dialect = CSV if suffix_of(path, geojson=False) == ".csv" else NDJSON
    names: dict[tuple[str, ...], Cells] = {}  # the texts of names, made once
    with replacing(path) as file:
        for number, columns in enumerate(tables):
            if not number:
                with saying(path):
                    file.write(dialect.header(list(columns)))
            for start in range(0, _length(columns), _CHUNK_ROWS):
                part = {
                    name: _cells(_rows(column, start), dialect, names)
                    for name, column in columns.items()
                }
                with saying(path):
                    file.write(rows_of(part, dialect))


def _length(columns: Columns) -> int:
    return max(
        len(column.places if isinstance(column, Names) else column) for column in columns.values()
    )


def _cells(
    column: NDArray[Any] | Names, dialect: Dialect, known: dict[tuple[str, ...], Cells]
) -> Cells:
    """Cells of a column, of names by their `known` texts."""
    if not isinstance(column, Names):
        return cells_of(column, dialect)
    if column.names not in known:
        known[column.names] = name_cells(column.names, dialect)
    return known[column.names][column.places]


def _rows(column: NDArray[Any] | Names, start: int) -> NDArray[Any] | Names:
    rows = slice(start, start + _CHUNK_ROWS)
    return Names(column.places[rows], column.names) if isinstance(column, Names) else column[rows]


def _check_name(name: str) -> None:
    """Refuse a name that a reader would not take back."""
    if not name or name != name.strip() or not name.isprintable():
        raise InputError(f"found the name {name!r}, expected printable text without outer spaces")
