"""Positions from one scan of binary detections: one target after another, silence counts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.localization.detection_belief import (
    Belief,
    Scan,
    belief_in,
    known,
    log_ratio_map,
    window_around,
)
from trackfield.localization.detection_cells import DetectionCells, check_scan
from trackfield.localization.detection_pairs import split
from trackfield.types import Matrix, Vector

_SWEEPS = 3


class PeeledReports(NamedTuple):
    """Reports of one scan, one entry a target: `position` (k, 2) [m], `covariance` (k, 3) xx xy yy.

    `confidence` (k,) is the probability that the target is there, given the others.
    """

    position: Matrix
    covariance: Matrix
    confidence: Vector


def peel(
    cells: DetectionCells,
    detected: NDArray[np.bool_],
    *,
    expected_targets: float = 1.0,
    most_targets: int = 20,
    delivery: float | Vector = 1.0,
) -> PeeledReports:
    """Explain detections (n,) by as few targets as they need, one after another.

    A new target is looked for where it raises the likelihood of all detections and silences most;
    it stays if it is likelier than not, a priori `expected_targets` anywhere in the region. Targets
    found are revisited in turn, each given the others; one that the others explain away is dropped;
    one that two explain better is split. A target's place is the mean over the cells near by,
    weighed by likelihood, and so is its covariance. `delivery` (n,) is the probability that a
    detection arrives (times that the node is alive).
    """
    check_scan(cells, detected)
    if not expected_targets > 0.0:
        raise InputError(f"expected_targets: found {expected_targets:g}, expected more than 0")
    scan = Scan(detected, np.broadcast_to(np.asarray(delivery, float), detected.size))
    prior = expected_targets / len(cells.centres)
    found = _peeled(cells, scan, prior=prior, most=most_targets)
    found = _with_pairs(cells, scan, found, prior=prior, most=most_targets)
    odds = prior * np.array([one.odds for one in found])
    return PeeledReports(
        np.array([one.position for one in found]).reshape(-1, 2),
        np.array([one.covariance for one in found]).reshape(-1, 3),
        odds / (1.0 + odds),
    )


def _peeled(cells: DetectionCells, scan: Scan, *, prior: float, most: int) -> list[Belief]:
    found: list[Belief] = []
    while len(found) < most:
        gain = log_ratio_map(cells, scan, known(cells, found))
        new = _belief_near(cells, gain, cells.centres[int(np.argmax(gain))])
        if prior * new.odds <= 1.0:
            break
        found = _revisited(cells, scan, [*found, new])
        kept = [one for one in found if prior * one.odds > 1.0]
        if len(kept) < len(found):  # another try would find the same one again
            return kept
    return found


def _with_pairs(
    cells: DetectionCells, scan: Scan, found: list[Belief], *, prior: float, most: int
) -> list[Belief]:
    """Split each target that two explain better; parts are tried again, until none is split."""
    whole: list[Belief] = []
    while found:
        one, *rest = found
        others = known(cells, [*whole, *rest])
        parts = split(cells, scan, others, near=one.position, prior=prior)
        if parts is None or len(whole) + len(found) >= most:
            whole.append(one)
            found = rest
        else:
            found = [*parts, *rest]
    return whole


def _revisited(cells: DetectionCells, scan: Scan, found: list[Belief]) -> list[Belief]:
    """Each target again, given all others, in turns."""
    for _ in range(_SWEEPS if len(found) > 1 else 0):
        for k, one in enumerate(found):
            gain = log_ratio_map(cells, scan, known(cells, found[:k] + found[k + 1 :]))
            found[k] = _belief_near(cells, gain, one.position)
    return found


def _belief_near(cells: DetectionCells, gain: Vector, place: Vector) -> Belief:
    """Belief in a target within a sensor's reach of a place."""
    window = window_around(cells, place, reach_m=cells.reach_m)
    peak = float(gain[window].max())
    weight = np.exp(gain[window] - peak)
    total = float(weight.sum())
    odds = total * float(np.exp(min(peak, 600.0)))
    return belief_in(cells, window, weight=weight / total, odds=odds)
