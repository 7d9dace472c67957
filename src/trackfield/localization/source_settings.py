"""What the search for signal sources is told beside the model, and what it tells itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.signal import SignalModels
from trackfield.types import Matrix

_LEAST_WORK = 5_000_000
_WORK_PER_SENSOR = 200  # where targets stand side by side; of a field with few, less than 10
_DOUBTFUL = 0.3  # placement error over spacing from which on leaders must be surer


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """How sources are looked for in the readings of one scan.

    A sensor may lead if its reading exceeds what the known sources explain by `leader_sigmas`, and
    more than any other within `leader_radius_m`. A source is fitted to the sensors within
    `fit_radius_m`, together with up to `group` - 1 sources within `group_radius_m`, by steps of at
    most `max_step_m`; it is kept if it raises the log-likelihood by more than `gain` [nats]. Where
    strengths differ, it becomes two if that raises it by more than `split_gain`. A reading further
    off than `outlier_sigmas` is taken for a broken sensor's. `work` bounds the cost of a scan, in
    pairs of sensor and source.
    """

    leader_radius_m: float
    fit_radius_m: float
    group_radius_m: float
    max_step_m: float
    leader_sigmas: float = 4.5
    gain: float = 15.0
    split_gain: float = 11.0
    outlier_sigmas: float = 6.0
    group: int = 5
    rounds: int = 3
    work: int = _LEAST_WORK

    def __post_init__(self) -> None:
        for name in ("leader_radius_m", "fit_radius_m", "group_radius_m", "max_step_m"):
            _require(name, getattr(self, name), least=1e-9)
        for name in ("leader_sigmas", "gain", "split_gain", "outlier_sigmas"):
            _require(name, getattr(self, name), least=0.1)
        for name in ("group", "rounds", "work"):
            _require(name, getattr(self, name), least=1)


def settings_for(models: SignalModels, sensors: Matrix) -> SourceSettings:
    """Choose settings for `sensors` (n, 2): lengths follow their spacing.

    Where sensors are misplaced by .3 of the spacing or more, leaders must be surer.
    """
    reach_m = float(np.max(models.max_range_m))
    spacing_m = min(spacing(sensors), reach_m)
    doubtful = float(np.max(models.placement_sigma_m)) >= _DOUBTFUL * spacing_m
    return SourceSettings(
        leader_radius_m=1.5 * spacing_m,
        fit_radius_m=min(4.0 * spacing_m, reach_m),
        group_radius_m=2.0 * spacing_m + 1.0,
        max_step_m=0.7 * spacing_m,
        leader_sigmas=6.0 if doubtful else 4.5,
        gain=25.0 if doubtful else 15.0,
        work=max(_LEAST_WORK, _WORK_PER_SENSOR * len(sensors)),
    )


def spacing(sensors: Matrix) -> float:
    """Side [m] of the square grid that has as many sensors on the same upright rectangle.

    Infinite for a single sensor.
    """
    n = len(sensors)
    if n < 2:
        return math.inf
    width, height = np.ptp(sensors, axis=0)
    half = width + height
    return float(half + math.sqrt(half**2 + 4.0 * (n - 1) * width * height)) / (2.0 * (n - 1))


def _require(name: str, value: float, *, least: float) -> None:
    if not (math.isfinite(value) and value >= least):
        raise InputError(f"{name}: found {value!r}, expected a finite number >= {least}")
