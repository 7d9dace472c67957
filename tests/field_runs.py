"""Fields of sensors that see walkers without names, as sites and readings."""

from __future__ import annotations

import numpy as np

from trackfield.network.site import ReportSettings, Site
from trackfield.sensing import detection, signal
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.signal import SignalModel
from trackfield.types import Readings, Truth

KINDS = ("range", "signal", "detection")


def grid(model, *, side=12, spacing=5.0, **changes) -> Site:
    """Sensors on a square grid, one a second."""
    xy = spacing * np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    n = len(xy)
    fields = {
        "name": "field",
        "sensor_ids": tuple(f"s{i:03d}" for i in range(n)),
        "positions": np.column_stack([xy, np.full(n, np.nan)]).astype(float),
        "models": (model,) * n,
        "reports": ReportSettings(step_s=1.0),
    }
    return Site(**{**fields, **changes})


def paths(steps=60) -> np.ndarray:
    """Two walkers that cross the field and pass each other at a distance, (steps, 2, 2) [m]."""
    t = np.arange(steps)[:, None]
    first = np.array([[2.0, 10.0]]) + t * [[0.85, 0.45]]
    second = np.array([[52.0, 45.0]]) - t * [[0.8, 0.3]]
    return np.stack([first, second], axis=1)


def table(t_s, sensor, value, *, kind, sensor_ids) -> Readings:
    n = len(t_s)
    return Readings(
        t_s=np.asarray(t_s, float),
        sensor=np.asarray(sensor, np.int32),
        value=np.asarray(value, float),
        target=np.full(n, -1, np.int32),
        kind=np.full(n, KINDS.index(kind), np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=sensor_ids,
        target_ids=(),
        kinds=KINDS,
    )


def truth(path) -> Truth:
    steps, k, _ = path.shape
    t, target = np.repeat(np.arange(steps, dtype=float), k), np.tile(np.arange(k), steps)
    position = np.column_stack([path.reshape(-1, 2), np.full(steps * k, np.nan)])
    return Truth(t, target.astype(np.int32), position, tuple(f"w{i}" for i in range(k)))


def signals(seed=0, steps=60):
    """A site of signal sensors and what they say of the two walkers, every one every second."""
    model = SignalModel(amplitude=400.0, max_range_m=12.0)
    site, path = grid(model), paths(steps)
    rng = np.random.default_rng(seed)
    z = signal.simulate(model, site.positions[:, :2], targets=path, rng=rng)
    step, sensor = np.divmod(np.arange(z.size), z.shape[1])
    readings = table(step, sensor, z.ravel(), kind="signal", sensor_ids=site.sensor_ids)
    return site, readings, truth(path)


def detections(seed=0, steps=40, *, says_zero=False, walkers=1):
    """A site of binary sensors and what they say; only 1 is sent, unless `says_zero`."""
    model = DetectionModel()
    site, path = grid(model, side=9), paths(steps)[:, :walkers]
    rng = np.random.default_rng(seed)
    said = detection.simulate(model, site.positions[:, :2], paths=path, rng=rng).detected
    step, sensor = np.nonzero(np.ones_like(said) if says_zero else said)
    readings = table(step, sensor, said[step, sensor], kind="detection", sensor_ids=site.sensor_ids)
    return site, readings, truth(path)
