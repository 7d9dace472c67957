"""Maps that go out: a row a cell, as CSV, NDJSON or Parquet, or a polygon a cell, as GeoJSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.io.cells import Cells, fixed_cells
from trackfield.io.geodesy import to_geographic
from trackfield.io.output import replacing, saying
from trackfield.io.sources import suffix_of
from trackfield.io.writing import NDJSON, cells_of, json_marks, rows_of, write_table
from trackfield.network.site import Origin
from trackfield.raster import Raster, Region
from trackfield.types import Matrix, Vector

_CHUNK_ROWS = 1 << 12
_PLACE_DIGITS = 6  # decimals of centres: micrometres
_DEGREES = 9  # decimals: a tenth of a millimetre
_DIGITS = 6  # that a value has
_WHOLE = 1e15  # larger numbers are no counts
_POLYGON = "polygon"
_COMMA, _OPEN, _CLOSE = (np.frombuffer(mark, np.uint8) for mark in (b",", b"[", b"]"))


def write_rasters(
    path: str | Path, rasters: Mapping[str, Raster], *, origin: Origin | None = None
) -> None:
    """Write maps of one region that have the same cells, by name; complete or not at all.

    The suffix says how: .csv, .ndjson, .parquet with the centre `x_m`, `y_m` of each cell, row by
    row from the south-west, and a column a map; .geojson with a polygon a cell on the Earth, which
    needs the `origin` of the site. Values have six significant digits; NaN is an empty cell.
    `InputError` for maps that differ in region or cells, for infinite values, and where the place
    cannot be written.
    """
    path = Path(path)
    suffix = suffix_of(path, geojson=True)
    region, shape = _common(rasters)
    columns = {name: _told(raster.values.ravel()) for name, raster in rasters.items()}
    if suffix != ".geojson":
        x, y = np.round(next(iter(rasters.values())).centres(), _PLACE_DIGITS).T
        write_table(path, {"x_m": x, "y_m": y, **columns})
        return
    if origin is None:
        raise InputError(
            f"{path}: found a site without origin, expected [site] origin = {{lat, lon}} to write "
            "GeoJSON"
        )
    _write_geojson(path, columns, _corners(region, shape, origin))


def _common(rasters: Mapping[str, Raster]) -> tuple[Region, tuple[int, int]]:
    kinds = {(raster.region, raster.values.shape) for raster in rasters.values()}
    if len(kinds) != 1:
        raise InputError(f"found maps of {len(kinds)} regions or grids, expected one of all")
    for name, raster in rasters.items():
        if np.isinf(raster.values).any():
            raise InputError(f"map {name!r}: found an infinite value, expected finite ones or NaN")
    region, (rows, columns) = kinds.pop()
    return region, (rows, columns)


def _told(values: Vector) -> NDArray[Any]:
    """Values of six digits; whole numbers as such where all are, as counts are."""
    if (np.abs(values) <= _WHOLE).all() and (values == np.rint(values)).all():
        return values.astype(np.int64)
    size = np.where(np.nan_to_num(values) == 0.0, 1.0, np.abs(values))
    places = _DIGITS - 1 - np.floor(np.log10(size))
    ten = 10.0 ** np.clip(places, -300.0, 300.0)
    return np.rint(values * ten) / ten


def _corners(region: Region, shape: tuple[int, int], origin: Origin) -> Matrix:
    """Longitude and latitude (cells, 5, 2) round each cell, counter-clockwise and closed."""
    rows, columns = shape
    x = np.linspace(region.x_min, region.x_max, columns + 1)
    y = np.linspace(region.y_min, region.y_max, rows + 1)
    grid_x, grid_y = np.meshgrid(x, y)
    flat = np.column_stack([grid_x.ravel(), grid_y.ravel(), np.zeros(grid_x.size)])
    lattice = to_geographic(flat, origin)[:, :2].reshape(rows + 1, columns + 1, 2)
    south, north = lattice[:-1], lattice[1:]
    ring = [south[:, :-1], south[:, 1:], north[:, 1:], north[:, :-1], south[:, :-1]]
    return np.stack(ring, axis=2).reshape(-1, 5, 2)


def _write_geojson(path: Path, columns: Mapping[str, NDArray[Any]], corners: Matrix) -> None:
    comma = b""
    with replacing(path) as file:
        with saying(path):
            file.write(b'{"type":"FeatureCollection","features":[\n')
        for start in range(0, len(corners), _CHUNK_ROWS):
            part = slice(start, start + _CHUNK_ROWS)
            cells = {name: cells_of(column[part], _FEATURES) for name, column in columns.items()}
            rows = rows_of({_POLYGON: _ring_cells(corners[part]), **cells}, _FEATURES)
            with saying(path):
                file.write(comma + rows.removesuffix(b",\n"))
            comma = b",\n"
        with saying(path):
            file.write(b"\n]}\n")


def _ring_cells(corners: Matrix) -> Cells:
    """Coordinates of rings (n, 5, 2) as text, without the outer brackets."""
    n = len(corners)
    pieces: list[Cells] = []
    for k in range(corners.shape[1]):
        lon, lat = (fixed_cells(corners[:, k, axis], _DEGREES) for axis in range(2))
        between = [np.tile(_COMMA, (n, 1))] if k else []
        pieces += [*between, np.tile(_OPEN, (n, 1)), lon, np.tile(_COMMA, (n, 1)), lat]
        pieces.append(np.tile(_CLOSE, (n, 1)))
    return np.concatenate(pieces, axis=1)


def _feature_marks(columns: Sequence[str]) -> list[bytes]:
    first, *rest = json_marks(columns[1:])
    return [
        b'{"type":"Feature","geometry":{"type":"Polygon","coordinates":[[',
        b']]},"properties":' + first,
        *rest,
        b"}},\n",
    ]


_FEATURES = NDJSON._replace(marks=_feature_marks)
