"""Detection models learned from a run with truth: p, q, radius, edge, broken nodes, clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.calibration.detection_fit import (
    Evidence,
    RateFit,
    evidence,
    fit_rates,
    sensor_rates,
    spoken,
)
from trackfield.calibration.detection_search import CLOCK_S, Found, Geometry, search
from trackfield.calibration.truth_paths import Paths, paths_at
from trackfield.errors import InputError
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionColumns, DetectionModel
from trackfield.types import Indices, Matrix, Vector

Health = Literal["alive", "dead", "babbling", "unsure"]
_SURE = 0.95  # from here a node is called alive, dead or babbling; no evidence is not enough
_STANDING_M_S = 0.1  # who is slower is not a moving object, Oh III.A
_LEAST_STEPS = 10
_MOST_PAIRS = 20_000_000  # steps times sensors times targets: bounds memory and time
_LEAST_COVERED = 30  # steps and sensors with a target inside, in all


@dataclass(frozen=True, slots=True, eq=False)
class DetectionRun:
    """A run of a binary field beside its truth, as plain columns.

    Detections `detected` (steps, n) of `sensors` (n, 2) [m] in the windows that end at `t_s`
    (steps,). Truth has a row (m,) a target and time: `truth_s`, `target` (any number), `position`
    (m, 2) [m]. `heard` (steps, n) tells whose message arrived, where sensors report silence too;
    None where only detections are sent.
    """

    t_s: Vector
    detected: NDArray[np.bool_]
    sensors: Matrix
    truth_s: Vector
    target: Indices
    position: Matrix
    heard: NDArray[np.bool_] | None = None


class SensorDetections(NamedTuple):
    """What a run told of one sensor: rates shrunk to those of all, with standard errors.

    `alive` is the probability that the node works; `covered` counts steps with a target inside.
    """

    health: Health
    alive: float
    covered: float
    detections: int
    p_detection: float
    p_error: float
    p_false: float
    q_error: float


@dataclass(frozen=True, slots=True, eq=False)
class DetectionCalibration:
    """Learned models, one a sensor, and how well they are known.

    `pooled` is the model of all sensors alike (its radius is the first one's), `errors` holds
    standard errors in its fields that were learned. `clock_offset_s` is what is added to the
    detections' times to meet the truth's clock; 0 where the run cannot tell it from 0.
    `heard_share` (n,) is the share of messages that arrived, 1 where silence is not sent. Of
    `given` steps `used` had truth beside them and nobody standing.
    """

    models: tuple[DetectionModel, ...]
    pooled: DetectionModel
    errors: DetectionErrors
    sensors: tuple[SensorDetections, ...]
    clock_offset_s: float
    clock_error_s: float
    heard_share: Vector
    log_likelihood: float
    given: int
    used: int


class DetectionErrors(NamedTuple):
    """Standard errors of the values that all sensors share."""

    radius_m: float
    p_detection: float
    p_false: float
    edge_m: float


def calibrate_detections(
    run: DetectionRun,
    models: DetectionModel | Sequence[DetectionModel] | None = None,
    *,
    delivery: float | Vector | None = None,
    clock: bool = True,
) -> DetectionCalibration:
    """Learn p, q, radius, edge, broken nodes and clock of a binary field by maximum likelihood.

    `models` (default: one disc) give the shapes; all radii are scaled by one factor of .4 to 2.5,
    polygons stay as they are. A detection that was lost looks like silence, so that loss can only
    be told from p where several targets share a sensor, which is too little to rely on: `delivery`
    (n,) says how probably a detection arrives, and p and q are then those at the sensor. Without,
    they are as the receiver sees them, delivery p and delivery q; where `heard` is given, silence
    is sent too, loss shows by itself, and p and q are those at the sensor again.
    `InputError` for a run that cannot be used: shapes, too few steps beside truth, nobody moving,
    nobody near a sensor.
    """
    shapes = _shapes(run, models)
    heard = np.ones(run.detected.shape, bool) if run.heard is None else run.heard
    arrives = _delivery(run, delivery)
    paths = _paths(run, 0.0)
    rows = _usable(run, paths)
    _check_near(run, shapes, paths, rows)
    known = rows & _paths(run, -CLOCK_S).known & _paths(run, CLOCK_S).known

    def beside(at: Geometry, kept: NDArray[np.bool_]) -> Evidence:
        moved = paths if at.offset_s == 0.0 else _paths(run, at.offset_s)
        kept = kept & moved.known
        c = detection.coverage(_scaled(shapes, at), run.sensors, positions=moved.position[kept])
        return evidence(c, run.detected[kept], heard=heard[kept], delivery=arrives)

    def profile(at: Geometry, start: RateFit | None, kept: NDArray[np.bool_] = rows) -> RateFit:
        return fit_rates(beside(at, kept), start)

    told = clock and known.sum() >= _LEAST_STEPS
    found = search(profile, clock=partial(profile, kept=known) if told else None)
    used = int((rows & _paths(run, found.geometry.offset_s).known).sum())
    return _result(run, shapes, found, evidence=beside(found.geometry, rows), used=used)


def _result(
    run: DetectionRun, shapes: DetectionColumns, found: Found, *, evidence: Evidence, used: int
) -> DetectionCalibration:
    fit = found.rates
    rates, errors = sensor_rates(evidence, fit)
    scaled = _scaled(shapes, found.geometry)
    n = len(run.sensors)
    common = np.diag(np.linalg.pinv(fit.information)) ** 0.5
    covered = np.bincount(
        evidence.sensor, weights=evidence.coverage.max(axis=1, initial=0.0), minlength=n
    )
    said, heard = spoken(evidence)
    models = tuple(_model(scaled, i, p=float(rates[i, 0]), q=float(rates[i, 1])) for i in range(n))
    size = float(np.broadcast_to(scaled.radius_m, n)[0])
    return DetectionCalibration(
        models=models,
        pooled=_model(scaled, 0, p=fit.p, q=fit.q),
        errors=DetectionErrors(
            radius_m=size * found.errors.size / found.geometry.size,
            p_detection=float(common[0] * fit.p * (1.0 - fit.p)),
            p_false=float(common[1] * fit.q * (1.0 - fit.q)),
            edge_m=size * found.errors.edge,
        ),
        sensors=tuple(
            SensorDetections(
                _health(fit, i),
                float(fit.alive[i]),
                float(covered[i]),
                int(said[i]),
                float(rates[i, 0]),
                float(errors[i, 0]),
                float(rates[i, 1]),
                float(errors[i, 1]),
            )
            for i in range(n)
        ),
        clock_offset_s=found.geometry.offset_s,
        clock_error_s=found.errors.offset_s,
        heard_share=heard / used,
        log_likelihood=fit.log_likelihood,
        given=run.t_s.size,
        used=used,
    )


def _model(columns: DetectionColumns, i: int, *, p: float, q: float) -> DetectionModel:
    """Make the model of sensor `i` of columns, with other rates."""
    i = min(i, columns.radius_m.size - 1)
    outline = int(columns.outline[i])
    corners = columns.outlines[outline] if outline >= 0 else np.empty((0, 2))
    return DetectionModel(
        radius_m=float(columns.radius_m[i]),
        p_detection=p,
        p_false=min(q, p * (1.0 - 1e-6)),
        edge_m=float(columns.edge_m[i]),
        heading_deg=float(np.rad2deg(columns.heading[i])),
        width_deg=float(np.rad2deg(columns.width[i])),
        polygon=tuple((float(x), float(y)) for x, y in corners),
    )


def _health(fit: RateFit, i: int) -> Health:
    if fit.alive[i] >= _SURE:
        return "alive"
    if fit.dead[i] >= _SURE:
        return "dead"
    return "babbling" if fit.babbling[i] >= _SURE else "unsure"


def _scaled(shapes: DetectionColumns, at: Geometry) -> DetectionColumns:
    radius = shapes.radius_m * at.size
    return shapes._replace(radius_m=radius, edge_m=radius * at.edge)


def _paths(run: DetectionRun, offset_s: float) -> Paths:
    return paths_at(run.truth_s, run.target, position=run.position, t_s=run.t_s + offset_s)


def _shapes(
    run: DetectionRun, models: DetectionModel | Sequence[DetectionModel] | None
) -> DetectionColumns:
    """Check the shapes of everything, and make columns of the models."""
    steps, n = run.t_s.size, len(run.sensors)
    for name, found, expected in (
        ("detected", run.detected.shape, (steps, n)),
        ("sensors", run.sensors.shape, (n, 2)),
        ("heard", (steps, n) if run.heard is None else run.heard.shape, (steps, n)),
        ("target", run.target.shape, run.truth_s.shape),
        ("position", run.position.shape, (run.truth_s.size, 2)),
    ):
        if found != expected:
            raise InputError(f"{name}: found shape {found}, expected {expected}")
    for name in ("t_s", "sensors", "truth_s", "position"):
        if not np.isfinite(getattr(run, name)).all():
            raise InputError(f"{name}: found a value that is not a number, expected all finite")
    if not run.truth_s.size:
        raise InputError("truth: found no rows, expected where the targets were")
    targets = np.unique(run.target).size
    if steps * n * targets > _MOST_PAIRS:
        raise InputError(
            f"found {steps} steps of {n} sensors and {targets} targets, expected at most "
            f"{_MOST_PAIRS} in all, steps times sensors times targets: cut the run"
        )
    given = [models or DetectionModel()] if isinstance(models, DetectionModel | None) else models
    columns = detection.columns(given)
    if columns.radius_m.size not in {1, n}:
        raise InputError(f"models: found {columns.radius_m.size}, expected one or {n}")
    return columns


def _delivery(run: DetectionRun, delivery: float | Vector | None) -> Vector:
    if delivery is None:
        return np.ones(len(run.sensors))
    arrives = np.broadcast_to(np.asarray(delivery, float), len(run.sensors))
    if not ((arrives > 0.0) & (arrives <= 1.0)).all():
        raise InputError(f"delivery: found {arrives.min():g} to {arrives.max():g}, expected 0 to 1")
    return arrives


def _usable(run: DetectionRun, paths: Paths) -> NDArray[np.bool_]:
    """Tell the steps that have truth beside them and nobody standing."""
    if paths.known.sum() < _LEAST_STEPS:
        raise InputError(
            f"found {int(paths.known.sum())} steps of detections with truth beside them, expected "
            f"at least {_LEAST_STEPS} (detections from {run.t_s.min():g} to {run.t_s.max():g} s, "
            f"truth from {run.truth_s.min():g} to {run.truth_s.max():g} s)"
        )
    rows = paths.known & ~(paths.speed < _STANDING_M_S).any(axis=1)
    if rows.sum() < _LEAST_STEPS:
        raise InputError(
            f"found {int(rows.sum())} steps in which the targets move faster than "
            f"{_STANDING_M_S:g} m/s, expected at least {_LEAST_STEPS}: a run in which nobody moves "
            "tells nothing of motion sensors"
        )
    return rows


def _check_near(
    run: DetectionRun, shapes: DetectionColumns, paths: Paths, rows: NDArray[np.bool_]
) -> None:
    near = detection.inside(shapes, run.sensors, positions=paths.position[rows]).sum()
    if near < _LEAST_COVERED:
        raise InputError(
            f"found {int(near)} times a target inside a sensor's region as it was told, expected "
            f"at least {_LEAST_COVERED}: walk through the field, or correct sensors and radius"
        )
    if not run.detected[rows].any():
        raise InputError("detected: found no detection beside truth, expected some")
