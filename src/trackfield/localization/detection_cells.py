"""Positions from binary detections by cells, as in the paper: Oh (13), Algorithms 1 and 2.

One target is assumed to explain what the sensors around it said. `peeling` knows better; this is
the paper's rule, and the map of likelihoods that both use.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.raster import Region, cell_centres
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionColumns, DetectionModels
from trackfield.types import Matrix, Vector

Flags = NDArray[np.bool_]
_MOST_CELLS = 1_000_000
_BLOCK = 4_000_000  # cells times sensors that are looked at in one go
_LEAST_RATE, _MOST_RATE = 1e-12, 1.0 - 1e-12


class CellLikelihood(NamedTuple):
    """Log-likelihood (...) of all detections for a target in a cell, and its two parts, Oh IV.A.

    `detection` comes from sensors whose region holds the cell, `false_detection` from all others.
    """

    total: Vector
    detection: Vector
    false_detection: Vector


@dataclass(frozen=True, slots=True, eq=False)
class DetectionCells:
    """A region cut into m cells, and which sensors cover each; made by `detection_cells`.

    `centres` (m, 2) [m], row by row as `shape` (rows, columns) says. Each pair of a cell and a
    sensor that covers it is an entry: `cell`, `sensor`, `coverage` (e,). `models` has n columns;
    `reach_m` is the largest of the sensors' reaches.
    """

    region: Region
    cell_m: float
    centres: Matrix
    shape: tuple[int, int]
    cell: NDArray[np.intp]
    sensor: NDArray[np.intp]
    coverage: Vector
    models: DetectionColumns
    reach_m: float


def cell_likelihood(detected: Flags, inside: Flags, *, p: Vector, q: Vector) -> CellLikelihood:
    """Log P(z | x in cell) = sum_in ln p^z (1-p)^(1-z) + sum_out ln q^z (1-q)^(1-z), Oh (13).

    `detected`, `p`, `q` (n,); `inside` (..., n) says whose region holds each cell.
    """
    hit, alarm = _log_rate(p, detected), _log_rate(q, detected)
    by_target = np.where(inside, hit, 0.0).sum(axis=-1)
    by_chance = np.where(inside, 0.0, alarm).sum(axis=-1)
    return CellLikelihood(by_target + by_chance, by_target, by_chance)


def detection_cells(
    models: DetectionModels, sensors: Matrix, *, region: Region, cell_m: float = 1.0
) -> DetectionCells:
    """Cut `region` into cells about `cell_m` wide and find what `sensors` (n, 2) cover.

    Done once for a site. `InputError` for a region without area, or over a million cells.
    """
    if not np.isfinite(sensors).all():
        raise InputError("sensors: found a position that is not a number, expected all finite")
    x_min, y_min, x_max, y_max = region
    if not (x_max > x_min and y_max > y_min and np.isfinite(region.area)):
        raise InputError(f"region: found {tuple(region)}, expected x_min < x_max, y_min < y_max")
    if not (cell_m > 0.0 and region.area / cell_m**2 <= _MOST_CELLS):
        raise InputError(
            f"cell_m: found {cell_m:g} m for {region.area:g} m^2, expected more than 0 and at most "
            f"{_MOST_CELLS} cells"
        )
    m = detection.as_columns(models)
    centres, shape = cell_centres(region, cell_m)
    n = len(sensors)
    step = max(1, _BLOCK // max(n, 1))
    parts: list[tuple[NDArray[np.intp], NDArray[np.intp], Vector]] = []
    for begin in range(0, len(centres), step):
        c = detection.coverage(m, sensors, positions=centres[begin : begin + step])
        cell, sensor = np.nonzero(c)
        parts.append((cell + begin, sensor, c[cell, sensor]))
    cell, sensor, covered = (np.concatenate(column) for column in zip(*parts, strict=True))
    return DetectionCells(
        region=region,
        cell_m=cell_m,
        centres=centres,
        shape=shape,
        cell=cell,
        sensor=sensor,
        coverage=covered,
        models=_of_each(m, n),
        reach_m=float(detection.reach(m).max(initial=0.0)),
    )


def likelihood_map(cells: DetectionCells, detected: Flags) -> CellLikelihood:
    """Evaluate Oh (13) in every cell, (m,): the likelihood of all detections (n,), Fig. 7."""
    check_scan(cells, detected)
    m, held = cells.models, cells.coverage >= 0.5
    cell, sensor = cells.cell[held], cells.sensor[held]
    hit, alarm = _log_rate(m.p_detection, detected), _log_rate(m.p_false, detected)
    size = len(cells.centres)
    by_target = np.bincount(cell, weights=hit[sensor], minlength=size).astype(float)
    by_chance = alarm.sum() - np.bincount(cell, weights=alarm[sensor], minlength=size)
    return CellLikelihood(by_target + by_chance, by_target, by_chance)


def detection_likelihoods(cells: DetectionCells, detected: Flags, *, least: int = 3) -> Vector:
    """Detection-likelihood (m,) of cells that `least` (theta_d) detections see, 0 elsewhere.

    Oh, Algorithm 1, Fig. 8. Every sensor speaks for its own cells, as in the listing, so that how
    cells are shared out among the sensors does not change the numbers.
    """
    found = likelihood_map(cells, detected).detection
    held = (cells.coverage >= 0.5) & detected[cells.sensor]
    seen = np.bincount(cells.cell[held], minlength=len(cells.centres))
    return np.where(seen >= least, np.exp(found), 0.0)


def cluster_reports(
    cells: DetectionCells, likelihoods: Vector, rng: np.random.Generator, *, radius_m: float
) -> Matrix:
    """Position reports (k, 2) [m]: centres of mass of clusters of cells, Oh, Algorithm 2.

    Of the cells with a likelihood above 0 one is drawn; those whose set distance to it is below the
    sensing radius are its cluster, and are taken away; and so on. A cell weighs its likelihood.
    """
    left = np.flatnonzero(likelihoods > 0.0)
    reports: list[Vector] = []
    while left.size:
        apart = np.abs(cells.centres[left] - cells.centres[rng.choice(left)])
        between = np.maximum(apart - cells.cell_m, 0.0)  # of squares, not of their centres
        near = np.hypot(between[:, 0], between[:, 1]) < radius_m
        mass = likelihoods[left[near]]
        reports.append(mass @ cells.centres[left[near]] / mass.sum())
        left = left[~near]
    return np.array(reports).reshape(-1, 2)


def check_scan(cells: DetectionCells, detected: Flags) -> None:
    """Raise `InputError` unless `detected` says true or false of every sensor."""
    if detected.shape != cells.models.radius_m.shape or detected.dtype != np.bool_:
        raise InputError(
            f"detected: found {detected.dtype} of shape {detected.shape}, expected true or false "
            f"of each of {cells.models.radius_m.size} sensors"
        )


def _log_rate(rate: Vector, detected: Flags) -> Vector:
    return detection.log_likelihood(np.clip(rate, _LEAST_RATE, _MOST_RATE), detected)


def _of_each(models: DetectionColumns, n: int) -> DetectionColumns:
    """Columns of n entries each."""
    return models if models.radius_m.size == n else detection.repeat(models, n)
