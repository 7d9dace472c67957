"""Ranges of tagged targets: drawn target by target, because their errors go on along a path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.sensing import range as ranging
from trackfield.sensing.range import RangeModel
from trackfield.simulation.deployment import Deployment
from trackfield.simulation.sensed import Steps
from trackfield.types import Indices, Readings, Truth, Vector


class Ranged(NamedTuple):
    """All ranges of a run, (n,), by time, then target, then sensor."""

    t_s: Vector
    target: Indices
    sensor: Indices
    value: Vector
    target_ids: tuple[str, ...]


def draw_ranges(
    model: RangeModel, deployment: Deployment, truth: Truth, *, rng: np.random.Generator
) -> Ranged:
    """Draw what every sensor in range reads of every target, Wang (2).

    A run of ranges is drawn at once: it takes memory as the run has readings.
    """
    sensors = deployment.network.positions
    order = np.argsort(truth.target, kind="stable")
    ends = np.cumsum(np.bincount(truth.target, minlength=len(truth.target_ids)))
    found: list[tuple[Vector, Indices, Indices, Vector]] = []
    for target, rows in enumerate(np.split(order, ends[:-1]) if len(order) else []):
        path = truth.position[rows, :2]
        drawn = ranging.simulate(model, sensors, path=path, rng=rng)
        step, sensor = np.nonzero(drawn.heard & deployment.network.alive)
        found.append(
            (
                truth.t_s[rows[step]],
                np.full(step.size, target, np.int32),
                sensor.astype(np.int32),
                drawn.value[step, sensor],
            )
        )
    nothing = (np.empty(0), np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))
    t_s, target, sensor, value = (
        np.concatenate(part) for part in zip(*found, nothing, strict=True)
    )
    by_time = np.argsort(t_s, kind="stable")
    return Ranged(t_s[by_time], target[by_time], sensor[by_time], value[by_time], truth.target_ids)


def ranges_of(ranged: Ranged, deployment: Deployment, steps: Steps) -> Readings:
    """Tabulate the ranges of some steps."""
    low, high = np.searchsorted(ranged.t_s, [steps.t_s[0], np.nextafter(steps.t_s[-1], np.inf)])
    here = slice(int(low), int(high))
    nothing = np.full(int(high - low), np.nan)
    return Readings(
        t_s=ranged.t_s[here],
        sensor=ranged.sensor[here],
        value=ranged.value[here],
        target=ranged.target[here],
        kind=np.zeros(nothing.size, np.int32),
        sigma=nothing,
        arrival_s=nothing,
        sensor_ids=deployment.sensor_ids,
        target_ids=ranged.target_ids,
        kinds=("range",),
    )
