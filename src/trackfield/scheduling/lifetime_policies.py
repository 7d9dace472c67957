"""Which set senses: the policies by name, and what each needs to know beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trackfield.errors import InputError
from trackfield.scheduling.cost import Price, energy_cost, inverse
from trackfield.scheduling.demand import by_flow, by_shares, expected, learned
from trackfield.scheduling.lifetime_candidates import Candidates, Need
from trackfield.types import Indices, Vector

POLICIES = ("geometry", "cost", "rank_sum", "demand", "flow", "learned")
_LAST = 1e-9  # sensings that are added, so that the last one has a finite cost


class Policy(Protocol):
    """What one sensing costs now: the accurate set with the least sum of prices senses."""

    def prices(self, residual: Vector, nodes: Indices) -> Vector | None:
        """Price (c,) of `nodes` (c,) that have `residual` (c,) sensings left; None: least trace."""
        ...

    def learn(self, passed: Candidates) -> Policy:
        """Policy after a pass that is over."""
        ...


@dataclass(frozen=True, slots=True)
class Geometry:
    """The set with the least trace, whatever energy its nodes have left."""

    def prices(self, residual: Vector, nodes: Indices) -> Vector | None:
        """None: the trace alone counts."""
        del residual, nodes

    def learn(self, passed: Candidates) -> Geometry:
        """Stay as it is."""
        del passed
        return self


@dataclass(frozen=True, slots=True)
class Cost:
    """The set with the least cost (5.1) at a price of energy; `by_rank`, the least sum of ranks."""

    price: Price
    by_rank: bool = False

    def prices(self, residual: Vector, nodes: Indices) -> Vector | None:
        """Cost (5.1), corrected, of one sensing; or ranks, of which equal sums go by cost."""
        del nodes
        # Nodes that have less than one sensing left are not to be had anyway.
        cost = energy_cost(np.maximum(residual, 1.0) + _LAST, 1.0, price=self.price)
        if not self.by_rank or not cost.size:
            return cost
        rank = np.empty(cost.size)
        rank[np.argsort(cost, kind="stable")] = np.arange(1.0, cost.size + 1.0)
        return rank + cost / (
            5.0 * max(float(cost.max()), _LAST)
        )  # four costs are less than a rank

    def learn(self, passed: Candidates) -> Cost:
        """Stay as it is."""
        del passed
        return self


def policy(
    name: str,
    *,
    need: Need,
    places: Candidates,
    forecast: Candidates | None = None,
    price: Price | None = None,
) -> Policy:
    """Make the policy of a name of `POLICIES`.

    "geometry": least trace. "cost": Pham (5.1) with any `price`, 1/t unless told. "rank_sum": the
    paper's search. "demand" and "flow": weights by the intervals of a `forecast`, see `demand`.
    "learned": like "flow", from past passes only; before the first, targets are believed equally
    likely at all `places`. Without a forecast, "demand" and "flow" take `places` for it.
    """
    given = places if forecast is None else forecast
    if name == "geometry":
        return Geometry()
    if name in ("cost", "rank_sum"):
        return Cost(price or inverse(), by_rank=name == "rank_sum")
    if name == "demand":
        return by_shares(expected(given, need=need))
    if name == "flow":
        return by_flow(expected(given, need=need))
    if name == "learned":
        return learned(places, need=need)
    raise InputError(f"policy: found {name!r}, expected one of {', '.join(POLICIES)}")
