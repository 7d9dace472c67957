"""Which nodes can measure a target in each interval, and the best sets of them, many at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield._core import _lifetime
from trackfield.errors import InputError
from trackfield.types import Indices, Matrix, Vector

_BLOCK = 2_000_000  # nodes times positions that are looked at in one go


class Need(NamedTuple):
    """What a set must do: k sensors whose snapshot has a trace of at most `bound_m2` [m^2]."""

    bound_m2: float
    k: int = 3


class Sets(NamedTuple):
    """One set an interval: its nodes (m, k), -1 where there is none, and its `value` (m,).

    The value is the sum of prices, or the trace [m^2]; infinite where there is no set.
    """

    chosen: Indices
    value: Vector


class Shares(NamedTuple):
    """How needed nodes are: `share` (e,) of its interval's accurate sets that hold an entry's node.

    `sets` (m,) counts the accurate sets of each interval.
    """

    share: Vector
    sets: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Nodes that can measure the target in each of m intervals, `count` nodes in all.

    Interval t has the entries `offsets[t]` to `offsets[t + 1]` (m + 1,) of `nodes` (e,) and `gains`
    (e, d) [1/m]: unit vectors over the standard deviation of a range.
    """

    offsets: Indices
    nodes: Indices
    gains: Matrix
    count: int

    def __len__(self) -> int:
        return self.offsets.size - 1

    def part(self, first: int, last: int) -> Candidates:
        """Intervals `first` to `last`, the latter not included; views where that is possible."""
        a, b = int(self.offsets[first]), int(self.offsets[last])
        offsets = self.offsets[first : last + 1] - self.offsets[first]
        return Candidates(offsets, self.nodes[a:b], self.gains[a:b], self.count)


def candidates(
    sensors: Matrix, positions: Matrix, *, sigma_m: float | Vector, reach_m: float | Vector
) -> Candidates:
    """Find the nodes within `reach_m` of each position (..., d), and the gains of their ranges.

    `sensors` (n, d) [m], d 2 or 3; `sigma_m` and `reach_m` one number or (n,). A node at the target
    itself says nothing and is left out. `InputError` for shapes and numbers that cannot be.
    """
    c, x = np.asarray(sensors, np.float64), np.asarray(positions, np.float64)
    if c.ndim != 2 or c.shape[1] not in (2, 3) or x.shape[-1:] != c.shape[1:]:
        raise InputError(
            f"sensors of {c.shape} and positions of {x.shape}: expected (n, d), (..., d)"
        )
    if not (np.isfinite(c).all() and np.isfinite(x).all()):
        raise InputError("sensors and positions: expected finite ones")
    sigma, reach = (_column(v, len(c), w) for v, w in ((sigma_m, "sigma_m"), (reach_m, "reach_m")))
    x = x.reshape(-1, c.shape[1])
    step = max(1, _BLOCK // max(len(c), 1))
    return join(
        [_near(c, x[at : at + step], sigma, reach) for at in range(0, len(x), step)], len(c)
    )


def join(parts: Sequence[Candidates], count: int) -> Candidates:
    """Put the intervals of all `parts` in a row; `count` nodes, where there is no part."""
    if not parts:
        empty = np.zeros(0, np.int32)
        return Candidates(np.zeros(1, np.int32), empty, np.zeros((0, 2)), count)
    starts = np.cumsum([0, *(part.nodes.size for part in parts[:-1])])
    pairs = zip(parts, starts, strict=True)
    offsets = np.concatenate([[0], *(part.offsets[1:] + start for part, start in pairs)])
    return Candidates(
        offsets.astype(np.int32),
        np.concatenate([part.nodes for part in parts]),
        np.concatenate([part.gains for part in parts]),
        count,
    )


def cheapest(given: Candidates, prices: Vector, *, need: Need) -> Sets:
    """Find the set of least price (n,) within the bound, in every interval, by branch and bound.

    Nodes of infinite price are not to be had.
    """
    return Sets(*_lifetime.cheapest(*_columns(given, prices), need.bound_m2, need.k))


def sharpest(given: Candidates, prices: Vector, *, need: Need) -> Sets:
    """Find the set of least trace, bound or not, among nodes whose price (n,) is finite."""
    return Sets(*_lifetime.sharpest(*_columns(given, prices), need.k))


def shares(given: Candidates, prices: Vector, *, need: Need) -> Shares:
    """Count in which share of each interval's accurate sets a node is, going through them all."""
    return Shares(*_lifetime.shares(*_columns(given, prices), need.bound_m2, need.k))


def usage(given: Candidates, found: Sets) -> Vector:
    """Count how often each node (n,) is in the sets."""
    return np.bincount(found.chosen[found.chosen >= 0], minlength=given.count).astype(np.float64)


def check_need(need: Need) -> Need:
    """Refuse a bound that is not positive, and sets that are not of 1 to 4 sensors."""
    if not need.bound_m2 > 0.0:
        raise InputError(f"bound_m2: found {need.bound_m2}, expected a positive trace")
    if need.k not in (1, 2, 3, 4):
        raise InputError(f"k: found {need.k}, expected sets of 1 to 4 sensors")
    return need


def _columns(given: Candidates, prices: Vector) -> tuple[Indices, Indices, Matrix, Vector, Matrix]:
    d = given.gains.shape[1]
    return given.offsets, given.nodes, given.gains, prices, np.zeros((d, d))


def _near(c: Matrix, x: Matrix, sigma: Vector, reach: Vector) -> Candidates:
    gaps = x[:, None] - c
    r = np.linalg.norm(gaps, axis=-1)
    t, i = np.nonzero((r <= reach) & (r > 0.0))
    offsets = np.searchsorted(t, np.arange(len(x) + 1))
    gains = gaps[t, i] / (r[t, i] * sigma[i])[:, None]
    return Candidates(offsets.astype(np.int32), i.astype(np.int32), gains, len(c))


def _column(values: float | Vector, n: int, what: str) -> Vector:
    column = np.broadcast_to(np.asarray(values, np.float64), (n,))
    wrong = column[~(np.isfinite(column) & (column > 0.0))]
    if wrong.size:
        raise InputError(f"{what}: found {wrong[0]}, expected positive numbers")
    return column
