"""Who goes with whom: the cheapest matching of a sparse set of pairs."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import (
    linear_sum_assignment,  # pyright: ignore[reportUnknownVariableType]
)
from scipy.sparse import csr_array
from scipy.sparse.csgraph import (
    connected_components,  # pyright: ignore[reportUnknownVariableType]
    min_weight_full_bipartite_matching,  # pyright: ignore[reportUnknownVariableType]
)

from trackfield.types import Vector

Numbers = NDArray[np.integer[Any]]
LARGEST_DENSE = 10_000_000  # entries; beyond that a table of all pairs costs more than a list


def cheapest(left: Numbers, right: Numbers, cost: Vector, *, alone: float) -> NDArray[np.bool_]:
    """Choose pairs (k,), each left and right at most once: min sum of cost - `alone` over pairs.

    `left` and `right` (k,) are numbers from 0, `cost` (k,) is less than `alone`, what two of a side
    cost without a partner; a pair appears once. Parts that share nobody are solved apart, so that a
    run of many steps is one call.
    """
    chosen = (np.bincount(left)[left] == 1) & (np.bincount(right)[right] == 1)
    rest = np.flatnonzero(~chosen)
    if rest.size == 0:
        return chosen
    lefts, i = np.unique(left[rest], return_inverse=True)
    rights, j = np.unique(right[rest], return_inverse=True)
    count = lefts.size + rights.size
    graph = csr_array((np.ones(rest.size, bool), (i, lefts.size + j)), shape=(count, count))
    part = cast("Numbers", connected_components(graph, directed=False)[1])
    i_part, j_part = part[: lefts.size], part[lefts.size :]
    i_place, j_place = _places(i_part)[i], _places(j_part)[j]
    order = np.argsort(i_part[i], kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(i_part[i][order])) + 1):
        picked = _solve(i_place[group], j_place[group], cost[rest[group]], alone)
        chosen[rest[group[picked]]] = True
    return chosen


def _places(part: Numbers) -> Numbers:
    """Place of everybody within his part, from 0."""
    order = np.argsort(part, kind="stable")
    sizes = np.bincount(part)
    places = np.empty(part.size, np.intp)
    places[order] = np.arange(part.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return places


def _solve(i: Numbers, j: Numbers, cost: Vector, alone: float) -> Numbers:
    """Places of the chosen pairs of one part."""
    shape = int(i.max()) + 1, int(j.max()) + 1
    if shape[0] * shape[1] > LARGEST_DENSE:
        return _solve_sparse(i, j, cost, alone)
    table, pair = np.full(shape, alone), np.full(shape, -1)
    table[i, j], pair[i, j] = cost, np.arange(cost.size)
    found = pair[linear_sum_assignment(table)]
    return found[found >= 0]


def _solve_sparse(i: Numbers, j: Numbers, cost: Vector, alone: float) -> Numbers:
    """Solve it as a list of pairs: every left may also stay alone, with a partner of its own."""
    lefts, rights = int(i.max()) + 1, int(j.max()) + 1
    single = np.arange(lefts)
    low = float(cost.min()) - 1.0  # so that costs are positive: a list keeps no zeros
    costs = csr_array(
        (
            np.concatenate([cost - low, np.full(lefts, alone - low)]),
            (np.concatenate([i, single]), np.concatenate([j, rights + single])),
        ),
        shape=(lefts, rights + lefts),
    )
    partner = cast("Numbers", min_weight_full_bipartite_matching(costs)[1])  # of lefts in order
    return np.flatnonzero(partner[i] == j)
