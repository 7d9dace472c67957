"""Prices by expected demand: how much the targets to come will need each node.

With weights w_i and residual energies x_i in sensings, the accurate set with the least sum of
w_i / (x_i - .99)^q senses. Weights are made of d_i, the share of accurate sets that hold node i,
and of l_i, the sensings of a plan that wears all nodes evenly, over intervals that are told or that
passed: d with q = 3; l^3 with q = 1, the best where much is told; l^2 d with q = 1, the best where
it must be learned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.scheduling.lifetime_candidates import (
    Candidates,
    Need,
    cheapest,
    join,
    shares,
    usage,
)
from trackfield.types import Indices, Vector

EDGE = 0.99
"""Below one sensing, which is the last that a node can do: its price is finite, but a wall."""
ROUNDS = 40  # of a plan
PRIOR_INTERVALS = 25.0  # that the belief before the first pass weighs as much as
MEMORY_PASSES = 120  # over which plans are made
AGAIN = 1.3  # a plan is made again when so many times the passes of the last one are over
_STEEP, _FLOOR = 4.0, 1e-4


class Expected(NamedTuple):
    """What is expected of each node (n,) an interval: `flow` l of an even plan, `share` d."""

    flow: Vector
    share: Vector


def need_shares(given: Candidates, *, need: Need) -> Vector:
    """Mean share d (n,) of accurate sets that hold a node, over intervals that have any."""
    found = shares(given, np.ones(given.count), need=need)
    total = np.bincount(given.nodes, found.share, minlength=given.count)
    return total / max(int((found.sets > 0.0).sum()), 1)


def planned_flow(given: Candidates, *, need: Need, rounds: int = ROUNDS) -> Vector:
    """Sensings an interval (n,) of a plan that wears all nodes evenly.

    Minimises sum l_i^5 over mixtures of accurate sets by the method of Frank and Wolfe: in every
    round all intervals go to the cheapest sets at prices l_i^4, and the plan steps towards that by
    2 / (2 + round).
    """
    flow = need_shares(given, need=need)
    for i in range(rounds):
        prices = (flow / max(float(flow.max()), _FLOOR)) ** _STEEP + 1e-9
        fresh = usage(given, cheapest(given, prices, need=need)) / max(len(given), 1)
        flow = flow + (fresh - flow) * 2.0 / (2.0 + i)
    return flow


def expected(given: Candidates, *, need: Need) -> Expected:
    """Plan over some intervals; `InputError` if there is none."""
    if not len(given):
        raise InputError("forecast: found no interval, expected at least one")
    return Expected(planned_flow(given, need=need), need_shares(given, need=need))


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Prices w_i / (x_i - .99)^q of nodes of weights `weight` (n,), `exponent` q."""

    weight: Vector
    exponent: float

    def prices(self, residual: Vector, nodes: Indices) -> Vector:
        """Price (c,) of one sensing of `nodes` (c,) with `residual` (c,) sensings left."""
        return self.weight[nodes] / np.maximum(residual - EDGE, 1.0 - EDGE) ** self.exponent

    def learn(self, passed: Candidates) -> Weights:
        """Stay as told."""
        del passed
        return self


def by_shares(forecast: Expected) -> Weights:
    """Weigh nodes by the share of accurate sets that hold them: d / (x - .99)^3."""
    return Weights(forecast.share + _FLOOR**2, 3.0)


def by_flow(forecast: Expected) -> Weights:
    """Weigh nodes by an even plan's flow: l^3 / (x - .99)."""
    return Weights(np.maximum(forecast.flow, _FLOOR) ** 3.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """Prices l^2 d / (x - .99) from passes that are over, planned again ever more rarely.

    `prior` is expected before the first pass, and worth `PRIOR_INTERVALS`; `passed` are the last
    `MEMORY_PASSES` of `count`; `now` was planned after `planned` passes.
    """

    need: Need
    prior: Expected
    now: Expected
    passed: tuple[Candidates, ...] = ()
    count: int = 0
    planned: int = 0

    def prices(self, residual: Vector, nodes: Indices) -> Vector:
        """Price (c,) of one sensing of `nodes` (c,) with `residual` (c,) sensings left."""
        flow, share = (np.maximum(part[nodes], _FLOOR) for part in self.now)
        return flow**2 * share / np.maximum(residual - EDGE, 1.0 - EDGE)

    def learn(self, passed: Candidates) -> Learned:
        """Take a pass that is over into account."""
        last, count = (*self.passed, passed)[-MEMORY_PASSES:], self.count + 1
        later = replace(self, passed=last, count=count)
        if count < AGAIN * self.planned or not len(passed):
            return later
        seen = join(last, passed.count)
        own = len(seen) / (len(seen) + PRIOR_INTERVALS)
        found = expected(seen, need=self.need)
        mixed = (own * new + (1.0 - own) * old for new, old in zip(found, self.prior, strict=True))
        return replace(later, now=Expected(*mixed), planned=count)


def learned(places: Candidates, *, need: Need) -> Learned:
    """Start to learn, from the belief that targets are equally likely at all `places`."""
    prior = expected(places, need=need)
    return Learned(need, prior, prior)
