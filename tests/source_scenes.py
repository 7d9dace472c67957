"""Fields of signal-strength sensors that tests and benchmarks share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.localization.source_fit import Sources
from trackfield.sensing.signal import SignalModel

OH = SignalModel(sigma_gain=0.0)  # Oh IV.B.3 with R_s = 8
ROUGH = SignalModel(sigma_gain=0.1, placement_sigma_m=0.1, sigma_factor=0.3)


def grid(side: int, spacing_m: float = 1.0) -> np.ndarray:
    """Places (side^2, 2) of a square grid with a corner at the origin."""
    x = np.arange(side) * spacing_m
    return np.stack(np.meshgrid(x, x), -1).reshape(-1, 2)


class Matched(NamedTuple):
    """Targets that were found, each by one report: rows of the reports, rows of the targets."""

    reports: np.ndarray
    targets: np.ndarray


def match(found: Sources, targets: np.ndarray, radius_m: float = 1.0) -> Matched:
    """Pair reports and targets nearer than a radius, the nearest first."""
    distance = np.linalg.norm(found.position[:, None] - targets, axis=-1)
    pairs: list[tuple[int, int]] = []
    while distance.size and distance.min() < radius_m:
        i, j = np.unravel_index(distance.argmin(), distance.shape)
        pairs.append((int(i), int(j)))
        distance[i], distance[:, j] = np.inf, np.inf
    rows = np.array(pairs, int).reshape(-1, 2)
    return Matched(rows[:, 0], rows[:, 1])


def nis(found: Sources, targets: np.ndarray, pairs: Matched) -> np.ndarray:
    """Squared errors of matched reports in their own covariance, 2 degrees of freedom each."""
    e = found.position[pairs.reports] - targets[pairs.targets]
    xx, xy, yy = found.covariance[pairs.reports].T
    return (yy * e[:, 0] ** 2 - 2 * xy * e[:, 0] * e[:, 1] + xx * e[:, 1] ** 2) / (xx * yy - xy**2)
