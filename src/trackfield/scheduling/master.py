"""Which node runs the filter, when it hands over, and what travels: Pham 2.4 and 5.3.1.

A master spends more than its neighbours and is left behind by the target, so the role wanders. Each
hand-over is a message and, if the filter's state is not in it, a track that begins anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackfield.errors import InputError
from trackfield.network.topology import UNREACHED
from trackfield.types import Gaussian, Indices, Matrix, Vector

NOBODY = -1
CUT_OFF = 2.0  # relative cost of a node that reaches no sink, where others cost 1 at most
_NUMBER_BITS, _HEAD_BITS = 32, 64  # of a state on its way: a number, and who and when


class Choice(NamedTuple):
    """Who is master after a step: `node`, and before: `previous`, `NOBODY` where there is none.

    `forced` says that the previous one could not stay; `cost` is that of `node`, infinite without.
    """

    node: int
    previous: int
    forced: bool
    cost: float

    @property
    def handed_over(self) -> bool:
        """Whether the role went from one node to another."""
        return NOBODY not in (self.node, self.previous) and self.node != self.previous


@dataclass(frozen=True, slots=True)
class Bells:
    """Where a master should stand, w_x w_y of Pham (5.5): ahead of the target, about its line.

    Along the heading w_x is 1 at `lead_m` ahead of the target and falls like a Cauchy density of
    half width `ahead_m` beyond it, heavy-tailed, so that whoever the target comes to may take over
    early; before it and across, w_x and w_y are Gaussian with `behind_m` and `across_m`. Pham
    draws these shapes and gives no formula.
    """

    lead_m: float = 0.0
    ahead_m: float = 1.0
    behind_m: float = 0.5
    across_m: float = 0.5

    def __post_init__(self) -> None:
        if not (self.lead_m >= 0.0 and min(self.ahead_m, self.behind_m, self.across_m) > 0.0):
            raise InputError(f"found {self}, expected lengths above 0 and a lead of 0 or more")


def costs(distance: ArrayLike, residual: ArrayLike, *, alpha: float) -> Vector:
    """W = alpha D + (1 - alpha) (1 - residual), the less the better, Pham 2.4.

    `distance` (...) to the target over what is far, `residual` (...) energy over a full battery,
    both from 0 to 1.
    """
    D, left = np.asarray(distance, np.float64), np.asarray(residual, np.float64)
    return _weighed(alpha, D, 1.0 - left)


def costs_ahead(relative_cost: ArrayLike, fitness: ArrayLike, *, alpha: float) -> Vector:
    """W = alpha rho + (1 - alpha) (1 - w_master), minimised; Pham (5.6), corrected.

    `relative_cost` (...) as of `relative_costs`, `fitness` (...) of the place as of `fitness`.
    """
    rho, w = np.asarray(relative_cost, np.float64), np.asarray(fitness, np.float64)
    return _weighed(alpha, rho, 1.0 - w)


def fitness(bells: Bells, nodes: Matrix, *, target: Vector, heading: Vector) -> Vector:
    """w_master = w_x w_y (n,) in [0, 1] of the nodes' places (n, 2) [m], Pham (5.5).

    `heading` (2,) of any length; where there is none (zero), the place counts by its distance in
    all directions alike, with `across_m`.
    """
    offset = np.asarray(nodes, np.float64)[:, :2] - target[:2]
    speed = math.hypot(heading[0], heading[1])
    if speed == 0.0:
        return np.exp(-0.5 * np.sum(offset**2, axis=1) / bells.across_m**2)
    along, side = heading[:2] / speed, np.array([-heading[1], heading[0]]) / speed
    beyond = offset @ along - bells.lead_m
    tail = 1.0 / (1.0 + (beyond / bells.ahead_m) ** 2)
    w_x = np.where(beyond >= 0.0, tail, np.exp(-0.5 * (beyond / bells.behind_m) ** 2))
    return w_x * np.exp(-0.5 * (offset @ side / bells.across_m) ** 2)


def relative_costs(mastership: ArrayLike, hops: Indices, *, per_hop: float) -> Vector:
    """Compute rho (n,): what a master and its reports cost, over the most expensive, Pham 5.3.1.

    `mastership` (n,) is what an interval as master costs each node, e.g. (5.1), infinite for who
    cannot afford one; `per_hop` what a hop of its report to the sink costs; both in one unit. Nodes
    with `hops` (n,) of -1 reach no sink and cost `CUT_OFF`, more than any that does.
    """
    reached = np.asarray(hops) != UNREACHED
    total = np.asarray(mastership, np.float64) + per_hop * np.maximum(hops, 0)
    if not (total >= 0.0).all():
        raise InputError("found costs below 0 or without a number, expected 0 or more")
    most = total[reached & np.isfinite(total)].max(initial=0.0)
    rho = np.where(reached, total / most if most > 0.0 else 0.0, CUT_OFF)
    return np.where(np.isfinite(total), rho, np.inf)


def choose(
    cost: Vector,
    current: int = NOBODY,
    *,
    able: NDArray[np.bool_] | None = None,
    may_stay: bool = True,
    margin: float = 0.0,
) -> Choice:
    """Hand over iff somebody's cost is less than the master's by more than `margin`.

    `cost` (n,) of all nodes, of which those that are `able` (n,) may become master: awake, not
    exhausted, and within a hop of who senses. A master that may not stay, because the target has
    left its reach or its battery is empty, goes to the best of them at any cost, and nobody is
    master where none is able. Without margin this is Pham 2.4, where the role wanders with every
    cycle that the master spends: what a margin saves is hand-overs.
    """
    if not margin >= 0.0:
        raise InputError(f"margin: found {margin}, expected 0 or more")
    open_to = np.where(
        np.isfinite(cost) if able is None else able & np.isfinite(cost), cost, np.inf
    )
    best = int(np.argmin(open_to)) if open_to.size else NOBODY
    stays = current != NOBODY and may_stay and bool(np.isfinite(cost[current]))
    if best == NOBODY or not np.isfinite(open_to[best]):
        node = current if stays else NOBODY
    elif stays and not open_to[best] < cost[current] - margin:
        node = current
    else:
        node = best
    forced = current != NOBODY and not stays
    return Choice(node, current, forced, math.inf if node == NOBODY else float(cost[node]))


def belief_after(choice: Choice, belief: Gaussian, *, shared: bool, start: Gaussian) -> Gaussian:
    """Give the master of a step the belief of the one before, if that was `shared`.

    Otherwise a new master begins with `start`, Pham's scenario 5.
    """
    return start if choice.handed_over and not shared else belief


def state_bits(states: int) -> int:
    """Bits of a filter's state on its way: mean and half of the covariance in 32 bit, and a head.

    A state [x, y, vx, vy] comes to 512.
    """
    return _HEAD_BITS + _NUMBER_BITS * (states + states * (states + 1) // 2)


def _weighed(alpha: float, one: Vector, other: Vector) -> Vector:
    if not 0.0 <= alpha <= 1.0:
        raise InputError(f"alpha: found {alpha}, expected a weight from 0 to 1")
    return np.asarray(alpha * one + (1.0 - alpha) * other, np.float64)
