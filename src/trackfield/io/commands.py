"""Commands to nodes from and to files: `commands.csv` and its NDJSON and Parquet kin."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from trackfield.io.arrow import table_of_columns
from trackfield.io.sources import read_tables
from trackfield.io.tables import Checks, Schema, Table
from trackfield.io.writing import write_table
from trackfield.types import MODE_WORDS, Commands

SCHEMA = Schema(("t_s", "sensor_id", "mode"), ())


def read_commands(path: str | Path, *, sensor_ids: Sequence[str] | None = None) -> Commands:
    """Read what nodes were told to do; rows stay in the order of the file.

    A file without rows told nobody anything. Where `sensor_ids` are given, other sensors are
    refused, and the table's numbers are places in them. `InputError` names file, line, column,
    what was found and what was expected.
    """
    names = dict[str, int]()
    chunks = [_commands(table, names, sensor_ids) for table in read_tables(Path(path), SCHEMA)] or [
        Commands(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int32), ())
    ]
    return Commands(
        t_s=np.concatenate([chunk.t_s for chunk in chunks]),
        sensor=np.concatenate([chunk.sensor for chunk in chunks]),
        mode=np.concatenate([chunk.mode for chunk in chunks]),
        sensor_ids=tuple(names if sensor_ids is None else sensor_ids),
    )


def commands_from_columns(columns: object) -> Commands:
    """Make commands of a mapping of columns, a data frame of pandas or a table of Arrow.

    Columns are those of `commands.csv`. `InputError` names row (counted from 0), column, what was
    found and what was expected.
    """
    return _commands(table_of_columns(columns, SCHEMA, "commands"), {}, None)


def write_commands(path: str | Path, commands: Commands) -> None:
    """Write commands as CSV, NDJSON or Parquet, by the suffix; every number comes back exactly.

    The file gets its name when it is complete. `InputError` where it cannot be written.
    """
    write_table(Path(path), commands.columns())


def _commands(table: Table, names: dict[str, int], known: Sequence[str] | None) -> Commands:
    checks = Checks(table)
    t_s = checks.numbers("t_s")
    if known is None:
        sensor = checks.names("sensor_id", names)
    else:
        sensor = checks.one_of("sensor_id", known, what="a sensor of the site")
    mode = checks.one_of("mode", MODE_WORDS, what="a mode")
    checks.finish()
    return Commands(t_s, sensor, mode, tuple(names if known is None else known))
