"""Tables that go out: as rows of CSV or JSON, or as Parquet."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.io.arrow import parquet_module
from trackfield.io.output import replacing, saying
from trackfield.io.sources import suffix_of
from trackfield.types import Columns, Names, arrow_table


class Texts(NamedTuple):
    """A column that is written as it stands."""

    cells: list[str]


Outgoing = Mapping[str, NDArray[Any] | Names | Texts]
NO_CODES: Mapping[str, str] = {}


class Dialect(NamedTuple):
    """How a row is written: an empty cell, a name, and the cells of a row joined."""

    blank: str
    name: Callable[[str], str]
    row: Callable[[Sequence[str], Sequence[str]], str]  # of names of columns and codes of cells


def _csv_name(name: str) -> str:
    quoted = name.replace('"', '""')
    return f'"{quoted}"' if "," in quoted or '"' in quoted else name


def _csv_row(_: Sequence[str], codes: Sequence[str]) -> str:
    return ",".join(codes) + "\n"


def _json_row(columns: Sequence[str], codes: Sequence[str]) -> str:
    cells = (f'"{column}":{code}' for column, code in zip(columns, codes, strict=True))
    return "{" + ",".join(cells) + "}\n"


CSV = Dialect(blank="", name=_csv_name, row=_csv_row)
NDJSON = Dialect(blank="null", name=json.dumps, row=_json_row)


def header_of(columns: Iterable[str], dialect: Dialect) -> str:
    """Make the line before all rows, if there is one."""
    return ",".join(columns) + "\n" if dialect is CSV else ""


def rows_of(columns: Outgoing, dialect: Dialect, *, codes: Mapping[str, str] = NO_CODES) -> str:
    """Write all rows of some columns as text; `codes` say how numbers, else they are exact."""
    cells = [_cells(column, codes.get(name, "%r"), dialect) for name, column in columns.items()]
    template = dialect.row(list(columns), [code for code, _ in cells])
    return "".join(map(template.__mod__, zip(*(texts for _, texts in cells), strict=True)))


def write_table(path: Path, columns: Columns) -> None:
    """Write a whole table as CSV, NDJSON or Parquet, by the suffix; complete or not at all."""
    suffix = suffix_of(path, geojson=False)
    if suffix == ".parquet":
        parquet = parquet_module(path)
        with replacing(path) as file, saying(path):
            parquet.write_table(arrow_table(columns), file)
        return
    dialect = CSV if suffix == ".csv" else NDJSON
    with replacing(path) as file:
        text = header_of(columns, dialect) + rows_of(columns, dialect)
        with saying(path):
            file.write(text.encode())


def check_name(name: str) -> None:
    """Refuse a name that a reader would not take back."""
    if not name or name != name.strip() or not name.isprintable():
        raise InputError(f"found the name {name!r}, expected printable text without outer spaces")


def _cells(
    column: NDArray[Any] | Names | Texts, code: str, dialect: Dialect
) -> tuple[str, list[Any]]:
    """Code and values of a column's cells."""
    if isinstance(column, Texts):
        return "%s", column.cells
    if isinstance(column, Names):
        for name in column.names:
            check_name(name)
        texts = [*map(dialect.name, column.names), dialect.blank]  # -1 is the last one
        return "%s", [texts[place] for place in column.places.tolist()]
    values: list[Any] = column.tolist()
    if column.dtype.kind != "f" or not np.isnan(column).any():
        return code, values
    return "%s", [dialect.blank if math.isnan(value) else code % value for value in values]
