"""How well the readings of a field locate a target, place by place: maps of the bound.

In each cell the sensors in reach take one reading each; the Cramer-Rao bound of the position is
what no unbiased estimate beats. The map is made block by block, each with the sensors near it: time
grows with the pairs of cell and sensor in reach, and memory does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import covariance_of
from trackfield.localization.information import pair_gains, placed, position_bound
from trackfield.localization.mixed_models import MixedModels, heard_at, reach, taken
from trackfield.network.site import Site
from trackfield.raster import Raster, Region, cell_centres
from trackfield.types import Indices, Matrix, Vector

Choose = Callable[[Matrix], Indices]
"""Which of the readings with gains (n, D) are taken: their rows; called where any are in reach."""

_PAIRS = 1 << 16  # of a cell and a sensor, at most, that are looked at together
_CELLS = 1 << 22  # of a map, at most


class AccuracyMap(NamedTuple):
    """What the readings tell of a target in each cell, one raster each.

    `trace_m2` of the bound's covariance, its root `rms_m`; of its part in the plane the standard
    deviations `major_m` and `minor_m` along the axes of the ellipse, and the direction `angle_rad`
    of the longer one, 0 to pi from the x axis. `dilution` is the root of the trace where every
    reading has the error 1 along its gain: geometry alone (HDOP for equal ranges). `covered`
    counts sensors in reach. `determined` is 1 where a position follows, else 0: there the other
    values are huge, as nothing is known of a direction.
    """

    trace_m2: Raster
    rms_m: Raster
    major_m: Raster
    minor_m: Raster
    angle_rad: Raster
    dilution: Raster
    covered: Raster
    determined: Raster


class AccuracySummary(NamedTuple):
    """A map in a few numbers: of its cells in which a position follows, and of those it does not.

    `undetermined` is their share of the region; `rms_m` holds median, 95 % quantile and worst of
    the others, None if there are none; `covered` holds least, mean and most sensors in reach.
    """

    undetermined: float
    rms_m: tuple[float, float, float] | None
    covered: tuple[int, float, int]


def accuracy_map(
    site: Site,
    region: Region,
    *,
    cell_m: float,
    height_m: float | None = None,
    velocity_m_s: Vector | None = None,
    choose: Choose | None = None,
) -> AccuracyMap:
    """Map the bound of positions over a region, in cells about `cell_m` wide.

    Every sensor in reach reads once, or those that `choose` takes of them: `lambda gains:
    select(gains, 3).sensors` maps what the best three reach. Targets are at `height_m`, or at the
    height that the site knows; a site in space needs one, and locates in three axes. With a
    `velocity_m_s` (d,) states have an unknown velocity of that value, of which angular rates tell.
    """
    field = _field(site, region, cell_m=cell_m, height_m=height_m, velocity_m_s=velocity_m_s)
    values = np.empty((len(AccuracyMap._fields), field.y.size, field.x.size))
    for rows, columns, sensors in _blocks(field):
        found = _of_block(field, rows, columns, sensors=sensors, choose=choose)
        values[:, rows, columns] = found.reshape(len(found), rows.stop - rows.start, -1)
    return AccuracyMap(*(Raster(region, value) for value in values))


def by_name(found: AccuracyMap) -> Mapping[str, Raster]:
    """Name the maps as they are told: NaN, which is no value, where no position follows."""
    free = found.determined.values == 0.0
    always = {"covered": found.covered, "determined": found.determined}
    return {
        name: Raster(raster.region, np.where(free, np.nan, raster.values))
        for name, raster in found._asdict().items()
        if name not in always
    } | always


def summary(found: AccuracyMap) -> AccuracySummary:
    """Put a map into a few numbers."""
    there = found.determined.values > 0.0
    rms, covered = found.rms_m.values[there], found.covered.values
    low, high = int(covered.min()), int(covered.max())
    return AccuracySummary(
        undetermined=1.0 - float(there.mean()),
        rms_m=None
        if not rms.size
        else (float(np.median(rms)), float(np.quantile(rms, 0.95)), float(rms.max())),
        covered=(low, float(covered.mean()), high),
    )


class _Field(NamedTuple):
    """Sensors, and a grid of states: `x` (columns,), `y` (rows,) and the same `rest` everywhere."""

    models: MixedModels
    sensors: Matrix
    reach_m: Vector  # in the plane
    height_m: float | None  # of targets in the plane
    dimensions: int
    x: Vector
    y: Vector
    rest: Vector


def _field(
    site: Site,
    region: Region,
    *,
    cell_m: float,
    height_m: float | None,
    velocity_m_s: Vector | None,
) -> _Field:
    d = site.target.dimensions
    if d == 3 and height_m is None:
        raise InputError("found no height_m, expected that of the targets: the site is in space")
    wide, high = region.x_max - region.x_min, region.y_max - region.y_min
    if not (math.isfinite(wide) and math.isfinite(high) and wide > 0.0 and high > 0.0):
        raise InputError(f"found the region {tuple(region)}, expected finite sides above 0")
    if not cell_m > 0.0 or (wide / cell_m + 1.0) * (high / cell_m + 1.0) > _CELLS:
        raise InputError(
            f"cell_m: found {cell_m}, expected more than 0 and at most {_CELLS} cells in the region"
        )
    velocity = np.empty(0) if velocity_m_s is None else np.asarray(velocity_m_s, float)
    if velocity.shape not in {(0,), (d,)}:
        raise InputError(f"velocity_m_s of shape {velocity.shape}: expected ({d},)")
    models, sensors, level = placed(site, None, height_m if d == 2 else None)
    centres, (_, columns) = cell_centres(region, cell_m)
    z = np.array([height_m]) if d == 3 else np.empty(0)
    return _Field(
        models=models,
        sensors=sensors,
        reach_m=reach(models),
        height_m=level,
        dimensions=d,
        x=centres[:columns, 0],
        y=centres[::columns, 1],
        rest=np.concatenate([z, velocity]),
    )


def _blocks(field: _Field) -> Iterator[tuple[slice, slice, Indices]]:
    """Cut the grid into blocks, each with the sensors whose reach may touch it."""
    every = np.arange(len(field.sensors), dtype=np.int32)
    stack = [(slice(0, field.y.size), slice(0, field.x.size), every)]
    while stack:
        rows, columns, among = stack.pop()
        near = among[_touches(field, rows, columns, among=among)]
        high, wide = rows.stop - rows.start, columns.stop - columns.start
        if high * wide == 1 or high * wide * max(near.size, 1) <= _PAIRS:
            yield rows, columns, near
        elif high >= wide:
            middle = rows.start + high // 2
            stack += [(slice(rows.start, middle), columns, near)]
            stack += [(slice(middle, rows.stop), columns, near)]
        else:
            middle = columns.start + wide // 2
            stack += [(rows, slice(columns.start, middle), near)]
            stack += [(rows, slice(middle, columns.stop), near)]


def _touches(field: _Field, rows: slice, columns: slice, *, among: Indices) -> NDArray[np.bool_]:
    x, y = field.sensors[among, 0], field.sensors[among, 1]
    to_x = x - np.clip(x, field.x[columns.start], field.x[columns.stop - 1])
    to_y = y - np.clip(y, field.y[rows.start], field.y[rows.stop - 1])
    return np.hypot(to_x, to_y) <= field.reach_m[among]


def _of_block(
    field: _Field, rows: slice, columns: slice, *, sensors: Indices, choose: Choose | None
) -> Matrix:
    """Values (8, cells) of a block, in the order of `AccuracyMap`."""
    grid_x, grid_y = np.meshgrid(field.x[columns], field.y[rows])
    places = np.column_stack([grid_x.ravel(), grid_y.ravel()])
    states = np.column_stack([places, np.tile(field.rest, (len(places), 1))])
    spots = states[:, : field.dimensions]
    if field.height_m is not None:
        spots = np.column_stack([places, np.full(len(places), field.height_m)])
    own, stand = taken(field.models, sensors), field.sensors[sensors]
    heard = heard_at(own, spots[:, None] - stand)
    cell, which = (index.astype(np.int32) for index in np.nonzero(heard))
    gains = pair_gains(taken(own, which), stand[which], states[cell], height_m=field.height_m)
    if choose is not None and cell.size:
        kept = _chosen(gains, cell, choose)
        gains, cell = gains[kept], cell[kept]
    pure = _information(_unit(gains, field.dimensions), cell, len(places))
    bound = position_bound(_information(gains, cell, len(places)), field.dimensions)
    geometry, _ = covariance_of(pure)
    traces = [np.trace(matrix, axis1=-2, axis2=-1) for matrix in (bound.covariance, geometry)]
    return np.array(
        [
            traces[0],
            np.sqrt(traces[0]),
            *_ellipse(bound.covariance),
            np.sqrt(traces[1]),
            heard.sum(axis=1).astype(float),
            bound.determined.astype(float),
        ]
    )


def _chosen(gains: Matrix, cell: Indices, choose: Choose) -> Indices:
    """Rows that are chosen, cell by cell; `cell` (m,) ascends."""
    starts = np.flatnonzero(np.diff(cell, prepend=np.int32(-1)))
    ends = np.append(starts[1:], cell.size)
    parts = [a + np.asarray(choose(gains[a:b])) for a, b in zip(starts, ends, strict=True)]
    return np.concatenate(parts).astype(np.int32)


def _unit(gains: Matrix, dimensions: int) -> Matrix:
    """Directions (m, d) of gains in the position; zero where a reading says nothing of it."""
    place = gains[:, :dimensions]
    size = np.linalg.norm(place, axis=1, keepdims=True)
    return place / np.where(size > 0.0, size, 1.0)


def _information(gains: Matrix, cell: Indices, cells: int) -> Matrix:
    """Information (cells, D, D) of the readings of each cell."""
    width = gains.shape[1]
    out = np.empty((cells, width, width))
    for a in range(width):
        for b in range(a + 1):
            out[:, a, b] = out[:, b, a] = np.bincount(cell, gains[:, a] * gains[:, b], cells)
    return out


def _ellipse(covariance: Matrix) -> tuple[Vector, Vector, Vector]:
    """Find standard deviations (...) along the axes in the plane, and where the longer points."""
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    middle, spread = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) % np.pi
    return np.sqrt(middle + spread), np.sqrt(np.maximum(middle - spread, 0.0)), angle
