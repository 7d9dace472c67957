"""Which k of n sensors should sense: the set whose readings leave least uncertainty.

`gains` (n, d) are what one reading of each sensor says of the target, see `criteria`. What k ranges
can do at best is a matter of geometry: three sensors of equal noise in the plane leave a trace of
4/3 sigma^2 where their lines of sight cross at 60 degrees, and much more where they are in a line.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from trackfield._core import _selection
from trackfield.scheduling import criteria
from trackfield.scheduling.criteria import (
    COARSE,
    FINE,
    Criterion,
    checked,
    checked_number,
    criterion_code,
    known,
)
from trackfield.types import Indices, Matrix, Vector

Way = Literal["enumeration", "tree", "exchanges"]
ENUMERATED = 2500
"""Sets that are looked at one by one, at most; more go through the tree."""
EXACT = 24
"""Sensors among which the best set is found for certain, whatever that takes."""
WORK = 20_000
"""Sets that the tree looks at, at most, where there are more sensors than that."""


class Selection(NamedTuple):
    """Sensors that were selected, and what is known with their readings.

    `sensors` (k,) are rows of the gains, ascending; `value` is that of the criterion: A, the trace
    of `covariance` [m^2], the less the better; D, log det of the information; E, its smallest
    eigenvalue [1/m^2], the more the better. `optimal` says that no set of k is better; `way` how
    that is known: "enumeration" of all sets or a "tree" cut off by the bound. Otherwise the set
    comes from "exchanges" of single sensors and as much of the tree as was looked at.

    No set of k can be better than `bound`, and `ratio` is by how many times this one is worse at
    most (for D in the geometric mean of the variances). `relaxation.dual_bound` recomputes the
    bound from the matrix `certificate` (d, d) alone, by the k largest of n scores; None where all
    sets were looked at.

    `missing` (m, d) are the directions of which neither these readings nor the prior say anything;
    their variance counts as `linalg.UNKNOWN_VARIANCE`. Where there are any, no set of k leaves
    fewer, and among those this one is the best: the sensors are too few, or stand in one line.
    Nothing is claimed of others then: `bound` is the value.
    """

    sensors: Indices
    value: float
    way: Way
    optimal: bool
    bound: float
    ratio: float
    certificate: Matrix | None
    covariance: Matrix
    missing: Matrix

    @property
    def determined(self) -> bool:
        """Whether the readings and the prior say something of every direction."""
        return not len(self.missing)


def select(
    gains: Matrix, k: int, *, prior: Matrix | None = None, criterion: Criterion = "A"
) -> Selection:
    """Select k of n sensors by their `gains` (n, d), d <= 6, and the prior information (d, d).

    Few sets are all compared. Of many the best next sensor is taken k times, single sensors are
    exchanged until that does not help, the relaxation bounds what is possible, and a tree of sets
    cut off by that bound looks for a better one: to the end for up to `EXACT` sensors, else for up
    to `WORK` sets, which mostly is the end too. Where n < k all are taken. A row of zeros is a
    sensor that says nothing. Where axes have different units or importance, scale the columns.

    Raises `InputError` for gains or priors that are no numbers, of another shape, or a prior that
    is not symmetric and positive semidefinite.
    """
    g, p = checked(gains, prior)
    code = criterion_code(criterion)
    k = min(checked_number(k), len(g))
    found = _search(g, p, k, code=code, ridge=FINE)
    left = known(g[found.sensors], prior=p, criterion=criterion)
    if len(left.missing):
        found = _search(g, p, k, code=code, ridge=COARSE)
        left = known(g[found.sensors], prior=p, criterion=criterion)
    bound = left.value
    if found.bound is not None and not len(left.missing):
        bound = -found.bound if criterion == "A" else found.bound
    return Selection(
        sensors=found.sensors,
        value=left.value,
        way=found.way,
        optimal=found.way != "exchanges",
        bound=bound,
        ratio=criteria.ratio(left.value, bound, criterion=criterion, d=len(p)),
        certificate=found.certificate,
        covariance=left.covariance,
        missing=left.missing,
    )


class _Search(NamedTuple):
    sensors: Indices
    way: Way
    bound: float | None = None  # of the merit, the larger the better
    certificate: Matrix | None = None


def _search(g: Matrix, p: Matrix, k: int, *, code: int, ridge: float) -> _Search:
    if k in (0, len(g)):
        return _Search(np.arange(k, dtype=np.int32), "enumeration")
    fields = g[None], p[None], _CERTAIN, k, code, ridge
    if math.comb(len(g), k) <= ENUMERATED:
        return _Search(np.sort(_selection.enumerated(*fields)), "enumeration")
    work = WORK if len(g) > EXACT else math.comb(EXACT, EXACT // 2) * EXACT
    sensors, bound, certificate, complete = _selection.searched(*fields, work)
    return _Search(np.sort(sensors), "tree" if complete else "exchanges", bound, certificate)


_CERTAIN: Vector = np.ones(1)
