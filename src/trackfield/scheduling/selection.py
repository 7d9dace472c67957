"""Which k of n sensors should sense: the set whose readings leave least uncertainty.

What one reading of sensor i says of the target is the information g g', g its row of `gains`: slope
of the expected reading over the standard deviation of its noise. A set S and a prior P leave
M = P + sum_{i in S} g_i g_i', and the criteria are those of optimal design: A, the trace of M^-1
(the mean squared error); D, log det M; E, the smallest eigenvalue of M.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from trackfield._core import _selection
from trackfield.errors import InputError
from trackfield.linalg import UNKNOWN_VARIANCE
from trackfield.types import Indices, Matrix, Vector

Criterion = Literal["A", "D", "E"]
CRITERIA: tuple[Criterion, ...] = ("A", "D", "E")
DIMENSIONS = 6  # at most
ENUMERATED = 20_000
"""Sets that are looked at one by one; where there are more, exchanges find a good one."""

_FINE, _COARSE = 1e-13, 1e-5  # information of free directions as share of the largest |g|^2


class Selection(NamedTuple):
    """Sensors that were selected, and what is known with their readings.

    `sensors` (k,) are rows of the gains, ascending; `value` is that of the criterion: A, the trace
    of `covariance` [m^2], the less the better; D, log det of the information; E, its smallest
    eigenvalue [1/m^2], the more the better. `way` says how they were found: "enumeration" of all
    sets, or "exchanges" one by one; `optimal` whether no set of k is better.

    `missing` (m, d) are the directions of which no reading of theirs, nor the prior, says anything;
    their variance counts as `linalg.UNKNOWN_VARIANCE`. Where there are any, no set of k leaves
    fewer, and among those this one is the best: the others are too few, or in one line.
    """

    sensors: Indices
    value: float
    way: str
    optimal: bool
    covariance: Matrix
    missing: Matrix

    @property
    def determined(self) -> bool:
        """Whether the readings and the prior say something of every direction."""
        return not len(self.missing)


class Known(NamedTuple):
    """What a set knows: `covariance` (d, d) [m^2], `missing` (m, d) free directions, `value`."""

    covariance: Matrix
    missing: Matrix
    value: float


def select(
    gains: Matrix, k: int, *, prior: Matrix | None = None, criterion: Criterion = "A"
) -> Selection:
    """Select k of n sensors by their `gains` (n, d), d <= 6, and the prior information (d, d).

    All sets are compared where there are few enough; else the best next sensor is taken k times,
    and single sensors are exchanged until no exchange helps. Where n < k all are taken. A row of
    zeros is a sensor that says nothing. Gains are in 1/m for positions; where axes have different
    units or importance, scale the columns.

    Raises `InputError` for gains or priors that are no numbers, of another shape, or a prior that
    is not symmetric and positive semidefinite.
    """
    g, p = checked(gains, prior)
    code = criterion_code(criterion)
    if k < 1:
        raise InputError(f"sensors to select: found {k}, expected at least 1")
    k = min(k, len(g))
    if k == 0:
        sensors, way = np.empty(0, np.int32), "enumeration"
        return _selection_of(g, p, sensors, criterion=criterion, way=way)
    way = "enumeration" if math.comb(len(g), k) <= ENUMERATED else "exchanges"
    search = _selection.enumerated if way == "enumeration" else _selection.exchanged
    fields = g[None], p[None], _CERTAIN
    found = _selection_of(g, p, search(*fields, k, code, _FINE), criterion=criterion, way=way)
    if found.determined:
        return found
    return _selection_of(g, p, search(*fields, k, code, _COARSE), criterion=criterion, way=way)


def known(gains: Matrix, *, prior: Matrix, criterion: Criterion = "A") -> Known:
    """Tell what readings with these `gains` (k, d) and the prior (d, d) leave, and its value.

    Directions without information have the variance `UNKNOWN_VARIANCE`, or 1e12 times the least one
    if that is less, as in `linalg.covariance_of`.
    """
    roots, axes = np.linalg.eigh(prior + gains.T @ gains)
    floor = max(1e-12 * roots[-1], 1.0 / UNKNOWN_VARIANCE)
    free = roots <= floor
    kept = np.maximum(roots, floor)
    covariance = (axes / kept) @ axes.T
    if criterion == "A":
        value = float((1.0 / kept).sum())
    else:
        value = float(np.log(kept).sum() if criterion == "D" else kept[0])
    return Known(0.5 * (covariance + covariance.T), axes[:, free].T, value)


def checked(gains: Matrix, prior: Matrix | None) -> tuple[Matrix, Matrix]:
    """Gains (n, d) and prior (d, d) as contiguous arrays; `InputError` if they are none."""
    g = np.ascontiguousarray(gains, float)
    if g.ndim != 2 or not 1 <= g.shape[1] <= DIMENSIONS:
        raise InputError(f"gains of shape {g.shape}: expected (n, d), d from 1 to {DIMENSIONS}")
    if not np.isfinite(g).all():
        i = int(np.flatnonzero(~np.isfinite(g).all(axis=1))[0])
        raise InputError(f"gains of sensor {i}: found {g[i].tolist()}, expected finite numbers")
    d = g.shape[1]
    return g, np.zeros((d, d)) if prior is None else checked_prior(prior, d)


def checked_prior(prior: Matrix, d: int) -> Matrix:
    """Prior information (d, d) as a contiguous array; `InputError` if it is none."""
    p = np.ascontiguousarray(prior, float)
    if p.shape != (d, d) or not np.isfinite(p).all():
        raise InputError(f"prior of shape {p.shape}: expected finite numbers, ({d}, {d})")
    slack = 1e-9 * float(np.abs(p).max())
    if float(np.abs(p - p.T).max()) > slack or float(np.linalg.eigvalsh(p)[0]) < -slack:
        raise InputError(f"prior: found {p.tolist()}, expected symmetric, positive semidefinite")
    return p


def criterion_code(criterion: Criterion) -> int:
    """Give the number of a criterion; `InputError` if there is none such."""
    if criterion not in CRITERIA:
        raise InputError(f"criterion: found {criterion!r}, expected one of A, D, E")
    return CRITERIA.index(criterion)


def _selection_of(
    g: Matrix, p: Matrix, sensors: Indices, *, criterion: Criterion, way: str
) -> Selection:
    chosen = np.sort(sensors)
    covariance, missing, value = known(g[chosen], prior=p, criterion=criterion)
    return Selection(chosen, value, way, way == "enumeration", covariance, missing)


_CERTAIN: Vector = np.ones(1)
