"""Who chases whom: the last capture as soon as may be, Oh (24), exact with ties.

Costs are times to capture (p, e), infinite where a pursuer never reaches an evader. As many pairs
are made as can be: with more pursuers than evaders some are left over, with more evaders those are
chased that let the last capture come soonest.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import (
    linear_sum_assignment,  # pyright: ignore[reportUnknownVariableType]
)
from scipy.sparse import csr_array
from scipy.sparse.csgraph import (
    maximum_bipartite_matching,  # pyright: ignore[reportUnknownVariableType]
)

from trackfield.errors import InputError
from trackfield.types import Indices, Matrix

NOBODY = -1
Objective = Literal["bottleneck", "lexicographic", "sum", "greedy"]


class Chase(NamedTuple):
    """Evader of each pursuer, `evader` (p,), -1: spare; the last capture and the sum of all [s].

    `uncaught` (m,) are the evaders that nobody chases.
    """

    evader: Indices
    last_s: float
    sum_s: float
    uncaught: Indices


def assign(costs: Matrix, objective: Objective = "bottleneck") -> Chase:
    """Assign pursuers to evaders by their times to capture (p, e) [s].

    - "bottleneck": least last capture, and of those assignments the least sum;
    - "lexicographic": least last capture, then least last but one, and so on;
    - "sum": least sum of times;
    - "greedy": the least time first, without looking ahead: the worst last capture.

    All make as many pairs of finite cost as there can be.
    """
    c = _checked(costs)
    most = _pairs(np.isfinite(c))
    chosen: Indices
    match objective:
        case "bottleneck":
            chosen = _least_sum(c, c <= _threshold(c, np.isfinite(c), most))
        case "lexicographic":
            chosen = _least_vector(c)
        case "sum":
            chosen = _least_sum(c, np.isfinite(c))
        case "greedy":
            chosen = _greedy(c)
    return chase(c, chosen)


def bottleneck(costs: Matrix) -> float:
    """Least last capture [s] of all assignments with as many pairs as can be; 0 without a pair."""
    c = _checked(costs)
    finite = np.isfinite(c)
    return _threshold(c, finite, _pairs(finite))


def chase(costs: Matrix, evader: Indices) -> Chase:
    """Weigh an assignment: `evader` (p,) of each pursuer, -1: spare."""
    pursuers = np.flatnonzero(evader >= 0)
    times = costs[pursuers, evader[pursuers]]
    free = np.ones(costs.shape[1], np.bool_)
    free[evader[pursuers]] = False
    left = np.flatnonzero(free).astype(np.int32)
    return Chase(evader, float(times.max(initial=0.0)), float(times.sum()), left)


def keep(costs: Matrix, before: Indices, fresh: Chase, *, margin: float = 0.1) -> Chase:
    """Keep the assignment of `before` unless `fresh` ends sooner by the part `margin`.

    Without it noise lets pursuers flap between evaders, and none is ever reached. One that cannot
    be kept (an evader is gone, a pair would never meet, fewer are chased) is given up.
    """
    p, e = costs.shape
    paired = np.flatnonzero(before >= 0) if before.shape == (p,) else np.empty(0, np.intp)
    if before.shape != (p,) or (before >= e).any():
        return fresh
    same = paired.size == np.count_nonzero(fresh.evader >= 0)
    if not same or not np.isfinite(costs[paired, before[paired]]).all():
        return fresh
    held = chase(costs, before)
    return fresh if fresh.last_s < (1.0 - margin) * held.last_s else held


def double(costs: Matrix, made: Chase) -> Indices:
    """Give spare pursuers an evader too, (p,): each in turn to the one that is caught last so far.

    A spare helps an evader whose capture it would make sooner, or else the one it is nearest to.
    """
    evader = made.evader.copy()
    chased: Indices = np.unique(evader[evader >= 0])
    if chased.size in (0, evader.size):
        return evader
    soonest = np.array([costs[evader == j, j].min() for j in chased])
    for i in np.flatnonzero(evader == NOBODY):
        gain = soonest - costs[i, chased]
        helped = gain > 0.0
        late = np.where(helped, soonest, -np.inf)
        place = int(late.argmax()) if helped.any() else int(costs[i, chased].argmin())
        if np.isfinite(costs[i, chased[place]]):
            evader[i] = chased[place]
            soonest[place] = min(soonest[place], costs[i, chased[place]])
    return evader


def _checked(costs: Matrix) -> Matrix:
    c = np.asarray(costs, np.float64)
    if c.ndim != 2:
        raise InputError(f"costs of shape {c.shape}: expected (pursuers, evaders)")
    if np.isnan(c).any() or (c < 0.0).any():
        raise InputError("costs: found NaN or a time below 0, expected times of 0 or more")
    return c


def _matching(allowed: NDArray[np.bool_]) -> Indices:
    """Evader (p,) of each pursuer in a largest matching of allowed pairs; -1 for none."""
    ends = np.append(0, np.cumsum(allowed.sum(axis=1)))
    columns = np.nonzero(allowed)[1]
    graph = csr_array((np.ones(columns.size, np.bool_), columns, ends), shape=allowed.shape)
    return cast("Indices", maximum_bipartite_matching(graph, perm_type="column"))


def _pairs(allowed: NDArray[np.bool_]) -> int:
    if not allowed.size or allowed.all():
        return min(allowed.shape)
    return int(np.count_nonzero(_matching(allowed) >= 0))


def _threshold(c: Matrix, allowed: NDArray[np.bool_], most: int) -> float:
    """Least t at which the allowed pairs of cost <= t still make `most` pairs.

    Where each pursuer, or each evader, is in a pair, none is sooner than the last of their soonest;
    from there on twice as far at a time until the pairs suffice, then by bisection.
    """
    if most == 0:
        return 0.0
    open_ = np.where(allowed, c, np.inf)
    sides = [axis for axis in (0, 1) if most == c.shape[1 - axis]]
    bound = max((open_.min(axis=axis).max() for axis in sides), default=-np.inf)
    values = np.unique(open_[np.isfinite(open_) & (open_ >= bound)])

    def enough(place: int) -> bool:
        return _pairs(open_ <= values[place]) == most

    first, last, stride = 0, 0, most
    while last < values.size - 1 and not enough(last):
        first, last, stride = last + 1, min(last + stride, values.size - 1), 2 * stride
    while first < last:
        middle = (first + last) // 2
        first, last = (first, middle) if enough(middle) else (middle + 1, last)
    return float(values[first])


def _least_sum(c: Matrix, allowed: NDArray[np.bool_]) -> Indices:
    """Make most allowed pairs, and of those assignments take one of least sum, (p,)."""
    evader = np.full(c.shape[0], NOBODY, np.int32)
    if not allowed.any():
        return evader
    # A forbidden pair costs more than all allowed ones together, so that it is never preferred.
    forbidden = 2.0 * (1.0 + min(c.shape) * float(c[allowed].max()))
    table = np.where(allowed, c, forbidden)
    rows, columns = cast("tuple[Indices, Indices]", linear_sum_assignment(table))
    good = allowed[rows, columns]
    evader[rows[good]] = columns[good]
    return evader


def _greedy(c: Matrix) -> Indices:
    evader = np.full(c.shape[0], NOBODY, np.int32)
    open_ = c.copy()
    while np.isfinite(open_).any():
        i, j = np.unravel_index(open_.argmin(), c.shape)
        evader[i] = j
        open_[i], open_[:, j] = np.inf, np.inf
    return evader


def _least_vector(c: Matrix) -> Indices:
    """Lexicographic bottleneck: fewest pairs at the worst level that must be, then the next below.

    The table is filled up to a square with nobodies, which cost less than anybody; pairs that never
    meet are the worst level of all. Of a level's assignments with fewest pairs at it, the pairs
    without reduced cost are exactly those that occur; the next level chooses among them, so that
    ties are exact.
    """
    side = max(c.shape)
    cost = np.full((side, side), -1.0)
    cost[: c.shape[0], : c.shape[1]] = c
    allowed = np.ones(cost.shape, np.bool_)
    settled = np.zeros(cost.shape, np.bool_)
    evader = _matching(allowed)
    while (open_ := allowed & ~settled).any():
        level = _level(cost, allowed, open_)
        if level < 0.0:
            break
        usable = settled | (cost <= level)
        evader, allowed = _fewest(cost == level, allowed & usable)
        settled |= cost >= level
    evader = _matching(allowed & (settled | (cost < 0.0)))[: c.shape[0]]
    real = evader < c.shape[1]
    real[real] = np.isfinite(c[np.flatnonzero(real), evader[real]])
    return np.where(real, evader, NOBODY).astype(np.int32)


def _level(cost: Matrix, allowed: NDArray[np.bool_], open_: NDArray[np.bool_]) -> float:
    """Least level with which the open pairs up to it, and the settled ones, pair everybody."""
    values = np.unique(cost[open_])
    low, high = 0, values.size - 1
    while low < high:
        middle = (low + high) // 2
        usable = allowed & (~open_ | (cost <= values[middle]))
        low, high = (low, middle) if _pairs(usable) == len(cost) else (middle + 1, high)
    return float(values[low])


def _fewest(
    counted: NDArray[np.bool_], allowed: NDArray[np.bool_]
) -> tuple[Indices, NDArray[np.bool_]]:
    """Pair everybody with fewest counted pairs: such an assignment, and all pairs of such ones."""
    n = len(counted)
    weight = np.where(allowed, counted, 2.0 * n)
    evader = cast("Indices", linear_sum_assignment(weight)[1])
    own = weight[np.arange(n), evader]
    price = np.zeros(n)  # of evaders: the shortest way round that ends at each
    while True:
        cheaper = np.minimum(price, (price[evader] - own)[:, None] + weight).min(axis=0)
        if (cheaper == price).all():
            break
        price = cheaper
    reduced = weight - (own - price[evader])[:, None] - price
    return evader, allowed & (reduced == 0.0)
