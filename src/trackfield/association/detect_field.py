"""A field of binary sensors as track-before-detect sees it: who covers which place, how surely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.raster import Region, cell_centres
from trackfield.sensing.detection import (
    DetectionColumns,
    DetectionModels,
    as_columns,
    coverage,
    reach,
    repeat,
)
from trackfield.types import Indices, Matrix, Vector

_CELLS_A_REACH = 15.0  # a cell is so much smaller than the shortest reach of a sensor
_MOST_CELLS = 4_000_000
_CHUNK = 2_000_000  # pairs of a place and a sensor looked at in one go


@dataclass(frozen=True, slots=True, eq=False)
class DetectField:
    """Sensors at `sensors` (n, 2) [m] and what is known of them and of the network.

    `models` is one for all or columns for each; `delivery` (n,) the probability that a message
    arrives; `region` where targets can be (default: the sensors' box and half a reach about it).
    Sensors that send nothing but detections are silent when they see nothing and when they or
    their message are lost; with `says_zero` they send a 0 when they see nothing. `step_s` is the
    time from scan to scan. Sensors of one `group` (n,) are cut off together when their
    leader falls silent.
    """

    sensors: Matrix
    models: DetectionModels
    delivery: float | Vector = 1.0
    region: Region | None = None
    step_s: float = 1.0
    says_zero: bool = False
    group: int | Indices = 0


class Coverage(NamedTuple):
    """Sensors that see each cell of a raster: those of cell k are `start[k]` to `start[k + 1]`.

    `grid` is x_min, y_min, the cell's side [m], rows, columns; cells run east, then north.
    """

    grid: tuple[float, float, float, int, int]
    start: Indices  # (cells + 1,)
    sensor: Indices
    covered: Vector  # share of the cell, 0 to 1


def models_of(field: DetectField) -> DetectionColumns:
    """Models (n,) of the field's sensors; `ConfigurationError` where the field cannot be used."""
    n = len(field.sensors)
    faults: list[str] = []
    if field.sensors.ndim != 2 or field.sensors.shape[1:] != (2,) or n == 0:
        faults.append(f"sensors: found shape {field.sensors.shape}, expected (n, 2), n > 0")
    elif not np.isfinite(field.sensors).all():
        faults.append("sensors: found positions that are not finite, expected metres")
    delivery = np.asarray(field.delivery, float)
    if delivery.shape not in {(), (n,)} or not ((delivery >= 0.0) & (delivery <= 1.0)).all():
        faults.append(f"delivery: expected one or {n} probabilities from 0 to 1")
    group = np.asarray(field.group)
    if group.shape not in {(), (n,)} or group.dtype.kind not in "iu" or (group < 0).any():
        faults.append(f"group: expected one or {n} whole numbers from 0")
    elif group.max(initial=0) > n:
        faults.append(f"group: found {group.max()}, expected at most {n}")
    if not 0.0 < field.step_s < np.inf:
        faults.append(f"step_s: found {field.step_s}, expected a time above 0")
    region = field.region
    if region is not None and not (region.x_min < region.x_max and region.y_min < region.y_max):
        faults.append(f"region: found {tuple(region)}, expected x_min < x_max and y_min < y_max")
    models = as_columns(field.models)
    if models.radius_m.size not in {1, n}:
        faults.append(f"models: found {models.radius_m.size}, expected 1 or {n}")
    if faults:
        raise ConfigurationError(faults)
    return repeat(models, n) if models.radius_m.size == 1 else models


def region_of(field: DetectField, models: DetectionColumns) -> Region:
    """Where targets can be: told, or the sensors' box and half of the longest reach about it."""
    if field.region is not None:
        return field.region
    margin = 0.5 * float(reach(models).max())
    low, high = field.sensors.min(axis=0) - margin, field.sensors.max(axis=0) + margin
    return Region(float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def coverage_of(field: DetectField, models: DetectionColumns) -> Coverage:
    """Coverage of every cell: the mean over four places in it, any shape of region.

    A cell is a fifteenth of the shortest reach, larger where there would be over four million.
    """
    region = region_of(field, models)
    cell = float(reach(models).min()) / _CELLS_A_REACH
    cell = max(cell, (region.area / _MOST_CELLS) ** 0.5)
    columns = int(np.ceil((region.x_max - region.x_min) / cell))
    rows = int(np.ceil((region.y_max - region.y_min) / cell))
    grown = Region(
        region.x_min, region.y_min, region.x_min + columns * cell, region.y_min + rows * cell
    )
    centres, _ = cell_centres(grown, cell)
    quarters = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]) * cell / 4.0
    cells: list[Indices] = []
    sensors: list[Indices] = []
    shares: list[Vector] = []
    chunk = max(1, _CHUNK // (4 * len(field.sensors)))
    for first in range(0, len(centres), chunk):
        places = centres[first : first + chunk, None, :] + quarters
        share = coverage(models, field.sensors, positions=places).mean(axis=1)
        row, column = np.nonzero(share > 0.0)
        cells.append((first + row).astype(np.int32))
        sensors.append(column.astype(np.int32))
        shares.append(share[row, column])
    start = np.zeros(rows * columns + 1, np.int32)
    start[1:] = np.cumsum(np.bincount(np.concatenate(cells), minlength=rows * columns))
    return Coverage(
        (region.x_min, region.y_min, cell, rows, columns),
        start,
        np.concatenate(sensors),
        np.concatenate(shares),
    )
