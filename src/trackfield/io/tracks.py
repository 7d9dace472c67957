"""Tracks to and from files: `tracks.csv` and its NDJSON, Parquet and GeoJSON kin."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from trackfield.errors import InputError
from trackfield.io.arrow import parquet_module
from trackfield.io.output import replacing
from trackfield.io.sources import read_tables, suffix_of
from trackfield.io.tables import NUMBER, OPTIONAL_NUMBER, Checks, Rule, Schema, Table
from trackfield.io.track_sinks import (
    Sink,
    empty_tracks,
    geojson_sink,
    parquet_sink,
    text_sink,
)
from trackfield.io.writing import CSV, NDJSON
from trackfield.network.site import Origin
from trackfield.types import STATUS_WORDS, Indices, Tracks, join_rows, select_rows

_MOTION = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
_COVARIANCE = ("cov_xx", "cov_xy", "cov_yy")
SCHEMA = Schema(("t_s", "track_id", *_MOTION, *_COVARIANCE, "status"), ("target_id",))

_WHOLE = Rule(f"a whole number from 0 to {2**31 - 1}", least=0.0)
_VARIANCE = Rule("a finite number, 0 or more", least=0.0)
_HEIGHTS = ("z_m", "vz_m_s")
_CHUNK_ROWS = 1 << 12


@contextmanager
def open_tracks(path: str | Path, *, origin: Origin | None = None) -> Generator[Sink]:
    """Give a function that appends tracks to a file of CSV, NDJSON, Parquet or GeoJSON.

    The suffix says which; GeoJSON needs the `origin` of the site. The file gets its name when the
    block ends, and does not appear if it fails or is interrupted. `InputError` at once where the
    place cannot be written. Times, positions and velocities are rounded to 1e-6, covariances
    to 1e-9; Parquet keeps all digits.
    """
    path = Path(path)
    suffix = suffix_of(path, geojson=True)
    if suffix == ".parquet":
        parquet_module(path)
    if suffix == ".geojson" and origin is None:
        raise InputError(
            f"{path}: found a site without origin, expected [site] origin = {{lat, lon}} to write "
            "GeoJSON"
        )
    pending: list[Tracks] = []
    with replacing(path) as file, _sink(suffix, file, path, origin) as write:

        def append(tracks: Tracks) -> None:
            pending.append(tracks)
            if sum(map(len, pending)) >= _CHUNK_ROWS:
                write(join_tracks(pending))
                pending.clear()

        yield append
        write(join_tracks(pending))


def write_tracks(path: str | Path, tracks: Tracks, *, origin: Origin | None = None) -> None:
    """Write tracks as a whole; else as `open_tracks`."""
    with open_tracks(path, origin=origin) as append:
        for start in range(0, len(tracks), _CHUNK_ROWS):
            append(select_rows(tracks, slice(start, start + _CHUNK_ROWS)))


def read_tracks(path: str | Path) -> Tracks:
    """Read tracks of CSV, NDJSON, Parquet or GeoJSON (of its properties, which are local metres).

    A file without rows is a tracker that showed nothing. `nis` is NaN: files do not tell it.
    `InputError` names file, line, column, what was found and what was expected.
    """
    targets = dict[str, int]()
    tables = read_tables(Path(path), SCHEMA, geojson=True)
    return join_tracks([_tracks(table, targets) for table in tables])


def join_tracks(chunks: Iterable[Tracks]) -> Tracks:
    """Put tracks one after the other; targets of the same name become one."""
    targets: dict[str, int] = {}
    parts = [replace(chunk, target=_renumbered(chunk, targets)) for chunk in chunks]
    return replace(join_rows(parts or [empty_tracks()]), target_ids=tuple(targets))


def _sink(
    suffix: str, file: BinaryIO, path: Path, origin: Origin | None
) -> AbstractContextManager[Sink]:
    if suffix == ".geojson" and origin is not None:
        return geojson_sink(file, path, origin)
    if suffix == ".parquet":
        return parquet_sink(file, path)
    return text_sink(file, path, CSV if suffix == ".csv" else NDJSON)


def _renumbered(chunk: Tracks, targets: dict[str, int]) -> Indices:
    """Targets of a chunk as places in `targets`, which grows."""
    places = [targets.setdefault(name, len(targets)) for name in chunk.target_ids]
    return np.array([*places, -1], np.int32)[chunk.target]  # -1 is the last one


def _tracks(table: Table, targets: dict[str, int]) -> Tracks:
    checks = Checks(table)
    t_s = checks.numbers("t_s")
    track = checks.numbers("track_id", _WHOLE)
    checks.refuse((track != np.rint(track)) | (track >= 2**31), "track_id", _WHOLE.expected)
    motion = np.column_stack(
        [checks.numbers(name, OPTIONAL_NUMBER if name in _HEIGHTS else NUMBER) for name in _MOTION]
    )
    covariance = np.column_stack(
        [checks.numbers(name, NUMBER if name == "cov_xy" else _VARIANCE) for name in _COVARIANCE]
    )
    status = checks.one_of("status", STATUS_WORDS, what="a status")
    target = checks.names("target_id", targets, required=False)
    checks.finish()
    return Tracks(
        t_s=t_s,
        track=track.astype(np.int32),
        position=motion[:, :3],
        velocity=motion[:, 3:],
        covariance=covariance,
        status=status,
        target=target,
        nis=np.full(t_s.size, np.nan),
        target_ids=tuple(targets),
    )
