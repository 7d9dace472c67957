"""A site's binary sensors learned from a run: tables to steps, and the models into the site."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfield.calibration.detections import (
    DetectionCalibration,
    DetectionRun,
    calibrate_detections,
)
from trackfield.errors import InputError
from trackfield.network.channel import delivery_probability
from trackfield.network.site import Site
from trackfield.network.topology import lay_out
from trackfield.sensing.detection import DetectionModel
from trackfield.types import Readings, Truth, Vector

KIND = "detection"
_MOST_STEPS = 1_000_000


class CalibratedDetections(NamedTuple):
    """A site with learned models of its binary sensors, and what the run told.

    `calibration.sensors` are those of the site's sensors that `sensor_ids` names, in this order.
    """

    site: Site
    sensor_ids: tuple[str, ...]
    calibration: DetectionCalibration


def calibrate_detection_site(
    site: Site, readings: Readings, truth: Truth, *, clock: bool = True
) -> CalibratedDetections:
    """Learn the detection models of `site` from a run with truth, see `calibrate_detections`.

    How many detections arrive is what the site's network says; without a network, p and q are as
    seen. Values of 0 among the readings mean that sensors report silence too. Sensors of other
    kinds stay as they are. `InputError` where nothing can be learned.
    """
    places = _places(site)
    run = detection_run(site, readings, truth)
    models = [model for model in site.models if isinstance(model, DetectionModel)]
    delivery = None if run.heard is not None else _delivery(site)
    found = calibrate_detections(
        run, models, delivery=None if delivery is None else delivery[places], clock=clock
    )
    learned = list(site.models)
    for place, model in zip(places, found.models, strict=True):
        learned[place] = model
    return CalibratedDetections(
        replace(site, models=tuple(learned)), tuple(site.sensor_ids[i] for i in places), found
    )


def detection_run(site: Site, readings: Readings, truth: Truth) -> DetectionRun:
    """Sort the site's detections into steps of `site.reports.step_s` (1 s), beside the truth.

    Steps reach from the first reading to the last; where in its step a reading stands is the
    (circular) mean of all, and each belongs to the nearest step.
    """
    places = _places(site)
    step_s = site.reports.step_s or 1.0
    binary = np.array([kind == KIND for kind in readings.kinds], bool)
    rows = np.flatnonzero(binary[readings.kind]) if binary.size else np.empty(0, np.intp)
    if not rows.size:
        raise InputError("found no reading of kind 'detection'")
    column = {site.sensor_ids[place]: i for i, place in enumerate(places)}
    columns = np.array([column.get(name, -1) for name in readings.sensor_ids], int)
    sensor = columns[readings.sensor[rows]]
    if (sensor < 0).any():
        name = readings.sensor_ids[int(readings.sensor[rows][sensor < 0][0])]
        raise InputError(f"found a detection of {name!r}, which is no binary sensor of the site")
    t = readings.t_s[rows]
    turn = 2.0 * np.pi / step_s
    phase = float(np.arctan2(np.sin(turn * t).sum(), np.cos(turn * t).sum())) / turn
    slot = np.rint((t - phase) / step_s).astype(np.int64)
    first = int(slot.min())
    slot -= first
    steps = int(slot.max()) + 1
    if steps > _MOST_STEPS:
        raise InputError(f"found {steps} steps of {step_s:g} s, expected at most {_MOST_STEPS}")
    said = readings.value[rows] > 0.5
    heard = np.zeros((steps, len(places)), bool)
    detected = np.zeros_like(heard)
    heard[slot, sensor] = True
    detected[slot[said], sensor[said]] = True
    return DetectionRun(
        t_s=phase + step_s * np.arange(first, first + steps, dtype=float),
        detected=detected,
        sensors=site.positions[places, :2],
        truth_s=truth.t_s,
        target=truth.target,
        position=truth.position[:, :2],
        heard=None if said.all() else heard,
    )


def _places(site: Site) -> list[int]:
    places = [i for i, model in enumerate(site.models) if isinstance(model, DetectionModel)]
    if not places:
        raise InputError(f"site {site.name}: found no sensor of kind 'detection'")
    return places


def _delivery(site: Site) -> Vector | None:
    """Probability (n,) that a detection arrives; a node that nobody hears will be found dead."""
    if site.network is None:
        return None
    leaders = np.array([[group.x_m, group.y_m] for group in site.groups]).reshape(-1, 2)
    hops = lay_out(site.network, site.positions, leaders).routes.hops
    arrives = delivery_probability(site.network, hops)
    return np.where(arrives > 0.0, arrives, 1.0)
