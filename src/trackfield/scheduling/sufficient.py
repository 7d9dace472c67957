"""The cheapest sensors that are good enough: least cost under a bound on the uncertainty."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield._core import _selection
from trackfield.errors import InputError
from trackfield.scheduling.criteria import (
    FINE,
    Criterion,
    checked,
    checked_costs,
    checked_number,
    criterion_code,
    known,
    rescaled,
    scaled,
)
from trackfield.scheduling.selection import select, work
from trackfield.types import Indices, Matrix, Vector


class Sufficient(NamedTuple):
    """Sensors that are good enough, or the best there are.

    `sensors` (m,), m <= k, are rows of the gains, ascending, `cost` the sum of their costs, and
    `value` that of the criterion. Where no set of k sensors is good enough, `feasible` is false and
    these are the best that can be reached. `bound` is what every set that is good enough costs at
    least, infinite where there is surely none; `optimal` says that none costs less, or reaches
    more. `covariance` (d, d) [m^2] is what they leave.
    """

    sensors: Indices
    cost: float
    value: float
    feasible: bool
    optimal: bool
    bound: float
    covariance: Matrix


def sufficient(
    gains: Matrix,
    k: int,
    *,
    costs: Vector,
    level: float,
    prior: Matrix | None = None,
    criterion: Criterion = "A",
) -> Sufficient:
    """Find at most k sensors of least cost with a trace of at most `level` [m^2], Pham 5.3, exact.

    For D and E the value is to be at least `level`. `gains` (n, d), prior information (d, d),
    `costs` (n,) in any one unit: what a reading takes from the battery, and its bits times the hops
    to whoever wants them. No sensor at all is a set too, if the prior is good enough.

    A greedy set is made cheaper by leaving out and exchanging; the relaxation says what shares of
    sensors would cost, and a tree of sets cut off by that looks for a cheaper one: to the end for
    up to `selection.EXACT` sensors, else for `selection.WORK` sets, which mostly is the end too.

    Raises `InputError` as `select` does, and for a level that is no number.
    """
    g, p = checked(gains, prior)
    c = checked_costs(costs, len(g))
    code = criterion_code(criterion)
    k = min(checked_number(k), len(g))
    if not np.isfinite(level):
        raise InputError(f"level: found {level}, expected a number")
    sensors, bound, proved = np.empty(0, np.int32), 0.0, True
    feasible = _enough(known(g[:0], prior=p, criterion=criterion).value, level, criterion)
    if not feasible and k:
        best = select(g, k, prior=p, criterion=criterion)
        sensors, proved = best.sensors, best.optimal
        feasible = best.determined and _enough(best.value, level, criterion)
        if feasible:
            unit = scaled(g, p)
            merit = rescaled(level, 1.0 / unit.length, criterion=criterion, d=len(p))
            merit = -merit if criterion == "A" else merit
            task = unit.gains[None], unit.prior[None], k, code, FINE, c, merit, sensors
            sensors, bound, proved = _selection.sufficient(*task, work(len(g)))
        elif best.optimal or not _enough(best.bound, level, criterion):
            bound = np.inf
    chosen = np.sort(sensors)
    covariance, _, value = known(g[chosen], prior=p, criterion=criterion)
    cost = float(c[chosen].sum())
    return Sufficient(
        sensors=chosen,
        cost=cost,
        value=value,
        feasible=feasible,
        optimal=proved,
        bound=min(bound, cost) if feasible else bound,
        covariance=covariance,
    )


def _enough(value: float, level: float, criterion: Criterion) -> bool:
    return value <= level if criterion == "A" else value >= level
