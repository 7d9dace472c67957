"""Parquet files and columns in memory as tables; pyarrow is wanted for Parquet only."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import numpy as np

from trackfield.errors import InputError
from trackfield.io.lines import Progress
from trackfield.io.tables import Schema, Table, check_columns
from trackfield.io.values import ValueColumn, column_of

ArrowArray = Any  # pyarrow.Array, which has no types

_BATCH_ROWS = 1 << 16


def parquet_module(path: Path) -> ModuleType:
    """Import `pyarrow.parquet`; `InputError` says how to get it for the sake of `path`."""
    try:
        return importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            f'{path}: Parquet needs pyarrow, found none: pip install "trackfield[data]"'
        ) from None


def parquet_tables(
    path: Path, schema: Schema, *, progress: Progress | None = None
) -> Iterator[Table]:
    """Read a Parquet file, some rows at a time."""
    parquet = parquet_module(path)
    faults = importlib.import_module("pyarrow").ArrowException
    try:
        with path.open("rb") as opened, parquet.ParquetFile(opened) as file:
            check_columns(file.schema_arrow.names, schema, str(path))
            total, done = file.metadata.num_rows, 0
            for batch in file.iter_batches(batch_size=_BATCH_ROWS):
                rows = np.arange(done, done + batch.num_rows, dtype=np.int64)
                columns = {name: _arrow_column(batch.column(name)) for name in batch.schema.names}
                yield Table(str(path), "row index", rows, columns)
                done += batch.num_rows
                if progress is not None:
                    progress(done / total)
    except faults as error:
        raise InputError(f"{path}: {error}, expected a Parquet file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def table_of_columns(columns: object, schema: Schema, name: str) -> Table:
    """Make a table of a mapping of columns, a data frame of pandas or a table of Arrow.

    `name` is what messages call it. `InputError` for columns that `schema` does not allow or that
    have not all the same length.
    """
    source = cast("Any", columns)
    if not (hasattr(source, "column_names") or hasattr(source, "keys")):
        found = type(columns).__name__
        raise InputError(f"{name}: found {found}, expected a mapping of columns: {schema}")
    is_arrow = hasattr(source, "column_names")
    given = source.column_names if is_arrow else source.keys()
    found = [str(column) for column in cast("Iterable[object]", given)]
    check_columns(found, schema, name)
    make = _arrow_column if is_arrow else column_of
    table = {column: make(source[column]) for column in found}
    shapes = {column: cells.shape for column, cells in table.items()}
    length = shapes[found[0]]
    for column, shape in shapes.items():
        if shape != length or len(shape) != 1:
            raise InputError(
                f"{name}: {column}: found shape {shape}, expected one number of rows everywhere, "
                f"as in {found[0]} with shape {length}"
            )
    return Table(name, "row index", np.arange(length[0], dtype=np.int64), table)


def _arrow_column(column: ArrowArray) -> ValueColumn:
    kind = column.type
    if hasattr(kind, "index_type"):  # of a dictionary, whose own way to NumPy forgets its nulls
        column = column.cast(kind.value_type)
    return ValueColumn(column.to_numpy(zero_copy_only=False))
