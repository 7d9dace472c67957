"""What the sensors of a scenario say of its targets: readings and reports, some steps at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.raster import Region
from trackfield.sensing import detection, signal
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.signal import SensorErrors, SignalModel
from trackfield.simulation.deployment import Deployment
from trackfield.simulation.faults import Strike, active, bursts
from trackfield.simulation.scenario import Reports as ReportModel
from trackfield.simulation.scenario import Scenario
from trackfield.types import Indices, Matrix, Readings, Reports, Truth, Vector


class Steps(NamedTuple):
    """Some steps of a run: their times (m,) [s], and targets there, (m, k), -1 and NaN for none.

    `rows` are those of the truth that belong to these steps.
    """

    t_s: Vector
    target: Indices
    position: Matrix  # (m, k, 2) [m]
    rows: slice


def steps_of(scenario: Scenario, truth: Truth, first: int, last: int) -> Steps:
    """Gather the targets of steps `first` to before `last`."""
    t_s = scenario.step_s * np.arange(first, last, dtype=np.float64)
    edges = scenario.step_s * (np.array([first, last]) - 0.5)
    low, high = np.searchsorted(truth.t_s, edges)
    here = slice(int(low), int(high))
    step = np.rint(truth.t_s[here] / scenario.step_s).astype(np.int64) - first
    counts = np.bincount(step, minlength=last - first)
    place = np.arange(step.size) - np.repeat(np.cumsum(counts) - counts, counts)
    most = int(counts.max(initial=0))
    target = np.full((last - first, most), -1, np.int32)
    position = np.full((last - first, most, 2), np.nan)
    target[step, place] = truth.target[here]
    position[step, place] = truth.position[here, :2]
    return Steps(t_s, target, position, here)


class Loudness(NamedTuple):
    """What stays alike through a run of signals: errors of sensors, strengths of targets (k,)."""

    errors: SensorErrors
    factors: Vector


def loudness(
    model: SignalModel, deployment: Deployment, targets: int, rng: np.random.Generator
) -> Loudness:
    """Draw what stays alike through a run of signals."""
    errors = signal.draw_errors(model, deployment.network.positions, rng=rng)
    return Loudness(errors, np.exp(model.sigma_factor * rng.standard_normal(targets)))


def signals(
    model: SignalModel,
    deployment: Deployment,
    steps: Steps,
    *,
    kept: Loudness,
    rng: np.random.Generator,
) -> Matrix:
    """Draw the strengths (m, n) that sensors measure, Oh (1)."""
    factors = np.append(kept.factors, [0.0])[steps.target]
    return signal.simulate(
        model,
        deployment.network.positions,
        targets=steps.position,
        rng=rng,
        factors=factors,
        errors=kept.errors,
    )


def detections(
    model: DetectionModel,
    deployment: Deployment,
    steps: Steps,
    *,
    struck: tuple[Strike, ...],
    rng: np.random.Generator,
) -> Matrix:
    """Draw who detects, 1 or 0 (m, n), Oh III.A; in a burst, false ones have `factor` tries."""
    drawn = detection.simulate(
        model, deployment.network.positions, paths=steps.position, rng=rng
    ).detected
    more = bursts(struck, steps.t_s)[:, None] - 1.0
    if more.any():
        drawn = drawn | (rng.random(drawn.shape) < 1.0 - (1.0 - model.p_false) ** more)
    return drawn.astype(np.float64)


def as_readings(
    values: Matrix,
    said: NDArray[np.bool_],
    deployment: Deployment,
    *,
    steps: Steps,
    kind: str,
) -> Readings:
    """Tabulate the values (m, n) that are `said` (m, n), by time, then sensor."""
    step, sensor = np.nonzero(said & deployment.network.alive)
    nothing = np.full(step.size, np.nan)
    return Readings(
        t_s=steps.t_s[step],
        sensor=sensor.astype(np.int32),
        value=values[step, sensor],
        target=np.full(step.size, -1, np.int32),
        kind=np.zeros(step.size, np.int32),
        sigma=nothing,
        arrival_s=nothing,
        sensor_ids=deployment.sensor_ids,
        target_ids=(),
        kinds=(kind,),
    )


def stuck_values(values: Matrix, struck: tuple[Strike, ...], steps: Steps) -> Matrix:
    """Put what stuck sensors say into values (m, n)."""
    for fault, nodes in struck:
        if fault.kind == "stuck":
            there = active(fault, steps.t_s)[:, None] & nodes
            values = np.where(there, fault.value, values)
    return values


def as_reports(
    model: ReportModel,
    region: Region,
    steps: Steps,
    *,
    struck: tuple[Strike, ...],
    rng: np.random.Generator,
) -> Reports:
    """Draw positions of detected targets, and false ones, in no order within a step, Oh (4)."""
    step, place = np.nonzero(steps.target >= 0)
    seen = rng.random(step.size) < model.p_detection
    step, place = step[seen], place[seen]
    true = steps.position[step, place] + model.sigma_m * rng.standard_normal((step.size, 2))
    false = rng.poisson(model.false_per_scan * bursts(struck, steps.t_s))
    every = np.concatenate([step, np.repeat(np.arange(steps.t_s.size), false)])
    anywhere = rng.uniform(region[:2], region[2:], (int(false.sum()), 2))
    order = np.lexsort((rng.random(every.size), every))
    position = np.full((every.size, 3), np.nan)
    position[:, :2] = np.concatenate([true, anywhere])[order]
    return Reports(
        t_s=steps.t_s[every[order]],
        arrival_s=np.full(every.size, np.nan),
        position=position,
        covariance=np.full((every.size, 3), np.nan),
        confidence=np.full(every.size, np.nan),
    )
