"""What nobody can do better, knowing all passes beforehand: linear programs over accurate sets.

Every interval may mix its accurate sets; the load of a node may not exceed its battery. There are
thousands of sets an interval, so the programs hold a few and ask for cheaper ones at their prices
(column generation). Any prices prove a bound, the program's own the best one.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog  # pyright: ignore[reportUnknownVariableType]  it has no types
from scipy.sparse import csr_array

from trackfield._core import _lifetime
from trackfield.errors import InputError
from trackfield.scheduling.lifetime_candidates import (
    Candidates,
    Need,
    cheapest,
    check_need,
    usage,
)
from trackfield.types import Indices, Vector

Columns = NDArray[np.int64]  # rows (interval, nodes of a set)
GAP = 1e-3  # between a program and its bound, at which no more sets are sought
_SWEEPS, _ROUNDS = 4, 12  # that make the first sets
_SLACK = 1e-9  # of a price, for rounding


class DeathBound(NamedTuple):
    """No policy's first death comes after `interval`, from 1; None if nobody need die at all.

    `prices` (n,) prove it: up to that interval even the cheapest sets cost more than all batteries.
    `gap` is how much the bound may be too high, relative.
    """

    interval: int | None
    prices: Vector
    gap: float


class ServiceBound(NamedTuple):
    """No policy fails in fewer than `failed` intervals; `prices` (n,), `gap` as in `DeathBound`."""

    failed: int
    prices: Vector
    gap: float


class _Program(NamedTuple):
    """A solved program: its value, the prices of nodes, and the value that these prices prove."""

    value: float
    prices: Vector
    proven: float


def first_death_bound(
    given: Candidates, battery: Vector, *, need: Need, rounds: int = 4
) -> DeathBound:
    """Bound the first death: intervals 1..T need nodes that all stay alive, and T <= bound - 1.

    A node is alive while its energy suffices for one more sensing, so each can give `battery` - 1
    (n,) [sensings]. Intervals without any accurate set are passed over. At most `rounds` programs.
    """
    capacity = _capacity(given, battery, spare=1.0)
    check_need(need)
    even = np.ones(given.count)
    could = cheapest(given, _bought(even, _capacity(given, battery, spare=0.0)), need=need)
    can = cheapest(given, _bought(even, capacity), need=need)
    lethal = np.flatnonzero((could.chosen[:, 0] >= 0) & (can.chosen[:, 0] < 0))
    stop = int(lethal[0]) if lethal.size else len(given)
    bound = _death_bound(given.part(0, stop), capacity, need=need, rounds=rounds)
    if bound.interval is None and lethal.size:
        return bound._replace(interval=stop + 1)
    return bound


def service_bound(
    given: Candidates, battery: Vector, *, need: Need, rounds: int = 4
) -> ServiceBound:
    """Bound the least number of failed intervals, batteries (n,) [sensings] used to the end."""
    capacity = _capacity(given, battery, spare=0.0)
    check_need(need)
    if not len(given) or not capacity.any():
        return ServiceBound(len(given), np.ones(given.count), 0.0)
    columns = _first_columns(given, capacity, need)
    most, prices, gap = float(len(given)), np.zeros(given.count), 1.0
    for _ in range(rounds):
        solved = _serve(columns, len(given), capacity)
        fresh = cheapest(given, _bought(solved.prices, capacity), need=need)
        profit = np.maximum(1.0 - fresh.value, 0.0).sum() + float(capacity @ solved.prices)
        if profit < most:
            most, prices = float(profit), solved.prices
        gap = most / max(solved.value, 1.0) - 1.0
        if gap <= GAP:
            break
        columns = _joined(columns, fresh.chosen)
    return ServiceBound(len(given) - int(np.floor(most + 1e-6)), prices, max(gap, 0.0))


def _death_bound(given: Candidates, capacity: Vector, *, need: Need, rounds: int) -> DeathBound:
    """Bound the first death where every interval has an accurate set of spare energy, or none."""
    prices, gap = np.ones(given.count), 0.0
    columns = _first_columns(given, capacity, need)
    last, best = len(given), len(given) + 1
    for _ in range(rounds):
        rows = columns[columns[:, 0] < last]
        if not len(rows):
            break
        solved = _stretch(given.part(0, last), rows, capacity, need)
        fresh = cheapest(given, _bought(solved.prices, capacity), need=need)
        cost = np.where(fresh.chosen[:, 0] >= 0, fresh.value, 0.0)
        end = _first_over(cost, float(capacity @ solved.prices))
        if end < best:
            best, prices = end, solved.prices
        gap = max(1.0 - solved.proven / solved.value, 0.0)
        fits = solved.value <= 1.0 and last == len(given)
        if fits or (gap <= GAP and abs(end - 1 - last) <= max(GAP * last, 1.0)):
            break
        columns = _joined(columns, fresh.chosen)
        last = int(np.clip(end - 1, 1, len(given)))
    return DeathBound(best if best <= len(given) else None, prices, gap)


def _capacity(given: Candidates, battery: Vector, *, spare: float) -> Vector:
    """Whole sensings (n,) that nodes can give and keep `spare`."""
    x = np.broadcast_to(np.asarray(battery, np.float64), (given.count,))
    wrong = x[~(np.isfinite(x) & (x >= 0.0))]
    if wrong.size:
        raise InputError(f"battery: found {wrong[0]} sensings, expected 0 or more")
    return np.maximum(np.floor(x) - spare, 0.0)


def _bought(prices: Vector, capacity: Vector) -> Vector:
    return np.where(capacity > 0.0, prices, np.inf)


def _first_over(cost: Vector, budget: float) -> int:
    """Find the interval, from 1, by whose end costs exceed a budget; past the last if never."""
    over = np.flatnonzero(np.cumsum(cost) > budget * (1.0 + _SLACK) + _SLACK)
    return int(over[0]) + 1 if over.size else cost.size + 1


def _first_columns(given: Candidates, capacity: Vector, need: Need) -> Columns:
    """Make the first sets, rows (interval, nodes): of even plans, whole and in mixtures."""
    d, k = given.gains.shape[1], need.k
    columns: Columns = np.zeros((0, k + 1), np.int64)
    for steepness in (4.0, 12.0):
        sweeps = _lifetime.balance(
            given.offsets, given.nodes, given.gains, capacity, np.zeros((d, d)),
            need.bound_m2, k, steepness, _SWEEPS,
        )  # fmt: skip
        for chosen in sweeps.reshape(_SWEEPS, len(given), k):
            columns = _joined(columns, chosen)
    load = np.zeros(given.count)
    for i in range(_ROUNDS):
        wear = load / np.maximum(capacity, 1.0)
        prices = (wear / max(float(wear.max()), _SLACK)) ** 8 + 1e-9 if i else np.ones(given.count)
        found = cheapest(given, _bought(prices, capacity), need=need)
        load += (usage(given, found) - load) * 2.0 / (2.0 + i)
        columns = _joined(columns, found.chosen)
    return columns


def _joined(columns: Columns, chosen: Indices) -> Columns:
    """Add each interval's set to the columns that are there, once."""
    have = np.flatnonzero(chosen[:, 0] >= 0)
    fresh = np.column_stack([have, np.sort(chosen[have], axis=1)]).astype(np.int64)
    return np.unique(np.concatenate([columns, fresh]), axis=0)


def _stretch(given: Candidates, columns: Columns, capacity: Vector, need: Need) -> _Program:
    """Serve all intervals with the least stretch of batteries: least s with loads <= s capacity."""
    n, m = capacity.size, len(columns)
    intervals, row = np.unique(columns[:, 0], return_inverse=True)
    served = csr_array((np.ones(m), (row.reshape(-1), np.arange(m))), shape=(intervals.size, m + 1))
    nodes, at = _worn(columns)
    entries = np.concatenate([np.ones(nodes.size), -capacity])
    where = np.concatenate([nodes, np.arange(n)]), np.concatenate([at, np.full(n, m)])
    goal = np.zeros(m + 1)
    goal[-1] = 1.0
    rows = {
        "A_ub": csr_array((entries, where), shape=(n, m + 1)),
        "b_ub": np.zeros(n),
        "A_eq": served,
        "b_eq": np.ones(intervals.size),
    }
    value, prices = _solve(goal, rows)
    cost = cheapest(given, _bought(prices, capacity), need=need).value
    budget = max(float(capacity @ prices), _SLACK)
    return _Program(value, prices, float(cost[np.isfinite(cost)].sum()) / budget)


def _serve(columns: Columns, intervals: int, capacity: Vector) -> _Program:
    """Serve as many intervals as the batteries allow, each at most once."""
    n, m = capacity.size, len(columns)
    nodes, at = _worn(columns)
    where = np.concatenate([nodes, n + columns[:, 0]]), np.concatenate([at, np.arange(m)])
    rows = {
        "A_ub": csr_array((np.ones(at.size + m), where), shape=(n + intervals, m)),
        "b_ub": np.concatenate([capacity, np.ones(intervals)]),
    }
    value, prices = _solve(-np.ones(m), rows)
    return _Program(-value, prices[:n], 0.0)


def _worn(columns: Columns) -> tuple[Columns, Columns]:
    """Say which node is worn by which column: two rows of numbers."""
    m, k = len(columns), columns.shape[1] - 1
    return columns[:, 1:].reshape(-1), np.repeat(np.arange(m), k)


def _solve(goal: Vector, rows: dict[str, Any]) -> tuple[float, Vector]:
    """Find the least value of a program, and the prices of its upper bounds."""
    found = cast("Any", linprog(goal, bounds=(0.0, None), method="highs-ipm", **rows))
    if found.status != 0:
        raise InputError(f"linear program: {found.message}")
    return float(found.fun), np.maximum(-np.asarray(found.ineqlin.marginals, np.float64), 0.0)
