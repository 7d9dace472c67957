"""Reports from and to files: `reports.csv`, its NDJSON and Parquet kin, and from columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trackfield.io.arrow import table_of_columns
from trackfield.io.lines import Progress
from trackfield.io.sources import read_tables
from trackfield.io.tables import (
    NUMBER,
    OPTIONAL_NUMBER,
    Checks,
    Rule,
    Schema,
    Table,
    refuse_empty,
)
from trackfield.io.writing import write_table
from trackfield.types import Reports, join_rows

SCHEMA = Schema(("t_s", "x_m", "y_m"), ("arrival_s", "z_m", "sigma_m", "confidence"))

_SIGMA = Rule("a number above 0 or nothing", required=False, least=0.0, above=True)
_PROBABILITY = Rule("a probability from 0 to 1 or nothing", required=False, least=0.0)


def stream_reports(path: str | Path, *, progress: Progress | None = None) -> Iterator[Reports]:
    """Read a file of reports in chunks of about a megabyte; memory does not grow with the file.

    Rows stay in the order of the file; reports that come twice, late or from outside the region are
    for the tracker to judge. `progress` is told the share of the file read so far. `InputError`,
    when a chunk is asked for, names file, line, column, what was found and what was expected.
    """
    path = Path(path)
    empty = True
    for table in read_tables(path, SCHEMA, progress=progress):
        empty = False
        yield _reports(table)
    if empty:
        refuse_empty(str(path), SCHEMA)


def read_reports(path: str | Path, *, progress: Progress | None = None) -> Reports:
    """Read a file of reports as a whole; else as `stream_reports`."""
    return join_rows(list(stream_reports(path, progress=progress)))


def reports_from_columns(columns: object) -> Reports:
    """Make reports of a mapping of columns, a data frame of pandas or a table of Arrow.

    Columns are those of `reports.csv`; None and NaN are empty cells. `InputError` names row
    (counted from 0), column, what was found and what was expected.
    """
    table = table_of_columns(columns, SCHEMA, "reports")
    if not len(table):
        refuse_empty(table.file, SCHEMA)
    return _reports(table)


def write_reports(path: str | Path, reports: Reports) -> None:
    """Write reports as CSV, NDJSON or Parquet, by the suffix; every number comes back exactly.

    A covariance is written as the one sigma that a report has, its mean over the two axes. The file
    gets its name when it is complete. `InputError` where it cannot be written.
    """
    columns = reports.columns()
    write_table(Path(path), {name: columns[name] for name in SCHEMA.columns})


def _reports(table: Table) -> Reports:
    checks = Checks(table)
    t_s = checks.numbers("t_s")
    arrival_s = checks.numbers("arrival_s", OPTIONAL_NUMBER)
    rules = {"x_m": NUMBER, "y_m": NUMBER, "z_m": OPTIONAL_NUMBER}
    position = np.column_stack([checks.numbers(name, rule) for name, rule in rules.items()])
    sigma = checks.numbers("sigma_m", _SIGMA)
    confidence = checks.numbers("confidence", _PROBABILITY)
    checks.refuse(confidence > 1.0, "confidence", _PROBABILITY.expected)
    with np.errstate(over="ignore", under="ignore"):
        variance = sigma * sigma
    checks.refuse(np.isinf(variance) | (variance == 0.0), "sigma_m", _SIGMA.expected)
    checks.finish()
    covariance = np.column_stack([variance, np.where(np.isnan(sigma), np.nan, 0.0), variance])
    return Reports(t_s, arrival_s, position, covariance, confidence)
