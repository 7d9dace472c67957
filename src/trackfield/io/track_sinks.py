"""Rows of tracks into an open file: as CSV, NDJSON, GeoJSON or Parquet."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from trackfield.errors import InputError
from trackfield.io.arrow import parquet_module
from trackfield.io.cells import Cells, fixed_cells
from trackfield.io.geodesy import to_geographic
from trackfield.io.output import saying
from trackfield.io.writing import NDJSON, Dialect, cells_of, json_marks, rows_of
from trackfield.network.site import Origin
from trackfield.types import Columns, Matrix, Tracks, arrow_table

Sink = Callable[[Tracks], None]

# Micrometres and microseconds; a covariance of (1 mm)^2 still has three digits.
_DECIMALS: Mapping[str, int] = {
    **dict.fromkeys(("t_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"), 6),
    **dict.fromkeys(("cov_xx", "cov_xy", "cov_yy"), 9),
}
_POINT = "point"
_DEGREES = 9  # decimals: a tenth of a millimetre


@contextmanager
def text_sink(file: BinaryIO, path: Path, dialect: Dialect) -> Generator[Sink]:
    """Write rows of CSV or NDJSON."""

    def write(tracks: Tracks) -> None:
        _put(file, rows_of(_cells(tracks, path, dialect), dialect), path)

    _put(file, dialect.header(list(columns_of(_NONE, path))), path)
    yield write


@contextmanager
def geojson_sink(file: BinaryIO, path: Path, origin: Origin) -> Generator[Sink]:
    """Write a FeatureCollection of points, one a row, on lines of their own."""
    comma = b""

    def write(tracks: Tracks) -> None:
        nonlocal comma
        points = {_POINT: _points(to_geographic(tracks.position, origin))}
        rows = rows_of(points | _cells(tracks, path, _FEATURES), _FEATURES)
        if rows:
            _put(file, comma + rows.removesuffix(b",\n"), path)
            comma = b",\n"

    _put(file, b'{"type":"FeatureCollection","features":[\n', path)
    yield write
    _put(file, b"\n]}\n", path)


@contextmanager
def parquet_sink(file: BinaryIO, path: Path) -> Generator[Sink]:
    """Write row groups of Parquet."""
    schema = arrow_table(columns_of(_NONE, path)).schema
    with saying(path):
        writer = parquet_module(path).ParquetWriter(file, schema)

    def write(tracks: Tracks) -> None:
        with saying(path):
            writer.write_table(arrow_table(columns_of(tracks, path)))

    try:
        yield write
    finally:
        with saying(path):
            writer.close()


def columns_of(tracks: Tracks, path: Path) -> Columns:
    """Columns of `tracks.csv`; `InputError` for a number that is not finite, but for heights."""
    x, y, z = tracks.position.T
    vx, vy, vz = tracks.velocity.T
    xx, xy, yy = tracks.covariance.T
    needed = np.column_stack([tracks.t_s, x, y, vx, vy, xx, xy, yy])
    bad = ~np.isfinite(needed).all(axis=1) | np.isinf(z) | np.isinf(vz)
    if bad.any():
        row = int(bad.argmax())
        raise InputError(
            f"{path}: found a number that is not finite in the row of track {tracks.track[row]} "
            f"at {tracks.t_s[row]} s, expected finite numbers but for z_m and vz_m_s"
        )
    return {name: column for name, column in tracks.columns().items() if name != "nis"}


def empty_tracks() -> Tracks:
    """Tracks without a row."""
    none, places = np.empty(0), np.empty(0, np.int32)
    wide = np.empty((0, 3))
    return Tracks(none, places, wide, wide, wide, places, places, none, ())


def _put(file: BinaryIO, text: bytes, path: Path) -> None:
    with saying(path):
        file.write(text)


def _cells(tracks: Tracks, path: Path, dialect: Dialect) -> dict[str, Cells]:
    return {
        name: cells_of(column, dialect, decimals=_DECIMALS.get(name))
        for name, column in columns_of(tracks, path).items()
    }


def _points(geographic: Matrix) -> Cells:
    """Longitude, latitude and, where it is known, altitude."""
    lon, lat, alt = geographic.T
    comma = np.full((len(alt), 1), ord(","), np.uint8)
    parts = [
        fixed_cells(lon, _DEGREES),
        comma,
        fixed_cells(lat, _DEGREES),
        np.where(np.isnan(alt)[:, None], 0, comma).astype(np.uint8),
        fixed_cells(alt, 3),
    ]
    return np.concatenate(parts, axis=1)


def _feature_marks(columns: Sequence[str]) -> list[bytes]:
    first, *rest = json_marks(columns[1:])
    return [
        b'{"type":"Feature","geometry":{"type":"Point","coordinates":[',
        b']},"properties":' + first,
        *rest,
        b"}},\n",
    ]


_FEATURES = NDJSON._replace(marks=_feature_marks)
_NONE = empty_tracks()
