"""Positions from one scan of binary detections: one target after another, silence counts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.localization.detection_cells import DetectionCells, check_scan
from trackfield.types import Matrix, Vector

_SWEEPS = 3


class PeeledReports(NamedTuple):
    """Reports of one scan, one entry a target: `position` (k, 2) [m], `covariance` (k, 3) xx xy yy.

    `confidence` (k,) is the probability that the target is there, given the others.
    """

    position: Matrix
    covariance: Matrix
    confidence: Vector


class _Target(NamedTuple):
    """What is believed of one target: odds of being there, place, and who covers it."""

    odds: float
    position: Vector
    covariance: Vector  # xx, xy, yy
    coverage: Vector  # (n,), mean over where it may be


def peel(
    cells: DetectionCells,
    detected: NDArray[np.bool_],
    *,
    expected_targets: float = 1.0,
    most_targets: int = 20,
    delivery: float | Vector = 1.0,
) -> PeeledReports:
    """Explain detections (n,) by as few targets as they need, greedily, then each given the rest.

    A new target is looked for where it raises the likelihood of all detections and silences most;
    it stays if it is likelier than not, a priori `expected_targets` anywhere in the region. Its
    place is the mean over the cells near by, weighed by likelihood, and so is its covariance.
    Targets found are then revisited in turn; one that the others explain away is dropped.
    `delivery` (n,) is the probability that a detection arrives (times that the node is alive).
    """
    check_scan(cells, detected)
    if not expected_targets > 0.0:
        raise InputError(f"expected_targets: found {expected_targets:g}, expected more than 0")
    arrives = np.broadcast_to(np.asarray(delivery, float), detected.size)
    prior = expected_targets / len(cells.centres)
    found: list[_Target] = []
    for _ in range(most_targets):
        new = _likeliest(cells, detected, arrives, others=found)
        if prior * new.odds <= 1.0:
            break
        found = _revisited(cells, detected, arrives, found=[*found, new])
        kept = [one for one in found if prior * one.odds > 1.0]
        if len(kept) < len(found):  # another try would find the same one again
            found = kept
            break
    odds = prior * np.array([one.odds for one in found])
    return PeeledReports(
        np.array([one.position for one in found]).reshape(-1, 2),
        np.array([one.covariance for one in found]).reshape(-1, 3),
        odds / (1.0 + odds),
    )


def log_ratio_map(
    cells: DetectionCells,
    detected: NDArray[np.bool_],
    *,
    missed: Vector,
    away: Vector,
    delivery: Vector,
) -> Vector:
    """Log of P(z | one more target in the cell) / P(z | without it), (m,).

    `missed` = prod_k (1 - p c_k) and `away` = prod_k (1 - c_k), (n,), are those of the targets that
    are known already, 1 where nobody is; detections and silences (n,) of all sensors count.
    """
    m, i, c = cells.models, cells.sensor, cells.coverage
    before = delivery * (1.0 - missed + m.p_false * away)
    after = delivery[i] * (
        1.0 - missed[i] * (1.0 - m.p_detection[i] * c) + m.p_false[i] * away[i] * (1.0 - c)
    )
    before, after = (np.clip(P, 1e-12, 1.0 - 1e-12) for P in (before, after))
    terms = np.where(detected[i], np.log(after / before[i]), np.log((1 - after) / (1 - before[i])))
    return np.bincount(cells.cell, weights=terms, minlength=len(cells.centres)).astype(float)


def _likeliest(
    cells: DetectionCells,
    detected: NDArray[np.bool_],
    delivery: Vector,
    *,
    others: list[_Target],
    near: Vector | None = None,
) -> _Target:
    """Best further target, everywhere or within a sensor's reach of a place."""
    p = cells.models.p_detection
    missed = np.prod([np.ones(p.size), *(1.0 - p * one.coverage for one in others)], axis=0)
    away = np.prod([np.ones(p.size), *(1.0 - one.coverage for one in others)], axis=0)
    gain = log_ratio_map(cells, detected, missed=missed, away=away, delivery=delivery)
    about = cells.centres[int(np.argmax(gain))] if near is None else near
    reach = max(cells.reach_m, 1.5 * cells.cell_m)
    window = np.flatnonzero(np.linalg.norm(cells.centres - about, axis=1) <= reach)
    peak = float(gain[window].max())
    weight = np.exp(gain[window] - peak)
    total = float(weight.sum())
    weight = weight / total
    position = weight @ cells.centres[window]
    dx, dy = (cells.centres[window] - position).T
    least = cells.cell_m**2 / 12.0  # within a cell the place is not known
    covariance = np.array(
        [weight @ (dx * dx) + least, weight @ (dx * dy), weight @ (dy * dy) + least]
    )
    share = np.zeros(len(cells.centres))
    share[window] = weight
    coverage = np.bincount(
        cells.sensor, weights=cells.coverage * share[cells.cell], minlength=p.size
    )
    odds = total * float(np.exp(min(peak, 600.0)))
    return _Target(odds, position, covariance, np.minimum(coverage, 1.0))


def _revisited(
    cells: DetectionCells,
    detected: NDArray[np.bool_],
    delivery: Vector,
    *,
    found: list[_Target],
) -> list[_Target]:
    """Each target again, given all others, in turns."""
    for _ in range(_SWEEPS if len(found) > 1 else 0):
        for k, one in enumerate(found):
            others = found[:k] + found[k + 1 :]
            found[k] = _likeliest(cells, detected, delivery, others=others, near=one.position)
    return found
