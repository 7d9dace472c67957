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
from trackfield.errors import InputError
from trackfield.scheduling import criteria
from trackfield.scheduling.criteria import (
    COARSE,
    FINE,
    SILENT,
    Criterion,
    checked,
    checked_costs,
    checked_number,
    criterion_code,
    left,
    rescaled,
    scaled,
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
    eigenvalue [1/m^2], the more the better; `cost` the sum of their costs, 0 if none were told.
    `optimal` says that no set is better; `way` how that is known: "enumeration" of all sets or a
    "tree" cut off by the bound. Otherwise the set comes from "exchanges" of single sensors and as
    much of the tree as was looked at.

    No set can be better than `bound`, and `ratio` is by how many times this one is worse at most
    (for D in the geometric mean of the variances). `relaxation.dual_bound` recomputes the bound
    from the matrix `certificate` (d, d) alone, by the k largest of n scores; it is None where all
    sets were looked at, and under a budget.

    `missing` (m, d) are the directions of which neither these readings nor the prior say anything;
    their variance counts as `linalg.UNKNOWN_VARIANCE`. Where there are any, no set leaves fewer,
    and among those this one is the best (for E, by D): the sensors are too few, or stand in one
    line. Nothing is claimed of others then: `bound` is the value.
    """

    sensors: Indices
    value: float
    cost: float
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
    gains: Matrix,
    k: int,
    *,
    prior: Matrix | None = None,
    criterion: Criterion = "A",
    costs: Vector | None = None,
    budget: float = math.inf,
) -> Selection:
    """Select k of n sensors by their `gains` (n, d), d <= 6, and the prior information (d, d).

    Few sets are all compared. Of many the best next sensor is taken k times, single sensors are
    exchanged until that does not help, the relaxation bounds what is possible, and a tree of sets
    cut off by that bound looks for a better one: to the end for up to `EXACT` sensors, else for up
    to `WORK` sets, which mostly is the end too. With `costs` (n,) and a `budget`, in any one unit,
    at most k sensors are taken whose costs add up to no more.

    Where n < k all are taken. A row of zeros is a sensor that says nothing. Where axes have
    different units or importance, scale the columns of the gains.

    Raises `InputError` for gains, priors or costs that are no numbers or of another shape, a prior
    that is not symmetric and positive semidefinite, negative costs, or a budget without costs.
    """
    g, p = checked(gains, prior)
    code = criterion_code(criterion)
    k = min(checked_number(k), len(g))
    c = None if costs is None else checked_costs(costs, len(g))
    if not budget >= 0.0 or (c is None and budget < math.inf):
        raise InputError(f"budget: found {budget:g}, expected costs, and a budget of at least 0")
    unit = scaled(g, p)
    task = _Task(unit.gains, unit.prior, k, code, c, budget)
    found = _search(task, FINE)
    known = left(g, found.sensors, prior=p, code=code)
    if len(known.missing):
        other = criterion_code("D" if criterion == "E" else criterion)  # E: all are equally bad
        found = _search(task._replace(code=other), COARSE)
        known = left(g, found.sensors, prior=p, code=code)
    bound = known.value
    if found.bound is not None and not len(known.missing):
        merit = -found.bound if criterion == "A" else found.bound
        bound = rescaled(merit, unit.length, criterion=criterion, d=len(p))
        everybody = left(g, np.arange(len(g), dtype=np.int32), prior=p, code=code).value
        if not math.isfinite(bound) or (bound < everybody) == (criterion == "A"):
            bound = everybody  # no set is better than all sensors: a bound for numbers of no size
    return Selection(
        sensors=found.sensors,
        value=known.value,
        cost=0.0 if c is None else float(c[found.sensors].sum()),
        way=found.way,
        optimal=found.way != "exchanges",
        bound=bound,
        ratio=criteria.ratio(known.value, bound, criterion=criterion, d=len(p)),
        certificate=found.certificate,
        covariance=known.covariance,
        missing=known.missing,
    )


class _Task(NamedTuple):
    gains: Matrix
    prior: Matrix
    k: int
    code: int
    costs: Vector | None
    budget: float


class _Found(NamedTuple):
    sensors: Indices
    way: Way
    bound: float | None = None  # of the merit, the larger the better
    certificate: Matrix | None = None


def work(n: int) -> int:
    """Count the sets that a tree may look at among n sensors."""
    return WORK if n > EXACT else 2**EXACT


def _search(task: _Task, ridge: float) -> _Found:
    """Find sensors among those that the budget pays for."""
    g, p, k, code, costs, budget = task
    if not g.size or float(np.abs(g).max()) < SILENT:  # all sets are alike
        return _Found(np.arange(k if costs is None else 0, dtype=np.int32), "enumeration")
    if costs is None or np.sort(costs)[len(costs) - k :].sum() <= budget:
        return _search_free(g, p, k, code=code, ridge=ridge)
    payable = np.flatnonzero(costs <= budget).astype(np.int32)
    inner = task._replace(gains=g[payable], costs=costs[payable], k=min(k, len(payable)))
    if len(payable) < len(g):
        found = _search(inner, ridge)
        return found._replace(sensors=payable[found.sensors], certificate=None)
    sensors, bound, complete = _selection.affordable(
        g[None], p[None], k, code, ridge, costs, budget, work(len(g))
    )
    return _Found(np.sort(sensors), "tree" if complete else "exchanges", bound)


def _search_free(g: Matrix, p: Matrix, k: int, *, code: int, ridge: float) -> _Found:
    """Find sensors whatever they cost."""
    if k in (0, len(g)):
        return _Found(np.arange(k, dtype=np.int32), "enumeration")
    fields = g[None], p[None]
    if math.comb(len(g), k) <= ENUMERATED:
        sensors = _selection.enumerated(*fields, _CERTAIN, k, code, ridge)
        return _Found(np.sort(sensors), "enumeration")
    sensors, bound, certificate, complete = _selection.searched(
        *fields, k, code, ridge, work(len(g))
    )
    return _Found(np.sort(sensors), "tree" if complete else "exchanges", bound, certificate)


_CERTAIN: Vector = np.ones(1)
