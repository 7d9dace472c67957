"""Rooms of targets to files: `rooms.csv` and its NDJSON and Parquet kin."""

from __future__ import annotations

from pathlib import Path

from trackfield.filtering.rooms import RoomRows
from trackfield.io.writing import write_table

COLUMNS = ("t_s", "track_id", "target_id", "room", "p")


def write_rooms(path: str | Path, rows: RoomRows) -> None:
    """Write the rooms of a run as CSV, NDJSON or Parquet, by the suffix.

    The file gets its name when it is complete. `InputError` where it cannot be written.
    """
    write_table(Path(path), rows.columns())
