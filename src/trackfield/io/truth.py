"""Truth from and to files: `truth.csv` and its NDJSON and Parquet kin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackfield.io.arrow import table_of_columns
from trackfield.io.sources import read_tables
from trackfield.io.tables import NUMBER, OPTIONAL_NUMBER, Checks, Schema, Table, refuse_empty
from trackfield.io.writing import write_table
from trackfield.types import Truth

SCHEMA = Schema(("t_s", "target_id", "x_m", "y_m"), ("z_m",))


def read_truth(path: str | Path) -> Truth:
    """Read where targets really were; rows stay in the order of the file.

    `InputError` names file, line, column, what was found and what was expected.
    """
    path, targets = Path(path), dict[str, int]()
    chunks = [_truth(table, targets) for table in read_tables(path, SCHEMA)]
    if not chunks:
        refuse_empty(str(path), SCHEMA)
    return Truth(
        t_s=np.concatenate([chunk.t_s for chunk in chunks]),
        target=np.concatenate([chunk.target for chunk in chunks]),
        position=np.concatenate([chunk.position for chunk in chunks]),
        target_ids=tuple(targets),
    )


def truth_from_columns(columns: object) -> Truth:
    """Make truth of a mapping of columns, a data frame of pandas or a table of Arrow.

    Columns are those of `truth.csv`. `InputError` names row (counted from 0), column, what was
    found and what was expected.
    """
    table = table_of_columns(columns, SCHEMA, "truth")
    if not len(table):
        refuse_empty(table.file, SCHEMA)
    return _truth(table, {})


def write_truth(path: str | Path, truth: Truth) -> None:
    """Write truth as CSV, NDJSON or Parquet, by the suffix; every number comes back exactly.

    The file gets its name when it is complete. `InputError` where it cannot be written.
    """
    write_table(Path(path), truth.columns())


def _truth(table: Table, targets: dict[str, int]) -> Truth:
    checks = Checks(table)
    t_s = checks.numbers("t_s")
    target = checks.names("target_id", targets)
    rules = {"x_m": NUMBER, "y_m": NUMBER, "z_m": OPTIONAL_NUMBER}
    position = np.column_stack([checks.numbers(name, rule) for name, rule in rules.items()])
    checks.finish()
    return Truth(t_s, target, position, tuple(targets))
