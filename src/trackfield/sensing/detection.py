"""Binary detections: a sensor says 1 where something moves in its region, Oh III.A."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError, InputError
from trackfield.sensing.detection_regions import (
    depth_in_disc,
    depth_in_polygon,
    depth_in_sector,
    polygon_fault,
)
from trackfield.types import Indices, Matrix, Vector

Flags = NDArray[np.bool_]
_LEAST_PROBABILITY = 1e-12  # a certain model is not believed to more than this


@dataclass(frozen=True, slots=True)
class DetectionModel:
    """P(z = 1) is `p_detection` with a target inside the sensing region, `p_false` without.

    Several targets inside are seen independently: 1 - (1 - p_detection)^n. The region is a disc of
    `radius_m`, a sector of it (`width_deg` about `heading_deg`, counter-clockwise from east), or a
    `polygon` of corners (x, y) [m] relative to the sensor. Across the border the probability falls
    over about `edge_m`.
    """

    radius_m: float = 7.62
    p_detection: float = 0.7
    p_false: float = 0.05
    edge_m: float = 0.0
    heading_deg: float = 0.0
    width_deg: float = 360.0
    polygon: tuple[tuple[float, float], ...] = ()


class DetectionColumns(NamedTuple):
    """What each sensor's `DetectionModel` says, as columns (n,) over the sensors.

    Angles in radians. `outline` numbers the sensor's polygon in `outlines`, -1 for a disc or a
    sector. Made by `columns`, which checks the models.
    """

    radius_m: Vector
    p_detection: Vector
    p_false: Vector
    edge_m: Vector
    heading: Vector
    width: Vector
    outline: Indices
    outlines: tuple[Matrix, ...]


DetectionModels = DetectionModel | DetectionColumns
"""One model for all sensors, or a column of models; every function of detections takes either."""


class SimulatedDetections(NamedTuple):
    """What n sensors said in each step, (..., steps, n): `detected` was sent, `received` arrived.

    A message that was lost and a sensor that said nothing look alike to the receiver.
    """

    detected: Flags
    received: Flags


def problems(model: DetectionModel) -> list[str]:
    """Say every fault of a model as "key: found ..., expected ...", none if it can be used."""
    found: list[str] = []
    p, q = model.p_detection, model.p_false
    for name, value, lower, upper in (
        ("p_detection", p, 0.0, 1.0),
        ("p_false", q, 0.0, 1.0),
        ("edge_m", model.edge_m, 0.0, math.inf),
        ("heading_deg", model.heading_deg, -math.inf, math.inf),
    ):
        if not (math.isfinite(value) and lower <= value <= upper):
            wanted = "a finite number" if lower < 0.0 else f"{lower:g} to {upper:g}"
            found.append(f"{name}: found {value:g}, expected {wanted}")
    if p <= q:
        found.append(f"p_detection: found {p:g}, expected more than p_false = {q:g}")
    if not (math.isfinite(model.radius_m) and model.radius_m > 0.0):
        found.append(f"radius_m: found {model.radius_m:g}, expected more than 0")
    if not 0.0 < model.width_deg <= 360.0:
        found.append(f"width_deg: found {model.width_deg:g}, expected more than 0, at most 360")
    if model.polygon:
        if model.width_deg < 360.0:
            found.append("polygon: found one beside width_deg, expected one region, not two")
        fault = polygon_fault(np.array(model.polygon, float))
        if fault is not None:
            found.append(f"polygon: {fault}")
    return found


def columns(models: Sequence[DetectionModel]) -> DetectionColumns:
    """Columns (n,) of the models of n sensors; `ConfigurationError` names all faulty ones."""
    first: dict[DetectionModel, int] = {}
    for i, model in enumerate(models):
        first.setdefault(model, i)
    faults = [
        f"detection model of sensor {i}, {fault}"
        for model, i in first.items()
        for fault in problems(model)
    ]
    if faults:
        raise ConfigurationError(faults)
    polygons = dict.fromkeys(model.polygon for model in first if model.polygon)
    numbers = {polygon: i for i, polygon in enumerate(polygons)}

    def column(name: str) -> Vector:
        return np.array([getattr(model, name) for model in models], float)

    return DetectionColumns(
        radius_m=column("radius_m"),
        p_detection=column("p_detection"),
        p_false=column("p_false"),
        edge_m=column("edge_m"),
        heading=np.deg2rad(column("heading_deg")),
        width=np.deg2rad(column("width_deg")),
        outline=np.array([numbers.get(model.polygon, -1) for model in models], np.int32),
        outlines=tuple(np.array(polygon, float) for polygon in numbers),
    )


def as_columns(models: DetectionModels) -> DetectionColumns:
    """Columns of models, of size 1 for a single model."""
    return columns([models]) if isinstance(models, DetectionModel) else models


def repeat(models: DetectionColumns, n: int) -> DetectionColumns:
    """Columns of `n` sensors alike, from columns of one."""
    return DetectionColumns(
        radius_m=np.repeat(models.radius_m, n),
        p_detection=np.repeat(models.p_detection, n),
        p_false=np.repeat(models.p_false, n),
        edge_m=np.repeat(models.edge_m, n),
        heading=np.repeat(models.heading, n),
        width=np.repeat(models.width, n),
        outline=np.repeat(models.outline, n),
        outlines=models.outlines,
    )


def depth(models: DetectionModels, sensors: Matrix, *, positions: Matrix) -> Matrix:
    """Distance (..., n) [m] of `positions` (..., 2) to the border of each region, positive inside.

    `sensors` (n, 2) [m]. `InputError` where shapes do not fit.
    """
    m = as_columns(models)
    return depth_at(m, _offsets(m, sensors, positions))


def depth_at(models: DetectionColumns, offsets: Matrix) -> Matrix:
    """`depth` (..., n) [m] of targets that stand `offsets` (..., n, 2) [m] from the sensors."""
    found = np.array(depth_in_disc(offsets, models.radius_m))
    wedges = models.width < 2.0 * np.pi - 1e-12
    size = offsets.shape[-2]
    if wedges.any():
        some = np.flatnonzero(np.broadcast_to(wedges, size))
        radius, heading, width = (
            np.broadcast_to(one, size)[some]
            for one in (models.radius_m, models.heading, models.width)
        )
        found[..., some] = depth_in_sector(
            offsets[..., some, :], radius, heading=heading, width=width
        )
    outline = np.broadcast_to(models.outline, size)
    for number, corners in enumerate(models.outlines):
        some = np.flatnonzero(outline == number)
        found[..., some] = depth_in_polygon(offsets[..., some, :], corners)
    return found


def inside(models: DetectionModels, sensors: Matrix, *, positions: Matrix) -> Flags:
    """Tell which regions (..., n) hold each position (..., 2) [m]; the border is inside."""
    return np.asarray(depth(models, sensors, positions=positions) >= 0.0)


def coverage(models: DetectionModels, sensors: Matrix, *, positions: Matrix) -> Matrix:
    """Coverage c = clip(1/2 + depth / edge_m, 0, 1) (..., n) of positions (..., 2) [m].

    The probability that the sensor takes the place for inside: 1 well within the region, 0 well
    outside, linear over `edge_m` across its border; a step where `edge_m` is 0. A position of NaN
    is a target that is not there and covers nothing.
    """
    m = as_columns(models)
    s = depth(m, sensors, positions=positions)
    hard = m.edge_m == 0.0
    soft = np.clip(0.5 + s / np.where(hard, 1.0, m.edge_m), 0.0, 1.0)
    return np.nan_to_num(np.where(hard, s >= 0.0, soft))


def probability(
    models: DetectionModels, coverage: Matrix, *, delivery: float | Vector = 1.0
) -> Matrix:
    """P(z = 1) = delivery (1 - prod_k (1 - p c_k) + q prod_k (1 - c_k)), (..., n).

    `coverage` (..., k, n) holds c of k targets, k = 0 allowed. With n targets well inside this is
    1 - (1 - p)^n, with none q; at an edge it is the mean over who is taken for inside. `delivery`
    is the probability that a detection reaches the receiver.
    """
    m = as_columns(models)
    seen = 1.0 - np.prod(1.0 - m.p_detection * coverage, axis=-2)
    return delivery * (seen + m.p_false * np.prod(1.0 - coverage, axis=-2))


def log_likelihood(probability: Matrix, detected: Flags) -> Matrix:
    """Log P(z) (..., n) of detections `detected` (..., n) under P(z = 1); silence counts too."""
    p = np.clip(probability, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
    return np.where(detected, np.log(p), np.log1p(-p))


def reach(models: DetectionModels) -> Vector:
    """Largest distance (n,) [m] at which a target is covered at all."""
    m = as_columns(models)
    far = np.array([np.linalg.norm(corners, axis=1).max() for corners in (*m.outlines, [[0, 0]])])
    return np.where(m.outline < 0, m.radius_m, far[m.outline]) + 0.5 * m.edge_m


def simulate(
    models: DetectionModels,
    sensors: Matrix,
    *,
    paths: Matrix,
    rng: np.random.Generator,
    delivery: float | Vector = 1.0,
    alive: Flags | None = None,
) -> SimulatedDetections:
    """Draw what `sensors` (n, 2) say of k targets on `paths` (..., steps, k, 2) [m].

    A target is not there while its position is NaN. A sensor that is not `alive` (n,) says nothing;
    `delivery` (n,) is the probability that a detection arrives.
    """
    covered = coverage(models, sensors, positions=paths)
    wanted = probability(models, covered)
    detected = rng.random(wanted.shape) < wanted
    if alive is not None:
        detected &= alive
    return SimulatedDetections(detected, detected & (rng.random(wanted.shape) < delivery))


def _offsets(models: DetectionColumns, sensors: Matrix, positions: Matrix) -> Matrix:
    if sensors.ndim != 2 or sensors.shape[1] != 2 or positions.shape[-1:] != (2,):
        raise InputError(
            f"sensors of shape {sensors.shape} and positions of shape {positions.shape}: "
            "expected (n, 2) and (..., 2)"
        )
    if models.radius_m.size not in {1, len(sensors)}:
        raise InputError(
            f"found {models.radius_m.size} detection models for {len(sensors)} sensors, "
            "expected one for all or one each"
        )
    return positions[..., None, :] - sensors
