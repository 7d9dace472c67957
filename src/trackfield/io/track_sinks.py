"""Rows of tracks into an open file: as CSV, NDJSON, GeoJSON or Parquet."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from trackfield.errors import InputError
from trackfield.io.arrow import parquet_module
from trackfield.io.geodesy import to_geographic
from trackfield.io.output import saying
from trackfield.io.writing import Dialect, Texts, header_of, rows_of
from trackfield.network.site import Origin
from trackfield.types import Columns, Tracks, arrow_table

Sink = Callable[[Tracks], None]

# Micrometres and microseconds; covariances by digits, so that a small one stays one.
_FIXED = ("t_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
_VARIANCES = ("cov_xx", "cov_xy", "cov_yy")
_CODES = {**{name: "%.6f" for name in _FIXED}, **{name: "%.9g" for name in _VARIANCES}}
_POINT = "point"


@contextmanager
def text_sink(file: BinaryIO, path: Path, dialect: Dialect) -> Generator[Sink]:
    """Write rows of CSV or NDJSON."""

    def write(tracks: Tracks) -> None:
        _put(file, rows_of(columns_of(tracks, path), dialect, codes=_CODES), path)

    _put(file, header_of(columns_of(_NONE, path), dialect), path)
    yield write


@contextmanager
def geojson_sink(file: BinaryIO, path: Path, origin: Origin) -> Generator[Sink]:
    """Write a FeatureCollection of points, one a row, on lines of their own."""
    comma = ""

    def write(tracks: Tracks) -> None:
        nonlocal comma
        columns = {_POINT: Texts(_points(tracks, origin)), **columns_of(tracks, path)}
        rows = rows_of(columns, _FEATURES, codes=_CODES)
        _put(file, comma + rows.removesuffix(",\n"), path)
        comma = ",\n" if rows else comma

    _put(file, '{"type":"FeatureCollection","features":[\n', path)
    yield write
    _put(file, "\n]}\n", path)


@contextmanager
def parquet_sink(file: BinaryIO, path: Path) -> Generator[Sink]:
    """Write row groups of Parquet."""
    schema = arrow_table(columns_of(_NONE, path)).schema
    with saying(path), parquet_module(path).ParquetWriter(file, schema) as writer:

        def write(tracks: Tracks) -> None:
            with saying(path):
                writer.write_table(arrow_table(columns_of(tracks, path)))

        yield write


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


def _put(file: BinaryIO, text: str, path: Path) -> None:
    with saying(path):
        file.write(text.encode())


def _points(tracks: Tracks, origin: Origin) -> list[str]:
    """Longitude, latitude (.1 mm) and, where it is known, altitude."""
    rows = to_geographic(tracks.position, origin).tolist()
    return [
        f"{lon:.9f},{lat:.9f}" if math.isnan(alt) else f"{lon:.9f},{lat:.9f},{alt:.4f}"
        for lon, lat, alt in rows
    ]


def _feature(columns: Sequence[str], codes: Sequence[str]) -> str:
    cells = dict(zip(columns, codes, strict=True))
    point = f'{{"type":"Point","coordinates":[{cells.pop(_POINT)}]}}'
    properties = ",".join(f'"{column}":{code}' for column, code in cells.items())
    return f'{{"type":"Feature","geometry":{point},"properties":{{{properties}}}}},\n'


_FEATURES = Dialect(blank="null", name=json.dumps, row=_feature)
_NONE = empty_tracks()
