"""Strengths that receivers hear of particles: the law of each, and its shadow from a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.network.geometry import FLAT, thinness
from trackfield.network.radio_map import RadioMap, radio_map
from trackfield.network.site import Site
from trackfield.raster import Region
from trackfield.sensing import rssi
from trackfield.sensing.rssi import RssiColumns
from trackfield.types import Indices, Matrix, Vector

_CELL_M = 0.5  # of the table of shadows, where that is not too many
_MOST_NUMBERS = 1_000_000  # in the table: 8 MB for mean and variance in single precision
_CHANGED = 0.75  # of the fading's variance: who carries the beacon now, doors, what was moved
_BESIDE = 0.1  # of its width and height the area reaches beyond receivers and survey ...
_BESIDE_LEAST_M = 1.0  # ... but this at least,
_BESIDE_LINE = 0.5  # and beyond receivers on a line so much of its length: to either side of it
_ALONE_M = 10.0  # beyond a receiver that is alone
_WIDTH = 0.5  # of the area's length it is wide at least


class ShadowTable(NamedTuple):
    """Shadows of n receivers at the corners of square cells, between which they are linear."""

    corner: tuple[float, float]  # [m] of the first row and column
    cell_m: float
    mean: NDArray[np.float32]  # (n, rows, columns) [dB]
    variance: NDArray[np.float32]  # (n, rows, columns) [dB^2], taken at the nearest corner

    def shadow(self, receivers: Indices, position: Matrix) -> Matrix:
        """Mean (m, N) [dB] of the shadow of `receivers` (m,) at positions (3, N)."""
        place, u, v = self._cells(receivers, position)
        flat, below = self.mean.ravel(), self.mean.shape[2]
        low: Matrix = (1.0 - u) * flat[place] + u * flat[place + 1]
        high: Matrix = (1.0 - u) * flat[place + below] + u * flat[place + below + 1]
        return low + v * (high - low)

    def unknown(self, receivers: Indices, position: Matrix) -> Matrix:
        """Variance (m, N) [dB^2] of the shadow of `receivers` (m,) at positions (3, N)."""
        place, u, v = self._cells(receivers, position)
        nearest = place + self.mean.shape[2] * (v > 0.5) + (u > 0.5)
        return self.variance.ravel()[nearest].astype(np.float64)

    def _cells(self, receivers: Indices, position: Matrix) -> tuple[Indices, Vector, Vector]:
        """Where the cell of each position is in the table (m, N), and where in it, 0 to 1 (N,)."""
        _, rows, columns = self.mean.shape
        x = np.clip((position[0] - self.corner[0]) / self.cell_m, 0.0, columns - 1.001)
        y = np.clip((position[1] - self.corner[1]) / self.cell_m, 0.0, rows - 1.001)
        column, row = x.astype(np.int32), y.astype(np.int32)
        place = receivers[:, None] * (rows * columns) + (row * columns + column)
        return place, x - column, y - row


@dataclass(frozen=True, slots=True, eq=False)
class RssiField:
    """What n receivers hear at any place: law plus the survey's shadow; made by `field`.

    Without a survey there is no table, and the variance of the shadow is everywhere the model's.
    """

    models: RssiColumns
    sensors: Matrix  # (n, 3), z NaN: the height of the target does not count
    area: Region  # where targets are taken to be
    usual: Vector  # (n,) variance of the shadow where nobody has surveyed [dB^2]
    changed: Vector  # (n,) variance of what a surveyed shadow has become since [dB^2]
    table: ShadowTable | None

    def strength(self, receivers: Indices, position: Matrix) -> Matrix:
        """Mean (m, N) [dBm] at `receivers` (m,) of a beacon at `position` (3, N) [m]."""
        at, models = self.sensors[receivers], self.models
        dx, dy = position[0] - at[:, :1], position[1] - at[:, 1:2]
        dz = position[2] - at[:, 2:]
        square = dx * dx + dy * dy + np.where(np.isnan(dz), 0.0, dz * dz)
        near = models.near_m[receivers, None]
        decades = np.log10(np.maximum(square, near * near))
        law = models.power_dbm[receivers, None] - 5.0 * models.exponent[receivers, None] * decades
        if self.table is None:
            return law
        return law + self.table.shadow(receivers, position)

    def unknown(self, receivers: Indices, position: Matrix) -> Matrix:
        """Variance (m, N) or (m, 1) [dB^2] of the shadow that the survey leaves at `position`."""
        if self.table is None:
            return self.usual[receivers, None]
        return self.table.unknown(receivers, position) + self.changed[receivers, None]


def field(site: Site) -> RssiField:
    """Make the field of `site`; `ConfigurationError` if a sensor measures something else."""
    chart = radio_map(site)
    area = _area(site)
    usual = np.square(chart.models.shadow_db)
    if site.survey is None or not len(site.survey):
        return RssiField(chart.models, site.positions, area, usual, np.zeros_like(usual), None)
    changed = _CHANGED * np.square(chart.models.fading_db)
    n = len(site.sensor_ids)
    x0, y0, x1, y1 = area
    cell = max(_CELL_M, math.sqrt((x1 - x0) * (y1 - y0) * n / _MOST_NUMBERS))
    xs = x0 + cell * np.arange(math.ceil((x1 - x0) / cell) + 2)
    ys = y0 + cell * np.arange(math.ceil((y1 - y0) / cell) + 2)
    mean = np.empty((n, ys.size, xs.size), np.float32)
    variance = np.empty_like(mean)
    for row, y in enumerate(ys):
        places = np.column_stack([xs, np.full(xs.size, y)])
        mean[:, row], variance[:, row] = _shadow(chart, places)
    return RssiField(
        chart.models,
        site.positions,
        area,
        usual,
        changed,
        ShadowTable((x0, y0), cell, mean, variance),
    )


def _shadow(chart: RadioMap, places: Matrix) -> tuple[Matrix, Matrix]:
    """Mean and variance (n, m) of the shadow at places (m, 2)."""
    strength = chart.expected(places)
    flat = np.column_stack([places, np.full(len(places), chart.height_m)])
    offsets = flat[:, None, :] - chart.sensors
    offsets[..., 2] = np.nan_to_num(offsets[..., 2])
    law = rssi.expected(chart.models, np.linalg.norm(offsets, axis=-1))
    return (strength.mean - law).T, strength.variance.T


def _area(site: Site) -> Region:
    """Where targets are taken to be: the region told, or about receivers, survey and rooms.

    Who tells of rooms tells where targets are: then there is no margin. Receivers in a row do not
    say that targets keep to it: the area is half as wide as it is long, or wider.
    """
    if site.reports.region is not None:
        return site.reports.region
    places = [site.positions[:, :2], *(np.array(room.polygon) for room in site.rooms)]
    if site.survey is not None:
        places.append(site.survey.position[:, :2])
    every = np.vstack(places)
    low, high = every.min(axis=0), every.max(axis=0)
    if site.rooms:
        return Region(float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    length = float((high - low).max())
    beside = _BESIDE_LINE if thinness(every) < FLAT else _BESIDE
    margin = max(_BESIDE_LEAST_M, beside * length) if length > 0.0 else _ALONE_M
    least = _WIDTH * (length + 2.0 * margin)
    half = np.maximum(0.5 * (high - low) + margin, 0.5 * least)
    x, y = 0.5 * (low + high)
    return Region(float(x - half[0]), float(y - half[1]), float(x + half[0]), float(y + half[1]))
