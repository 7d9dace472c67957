"""Small worlds of targets that give reports, for tests of trackers of unknown targets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.raster import Region

REGION = Region(0.0, 0.0, 100.0, 100.0)
SCENE = Scene(Reporting(REGION, 1.0, 0.4, (0.73,), 6.0), Targets())


class World(NamedTuple):
    """Scans, and where targets were, (T, targets, 2) [m]; NaN while a target is not there."""

    scans: list[ReportScan]
    truth: np.ndarray


def scan(t_s, position, *, first=0, covariance=None) -> ReportScan:
    """Make a scan of positions (n, 2), numbered from `first` on."""
    position = np.array(position, float).reshape(-1, 2)
    n = len(position)
    told = np.full((n, 3), np.nan) if covariance is None else np.array(covariance, float)
    return ReportScan(float(t_s), position, told, np.arange(first, first + n, dtype=np.int32))


def world(seed, *, steps=30, targets=5, p_detection=0.73, false=6.0, sigma_m=0.4) -> World:
    """Targets that cross the region, some appearing late, among false alarms, like scenario B."""
    rng = np.random.default_rng(seed)
    truth = np.full((steps, targets, 2), np.nan)
    for k in range(targets):
        start = 0 if k < 2 else int(rng.integers(0, steps // 2))
        angle, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.5)
        x, v = rng.uniform(25, 75, 2), speed * np.array([np.cos(angle), np.sin(angle)])
        for t in range(start, steps):
            if not REGION.contains(x):
                break
            truth[t, k] = x
            push = 0.15 * rng.standard_normal(2)
            x, v = x + v + push / 2, v + push
    scans, number = [], 0
    for t in range(steps):
        seen = np.isfinite(truth[t, :, 0]) & (rng.random(targets) < p_detection)
        reports = truth[t, seen] + sigma_m * rng.standard_normal((seen.sum(), 2))
        clutter = rng.uniform(0, 100, (rng.poisson(false), 2))
        mixed = rng.permutation(np.vstack([reports, clutter]))
        scans.append(scan(t, mixed, first=number))
        number += len(mixed)
    return World(scans, truth)


def mean_gospa(shown, truth, *, cutoff_m=5.0) -> float:
    """Mean GOSPA (p 2) of shown positions, a list of (n, 2) a step."""
    costs = []
    for estimate, there in zip(shown, truth, strict=True):
        there = there[np.isfinite(there[:, 0])]
        D2 = np.minimum(((estimate[:, None] - there[None]) ** 2).sum(axis=2), cutoff_m**2)
        pairs = linear_sum_assignment(D2)
        near = D2[pairs] < cutoff_m**2
        unpaired = len(estimate) + len(there) - 2 * np.count_nonzero(near)
        costs.append((D2[pairs][near].sum() + cutoff_m**2 / 2 * unpaired) ** 0.5)
    return float(np.mean(costs))
