"""Two targets side by side: the likelihood of all pairs of cells around a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackfield.localization.detection_belief import Belief, Known, Scan, belief_in, window_around
from trackfield.localization.detection_cells import DetectionCells
from trackfield.types import Matrix, Vector

_REACH = 1.3  # of a sensor's reach: how far from where one was seen two are looked for
_MOST_CELLS = 400


def pair_log_ratios(
    cells: DetectionCells, scan: Scan, others: Known, *, window: NDArray[np.intp]
) -> tuple[Vector, Matrix]:
    """Log of P(z | a target in cell a) / P(z | none), (w,), and the same of pairs a, b, (w, w).

    Exact where coverage is 0 or 1: a sensor's term depends on how many of the two it covers, so
    that a product of matrices sums them all. Between, logarithms are interpolated.
    """
    m, missed, away = cells.models, others.missed, others.away
    place = np.full(len(cells.centres), -1)
    place[window] = np.arange(window.size)
    entries = np.flatnonzero(place[cells.cell] >= 0)
    near = np.unique(cells.sensor[entries])
    c = np.zeros((window.size, near.size))
    column = np.searchsorted(near, cells.sensor[entries])
    c[place[cells.cell[entries]], column] = cells.coverage[entries]

    def term(missed: Vector, away: Vector | float) -> Vector:
        seen = scan.delivery * (1.0 - missed + m.p_false * away)
        P = np.clip(seen, 1e-12, 1.0 - 1e-12)[near]
        return np.where(scan.detected[near], np.log(P), np.log1p(-P))

    none = term(missed, away)
    one = term(missed * (1.0 - m.p_detection), 0.0) - none
    two = term(missed * (1.0 - m.p_detection) ** 2, 0.0) - none
    alone = c @ one
    return alone, alone[:, None] + alone + (c * (two - 2.0 * one)) @ c.T


def split(
    cells: DetectionCells, scan: Scan, others: Known, *, near: Vector, prior: float
) -> tuple[Belief, Belief] | None:
    """Two targets in place of one `near` a place, if they explain the scan better, else None.

    Every cell holds a target with probability `prior`; places are summed over, not chosen. The two
    are told apart by the line through the likeliest pair.
    """
    window = window_around(cells, near, reach_m=_REACH * cells.reach_m)
    thinned = -(-window.size // _MOST_CELLS)
    window = window[::thinned]
    alone, pairs = pair_log_ratios(cells, scan, others, window=window)
    log_prior = np.log(prior * thinned)
    one = float(np.logaddexp.reduce(alone)) + log_prior
    top = float(pairs.max())
    weight = np.exp(pairs - top)
    two = float(np.log(0.5 * weight.sum())) + top + 2.0 * log_prior
    if two <= one:
        return None
    i, j = np.unravel_index(int(np.argmax(pairs)), pairs.shape)
    along = cells.centres[window] @ (cells.centres[window[j]] - cells.centres[window[i]])
    order = np.sign(along - along[:, None])
    weight *= 0.5 * (1.0 + order)  # pairs a, b with a before b; half of those that are level
    weight /= weight.sum()
    odds = float(np.exp(min(two - one, 500.0))) / prior
    first, second = weight.sum(axis=1), weight.sum(axis=0)
    return (
        belief_in(cells, window, weight=first, odds=odds),
        belief_in(cells, window, weight=second, odds=odds),
    )
