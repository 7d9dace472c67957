"""Noise, detection and false alarms, learned from the slot in the middle of a window of tracks.

By then later reports have settled what belongs to what. Each sum fades with a memory of 100 slots.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.association.model import Scene
from trackfield.association.partition import Window, follow
from trackfield.association.window import Known
from trackfield.types import Indices

_FADE = 1.0 - 1.0 / 100.0
_LEAST_FALSE = 0.2  # per scan: without any, two stray reports make a track
_LEAST_SIGMA_M = 1e-3


class Learned(NamedTuple):
    """Faded sums: squared residuals, their number; detections, misses; false alarms, slots."""

    residual2_m2: float
    residuals: float
    detections: float
    misses: float
    false: float
    slots: float

    def known(self, scene: Scene) -> Known:
        """Take what the scene tells, and what is learned where it tells nothing."""
        told = scene.reporting
        sigma = max((self.residual2_m2 / self.residuals) ** 0.5, _LEAST_SIGMA_M)
        detected = self.detections / (self.detections + self.misses)
        false = max(self.false / self.slots, _LEAST_FALSE)
        return Known(
            sigma if told.sigma_m is None else told.sigma_m,
            detected,
            false if told.false_per_scan is None else told.false_per_scan,
        )


def initial(scene: Scene) -> Learned:
    """Make priors worth a few reports: noise of 1 % of the width, detection .7, one false alarm."""
    return Learned(2.0 * scene.reporting.region.area * 1e-4, 2.0, 7.0, 3.0, 1.0, 1.0)


def left_open(scene: Scene, learned: Learned) -> dict[str, float]:
    """Tell what is believed of what the scene does not tell."""
    told = scene.reporting
    return {
        name: value
        for name, value in learned.known(scene)._asdict().items()
        if getattr(told, name) is None
    }


def learn(
    learned: Learned, scene: Scene, window: Window, *, owner: Indices, tracks: Indices
) -> Learned:
    """Add what the middle slot of the window says; nothing where the scene leaves nothing open.

    `owner` (n,) is the track of each report, -1 of none, `tracks` (K, T) their reports by slot. The
    residual of a report about its smoothed track, with that track's variance, is its variance: the
    step of expectation-maximization.
    """
    told = scene.reporting
    if None not in (told.sigma_m, told.p_detection, told.false_per_scan):
        return learned
    slots = window.t_s.size
    middle = slots // 2
    there = tracks >= 0
    inside = there[:, :middle].any(axis=1) & there[:, middle + 1 :].any(axis=1)
    seen = inside & there[:, middle]
    residual2 = 0.0
    if seen.any():
        smooth = follow(window, tracks[seen], middle)
        offset = window.position[tracks[seen, middle]] - smooth.mean[:, :2]
        variance = smooth.covariance[:, 0, 0] + smooth.covariance[:, 1, 1]
        residual2 = float(((offset**2).sum(axis=1) + variance).sum()) / 2.0
    sums = (
        residual2,
        np.count_nonzero(seen),
        np.count_nonzero(seen),
        np.count_nonzero(inside & ~seen),
        np.count_nonzero((window.slot == middle) & (owner < 0)),
        1.0,
    )
    return Learned(*(_FADE * old + float(new) for old, new in zip(learned, sums, strict=True)))
