"""The cheapest set of k sensors that is accurate enough: exactly, and by Pham's sum of ranks.

A set is accurate enough if trace (J + sum g g')^-1 <= B, J the prior information, g the gains.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _lifetime
from trackfield.errors import InputError
from trackfield.types import Indices, Matrix, Vector

MOST_SETS = 5_000_000
"""Sets that are compared one by one, at most."""
_FLAT = {2: 1e-12, 3: 1e-14}  # a determinant below this part of trace^d counts as zero


class SensorSet(NamedTuple):
    """A set of k sensors: `chosen` (k,) rising, the sum of its costs, its trace [1/information].

    Where no set is within the bound, `feasible` is false and this is the set with the least trace
    that can be reached; `chosen` is empty and the trace infinite where no set fixes a position at
    all (fewer than k sensors with finite costs, or all on a line). `attempts` counts the sets whose
    trace was asked for, 0 where the search is not one by one.
    """

    chosen: Indices
    cost: float
    trace: float
    feasible: bool
    attempts: int = 0


def optimum(
    gains: Matrix, costs: Vector, *, bound: float, k: int = 3, prior: Matrix | None = None
) -> SensorSet:
    """Minimise the sum of costs over sets of k with trace <= bound: Pham (5.4), exact.

    Branch and bound: sensors by rising cost; a branch is cut where its cheapest completion is no
    better, and where all of the rest together would not be accurate enough. `gains` (n, d), d 2 or
    3; `costs` (n,), infinite for sensors that are not to be had; k 1 to 4; `prior` (d, d).
    """
    g, c, J = _checked(gains, costs, bound=bound, k=k, prior=prior)
    here = np.array([0, len(g)], np.int32), np.arange(len(g), dtype=np.int32), g
    chosen, _ = _lifetime.cheapest(*here, c, J, bound, k)
    feasible = chosen[0, 0] >= 0
    if not feasible:
        chosen, _ = _lifetime.sharpest(*here, c, J, k)
    return _named(chosen[0], g, c, J, feasible=bool(feasible))


def rank_sum(
    gains: Matrix, costs: Vector, *, bound: float, k: int = 3, prior: Matrix | None = None
) -> SensorSet:
    """Minimise the sum of ranks by cost, not of costs, over sets with trace <= bound: Pham 5.3.3.

    Sets are tried by rising rank sum, equal ones by rising cost, until one is accurate enough:
    `attempts` many. Not the optimum (the paper's Theorem 5.1 is wrong), but rarely far from it.
    Arguments as in `optimum`; `InputError` if there are over `MOST_SETS` sets.
    """
    g, c, J = _checked(gains, costs, bound=bound, k=k, prior=prior)
    had = np.flatnonzero(np.isfinite(c))
    sets = had[all_sets(had.size, k)].astype(np.int32)
    tried = sets[rank_order(c, sets)]
    good = np.flatnonzero(set_traces(g, tried, prior=J) <= bound)
    if good.size:
        found = _named(tried[good[0]], g, c, J, feasible=True)
        return found._replace(attempts=int(good[0]) + 1)
    here = np.array([0, len(g)], np.int32), np.arange(len(g), dtype=np.int32), g
    chosen, _ = _lifetime.sharpest(*here, c, J, k)
    return _named(chosen[0], g, c, J, feasible=False)._replace(attempts=len(tried))


def rank_order(costs: Vector, sets: Indices) -> NDArray[np.intp]:
    """Order (m,) of sets (m, k) by the sum of their sensors' ranks by cost, then by cost."""
    rank = np.empty(len(costs), np.intp)
    rank[np.argsort(costs, kind="stable")] = np.arange(len(costs))
    return np.lexsort((costs[sets].sum(axis=1), rank[sets].sum(axis=1)))


def all_sets(n: int, k: int) -> Indices:
    """Give all sets of k of n sensors, (m, k) in lexicographic order."""
    if math.comb(n, k) > MOST_SETS:
        raise InputError(
            f"found {math.comb(n, k)} sets of {k} of {n}, expected at most {MOST_SETS}"
        )
    flat = np.fromiter((i for each in combinations(range(n), k) for i in each), np.int32)
    return flat.reshape(-1, k)


def set_traces(gains: Matrix, sets: Indices, *, prior: Matrix | None = None) -> Vector:
    """Traces (m,) of (J + sum g g')^-1 over sets (m, k) of gains (n, d), infinite if singular."""
    g = np.asarray(gains, np.float64)
    d = g.shape[1]
    members = g[sets]
    information = np.swapaxes(members, -1, -2) @ members
    if prior is not None:
        information = information + prior
    size = np.trace(information, axis1=-2, axis2=-1)
    solid = np.linalg.det(information) > _FLAT[d] * size**d
    information[~solid] = np.eye(d)
    traces = np.trace(np.linalg.inv(information), axis1=-2, axis2=-1)
    return np.where(solid, traces, np.inf)


def _named(chosen: Indices, g: Matrix, c: Vector, J: Matrix, *, feasible: bool) -> SensorSet:
    """Make a result of the kernel's answer, which is -1 where there is no set."""
    if chosen[0] < 0:
        return SensorSet(np.zeros(0, np.int32), math.inf, math.inf, feasible=False)
    members = np.sort(chosen)
    trace = float(set_traces(g, members[None], prior=J)[0])
    return SensorSet(members, float(c[members].sum()), trace, feasible)


def _checked(
    gains: Matrix, costs: Vector, *, bound: float, k: int, prior: Matrix | None
) -> tuple[Matrix, Vector, Matrix]:
    g = np.ascontiguousarray(gains, np.float64)
    if g.ndim != 2 or g.shape[1] not in _FLAT or not np.isfinite(g).all():
        raise InputError(
            f"gains of shape {g.shape}, expected finite ones of shape (n, 2) or (n, 3)"
        )
    c = np.ascontiguousarray(costs, np.float64)
    if c.shape != (len(g),):
        raise InputError(f"costs of shape {c.shape}, expected ({len(g)},)")
    if np.isnan(c).any() or (c < 0.0).any():
        raise InputError(f"costs: found {c[~(c >= 0.0)][0]}, expected 0 or more")
    if not bound > 0.0:
        raise InputError(f"bound: found {bound}, expected a positive trace")
    if k not in (1, 2, 3, 4):
        raise InputError(f"k: found {k}, expected sets of 1 to 4 sensors")
    d = g.shape[1]
    J = np.zeros((d, d)) if prior is None else np.ascontiguousarray(prior, np.float64)
    if J.shape != (d, d) or not np.isfinite(J).all():
        raise InputError(f"prior of shape {J.shape}, expected a finite one of shape ({d}, {d})")
    return g, c, J
