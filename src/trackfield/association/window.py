"""What is believed of a window's reports before any track: the scene, seen from each slot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.association.contract import ReportScan
from trackfield.association.model import USUAL_BIRTHS_PER_S, Scene, Targets
from trackfield.association.partition import Life, Window
from trackfield.raster import Field, Raster, value_at
from trackfield.types import Matrix, Vector

_LEAST_DETECTION, _MOST_DETECTION = 1e-4, 1.0 - 1e-6


class Known(NamedTuple):
    """What the scene leaves open, as believed now: noise, detection and false alarms."""

    sigma_m: float
    p_detection: float
    false_per_scan: float


def life_time_s(targets: Targets, step_s: float) -> float:
    """Return the mean lifetime [s]: a window does not know ages, so a hazard counts by its mean."""
    if not targets.hazard:
        return targets.lifetime_s
    alive = np.cumprod(1.0 - np.asarray(targets.hazard, float))
    last = max(float(targets.hazard[-1]), 1e-9)  # holds from there on
    return step_s * (1.0 + float(alive[:-1].sum()) + float(alive[-1]) / last)


def window(
    scene: Scene, scans: Sequence[ReportScan], *, known: Known, begins: bool, paper: bool
) -> Window:
    """Make scans a window; `begins` tells that the first of them is the first of the run.

    First detections have the density of births; and at the start of the window that of targets that
    stand there already: births times lifetime, or the initial count, thinned by every slot in which
    they were not seen. `paper`: births alone, and a death charged once (Oh (5), corrected).
    """
    reporting, targets = scene.reporting, scene.targets
    t_s = np.array([scan.t_s for scan in scans])
    slot = np.repeat(np.arange(len(scans), dtype=np.int32), [len(scan.number) for scan in scans])
    position = np.concatenate([scan.position for scan in scans])
    lifetime_s = life_time_s(targets, reporting.step_s)
    survival = np.exp(-np.diff(t_s, prepend=t_s[0]) / lifetime_s)
    p_detection = _detection(scene, position, slots=len(scans), known=known)
    births_per_s = USUAL_BIRTHS_PER_S if targets.births_per_s is None else targets.births_per_s
    step_births = births_per_s * reporting.step_s
    standing = targets.initial_count if begins else births_per_s * lifetime_s
    births = np.full(slot.size, step_births)
    if not paper:
        missed = survival[:, None] * (1.0 - p_detection)
        unseen = np.vstack([np.ones(slot.size), np.cumprod(missed, axis=0)[:-1]])
        births += standing * unseen[slot, np.arange(slot.size)]
    density = _relative(targets.birth_map, position) / reporting.region.area
    false = _relative(reporting.false_map, position) * known.false_per_scan / reporting.region.area
    p_death = -math.expm1(-reporting.step_s / lifetime_s)
    return Window(
        t_s=t_s,
        survival=survival,
        slot=slot,
        position=position,
        covariance=_covariance(scans, known.sigma_m),
        log_birth=np.log(np.maximum(births * density, 1e-12)),
        log_false=np.log(np.maximum(false, 1e-12)),
        p_detection=p_detection,
        life=Life(
            targets.accel_sigma_m_s2,
            targets.velocity_sigma_m_s,
            reporting.step_s,
            region=None if paper else reporting.region,
            log_death=math.log(p_death) if paper else None,
        ),
    )


def _covariance(scans: Sequence[ReportScan], sigma_m: float) -> Matrix:
    told = np.concatenate([scan.covariance for scan in scans])
    return np.where(np.isfinite(told), told, np.array([1.0, 0.0, 1.0]) * sigma_m**2)


def _detection(scene: Scene, position: Matrix, *, slots: int, known: Known) -> Matrix:
    """P(a target near a report is reported by now), (T, n): what is late may still come."""
    ages: tuple[Field, ...] = scene.reporting.p_detection or (known.p_detection,)
    rows = [value_at(ages[min(slots - 1 - t, len(ages) - 1)], position) for t in range(slots)]
    return np.clip(np.array(rows), _LEAST_DETECTION, _MOST_DETECTION)


def _relative(density: Field, position: Matrix) -> Vector:
    """Density over its mean; 1 where it is the same everywhere."""
    if isinstance(density, Raster):
        return density.at(position) / max(density.mean(), 1e-300)
    return np.ones(len(position))
