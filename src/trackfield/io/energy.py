"""What nodes have spent, to files: `energy.csv` and its NDJSON and Parquet kin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackfield.io.writing import write_table
from trackfield.network.meter import POSTS, Meter
from trackfield.types import Columns, Names

COLUMNS = ("sensor_id", *(f"{post}_j" for post in POSTS), "residual_j", "exhausted_s")


def energy_columns(meter: Meter) -> Columns:
    """Columns of a file, one row a node; `exhausted_s` is NaN of nodes that live."""
    places = np.arange(len(meter.sensor_ids), dtype=np.int32)
    died = np.where(meter.alive, np.nan, meter.exhausted_s)
    values = [*np.ascontiguousarray(meter.spent_j.T), meter.residual_j, died]
    return dict(zip(COLUMNS, [Names(places, meter.sensor_ids), *values], strict=True))


def write_energy(path: str | Path, meter: Meter) -> None:
    """Write what every node spent on what, as CSV, NDJSON or Parquet, by the suffix.

    The file gets its name when it is complete. `InputError` where it cannot be written.
    """
    write_table(Path(path), energy_columns(meter))
