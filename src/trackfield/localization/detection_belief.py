"""Where one of several targets may be, given a scan of binary detections and the other targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.localization.detection_cells import DetectionCells
from trackfield.types import Matrix, Vector


class Scan(NamedTuple):
    """Who detected, (n,), and how probably a detection arrives from each sensor, (n,)."""

    detected: NDArray[np.bool_]
    delivery: Vector


class Belief(NamedTuple):
    """What is believed of a target: place, and who covers it.

    `odds` is the sum over cells of P(z | one more target in the cell) / P(z | without it);
    `covariance` holds xx, xy, yy [m^2]; `coverage` (n,) is the mean over where it may be.
    """

    odds: float
    position: Vector
    covariance: Vector
    coverage: Vector


class Known(NamedTuple):
    """What the targets that are known leave to be seen of each sensor, both (n,).

    `missed` = prod_k (1 - p c_k) and `away` = prod_k (1 - c_k); 1 where nobody is.
    """

    missed: Vector
    away: Vector


def known(cells: DetectionCells, others: Sequence[Belief]) -> Known:
    """Sum up the targets that are known."""
    p = cells.models.p_detection
    ones = np.ones(p.size)
    return Known(
        np.prod([ones, *(1.0 - p * one.coverage for one in others)], axis=0),
        np.prod([ones, *(1.0 - one.coverage for one in others)], axis=0),
    )


def belief_in(
    cells: DetectionCells, window: NDArray[np.intp], *, weight: Vector, odds: float
) -> Belief:
    """Belief in a target that is in cell `window` (w,) with probability `weight` (w,)."""
    position = weight @ cells.centres[window]
    dx, dy = (cells.centres[window] - position).T
    least = cells.cell_m**2 / 12.0  # within a cell the place is not known
    share = np.zeros(len(cells.centres))
    share[window] = weight
    coverage = np.bincount(
        cells.sensor,
        weights=cells.coverage * share[cells.cell],
        minlength=cells.models.p_detection.size,
    )
    return Belief(
        odds,
        position,
        np.array([weight @ (dx * dx) + least, weight @ (dx * dy), weight @ (dy * dy) + least]),
        np.minimum(coverage, 1.0),
    )


def log_ratio_map(cells: DetectionCells, scan: Scan, others: Known) -> Vector:
    """Log of P(z | one more target in the cell) / P(z | without it), (m,); silence counts too."""
    m, i, c = cells.models, cells.sensor, cells.coverage
    missed, away, delivery = others.missed, others.away, scan.delivery
    before = delivery * (1.0 - missed + m.p_false * away)
    after = delivery[i] * (
        1.0 - missed[i] * (1.0 - m.p_detection[i] * c) + m.p_false[i] * away[i] * (1.0 - c)
    )
    before, after = (np.clip(P, 1e-12, 1.0 - 1e-12) for P in (before, after))
    hit, silent = np.log(after / before[i]), np.log((1.0 - after) / (1.0 - before[i]))
    terms = np.where(scan.detected[i], hit, silent)
    return np.bincount(cells.cell, weights=terms, minlength=len(cells.centres)).astype(float)


def window_around(cells: DetectionCells, place: Vector, *, reach_m: float) -> NDArray[np.intp]:
    """Cells (w,) within `reach_m` of a place; at least the nearest ones, however wide they are."""
    reach = max(reach_m, 1.5 * cells.cell_m)
    near: Matrix = cells.centres - place
    return np.flatnonzero(np.hypot(near[:, 0], near[:, 1]) <= reach)
