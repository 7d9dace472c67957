"""Limits and starting values of the Bernoulli mixture, and how a scene is told to its kernel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackfield.association.model import Scene
from trackfield.errors import ConfigurationError
from trackfield.raster import Field, Raster, Region

_MOST_RECENT = 8  # the kernel's


@dataclass(frozen=True, slots=True)
class BernoulliSettings:
    """How much is remembered, how finely, and what is shown.

    Histories of a target that took the same reports in the last `recent_scans` become one; 0 keeps
    one Gaussian a target (JIPDA). A scan may be `window_steps` late; hindsight reaches
    `history_steps` back. `work` bounds the nodes of all enumerations in a step, `cluster_work`
    those of one cluster; a cluster that needs more is decided by belief propagation. A target is
    shown if that is worth more than hiding it under GOSPA with `cutoff_m`; components further than
    `near_m` from the likeliest are not averaged with it.
    """

    recent_scans: int = 5
    max_hypotheses: int = 100  # of a cluster
    max_leaves: int = 10  # histories of a target in a cluster that is decided by propagation
    max_tracks: int = 1000
    window_steps: int = 10
    history_steps: int = 10
    gate_d2: float = 20.0
    least_existence: float = 1e-3
    least_weight: float = 1e-4  # of a hypothesis, over the likeliest one
    work: int = 60_000
    cluster_work: int = 30_000
    cutoff_m: float = 5.0
    near_m: float = 2.0


def problems(scene: Scene, settings: BernoulliSettings) -> list[str]:
    """Say what of a scene or of settings cannot be used, one line each."""
    targets, reporting = scene.targets, scene.reporting
    region = reporting.region
    ages = reporting.p_detection or ()
    sigma, false = reporting.sigma_m, reporting.false_per_scan
    births = targets.births_per_s
    rules = [
        (region.x_max > region.x_min and region.y_max > region.y_min, "region", region),
        (reporting.step_s > 0, "step_s", reporting.step_s),
        (sigma is None or 0 < sigma < math.inf, "sigma_m", sigma),
        (false is None or 0 <= false < math.inf, "false_per_scan", false),
        (reporting.p_detection is None or len(ages) > 0, "p_detection", ages),
        (all(_within(p, 0.0, 1.0) for p in ages), "p_detection", ages),
        (_within(reporting.false_map, 0.0, math.inf), "false_map", reporting.false_map),
        (0 <= targets.accel_sigma_m_s2 < math.inf, "accel_sigma_m_s2", targets.accel_sigma_m_s2),
        (0 < targets.velocity_sigma_m_s < math.inf, "velocity_sigma_m_s", None),
        (targets.lifetime_s > 0, "lifetime_s", targets.lifetime_s),
        (all(0 <= h <= 1 for h in targets.hazard), "hazard", targets.hazard),
        (births is None or 0 <= births < math.inf, "births_per_s", births),
        (0 <= targets.initial_count < math.inf, "initial_count", targets.initial_count),
        (_within(targets.birth_map, 0.0, math.inf), "birth_map", targets.birth_map),
        (_within(targets.survival_map, 0.0, 1.0), "survival_map", targets.survival_map),
        (0 <= settings.recent_scans <= _MOST_RECENT, "recent_scans", settings.recent_scans),
        (settings.max_hypotheses >= 1, "max_hypotheses", settings.max_hypotheses),
        (settings.max_leaves >= 1, "max_leaves", settings.max_leaves),
        (settings.max_tracks >= 1, "max_tracks", settings.max_tracks),
        (settings.window_steps >= 0, "window_steps", settings.window_steps),
        (settings.history_steps >= 0, "history_steps", settings.history_steps),
        (settings.gate_d2 > 0, "gate_d2", settings.gate_d2),
        (settings.cutoff_m > 0 and settings.near_m >= 0, "cutoff_m", settings.cutoff_m),
        (settings.work >= 0 and settings.cluster_work >= 0, "work", settings.work),
        (0 <= settings.least_existence < 1, "least_existence", settings.least_existence),
        (0 <= settings.least_weight < 1, "least_weight", settings.least_weight),
    ]
    return [f"{name}: outside its domain, found {found}" for good, name, found in rules if not good]


def kernel_model(scene: Scene, settings: BernoulliSettings) -> dict[str, object]:
    """Tell the kernel a scene; `ConfigurationError` names all that cannot be used."""
    found = problems(scene, settings)
    if found:
        raise ConfigurationError(found)
    targets, reporting = scene.targets, scene.reporting
    region, step_s = reporting.region, reporting.step_s
    return {
        **region._asdict(),
        "accel_sigma": targets.accel_sigma_m_s2,
        "velocity_sigma": targets.velocity_sigma_m_s,
        "survival": math.exp(-step_s / targets.lifetime_s),
        "hazard": list(targets.hazard),
        "births": -1.0 if targets.births_per_s is None else targets.births_per_s * step_s,
        "initial_count": targets.initial_count,
        "birth_map": _map(targets.birth_map, region),
        "survival_map": _map(targets.survival_map, region),
        "step": step_s,
        "sigma": reporting.sigma_m or 0.0,
        "p_detection": [_map(p, region) for p in reporting.p_detection or ()],
        "false_per_scan": -1.0 if reporting.false_per_scan is None else reporting.false_per_scan,
        "false_map": _map(reporting.false_map, region),
        "first_sigma": first_sigma_m(scene),
        "first_p_detection": 0.7,
        "first_false": 5.0,
        "first_births": 0.15 * step_s,
        "weight_sigma": 2.0,
        "weight_p_detection": 20.0,
        "weight_false": 2.0,
        "weight_births": 3.0,
        "memory_sigma": 500.0,
        "memory_p_detection": 500.0,
        "memory_false": 100.0,
        "memory_births": 200.0,
        "gate": settings.gate_d2,
        "least_existence": settings.least_existence,
        "least_weight": settings.least_weight,
        "joined_existence": 0.01,
        "dependence": 0.005,
        "duplicates": 0.1,
        "recent": settings.recent_scans,
        "hypotheses": settings.max_hypotheses,
        "poor": 0.3,
        "leaves": settings.max_leaves,
        "max_tracks": settings.max_tracks,
        "work": settings.work,
        "cluster_work": settings.cluster_work,
        "history": settings.history_steps,
        "cutoff": settings.cutoff_m,
        "near": settings.near_m,
    }


def first_sigma_m(scene: Scene) -> float:
    """Noise of a report without a covariance: as told, or the guess that learning starts from."""
    told = scene.reporting.sigma_m
    return math.sqrt(scene.reporting.region.area) / 100.0 if told is None else told


def _within(quantity: Field, low: float, high: float) -> bool:
    values = quantity.values if isinstance(quantity, Raster) else np.array([quantity])
    return bool(
        values.size
        and np.isfinite(values).all()
        and (values >= low).all()
        and (values <= high).all()
    )


def _map(quantity: Field, region: Region) -> tuple[tuple[float, ...], object]:
    if isinstance(quantity, Raster):
        return tuple(quantity.region), np.ascontiguousarray(quantity.values, dtype=np.float64)
    return tuple(region), np.array([[float(quantity)]])
