"""How long a network lasts that follows one target after another, with a policy of who senses."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _lifetime
from trackfield.errors import InputError
from trackfield.scheduling.lifetime_candidates import (
    Candidates,
    Need,
    candidates,
    cheapest,
    check_need,
)
from trackfield.scheduling.lifetime_policies import Policy, policy
from trackfield.types import Matrix, Vector

SERVED = 0.9
"""Share of a pass's intervals, and of the places once covered, below which a network is over."""
PLACES = 24  # a side, of the grid on which coverage is judged


class Field(NamedTuple):
    """Nodes that measure ranges: `sensors` (n, d) [m], how well, how far and how often each can.

    `sigma_m`, `reach_m` and `battery` (in sensings) are one number or (n,).
    """

    sensors: Matrix
    sigma_m: float | Vector
    reach_m: float | Vector
    battery: float | Vector


class Lifetime(NamedTuple):
    """How long a network lasted, in intervals from 1; None for what did not happen.

    `first_death`: a node's energy no longer suffices for one sensing. `service_lifetime`: the first
    interval of the first pass of which less than `SERVED` of the intervals had an accurate set.
    `coverage_lifetime`: the last interval of the first pass after which living nodes reach, k of
    them at a time, less than `SERVED` of the places that all nodes reached.

    `served`, `failed` and `geometric` count intervals; the latter are those of the failed that no
    fresh battery could have served. `residual` (n,) [sensings]. `history` (passes, 4): intervals
    served, living nodes, least and mean residual after each pass. `mean_trace_m2` of those served.
    """

    first_death: int | None
    service_lifetime: int | None
    coverage_lifetime: int | None
    served: int
    failed: int
    geometric: int
    residual: Vector
    history: Matrix
    mean_trace_m2: float


def lifetime(
    field: Field,
    passes: Matrix,
    *,
    need: Need,
    chosen_by: str | Policy = "learned",
    forecast: Matrix | None = None,
    progress: Callable[[float], None] | None = None,
) -> Lifetime:
    """Let targets pass (passes, intervals, d) [m] until all are over, k nodes sensing an interval.

    Each sensing takes 1 from a node's battery; an interval without an accurate set takes nothing.
    `chosen_by` is a name of `lifetime_policies.POLICIES` or an own policy; `forecast` (..., d) are
    places where targets are expected. `progress` is called with shares from 0 to 1. Memory is that
    of one pass.
    """
    paths, x = _paths(field, passes), _battery(field)
    places = _places(field)
    check_need(need)
    if isinstance(chosen_by, str):
        told = None if forecast is None else _candidates(field, forecast)
        by = policy(chosen_by, need=need, places=places, forecast=told)
    else:
        by = chosen_by
    covered = _covered(places, x >= 1.0, need.k)
    log = _Log(paths.shape[1])
    for number, path in enumerate(paths):
        here = _candidates(field, path)
        _run_pass(here, x, by, need=need, log=log)
        by = by.learn(here)
        still = int(_covered(places, x >= 1.0, need.k)[covered].sum())
        log.close(x, still < SERVED * int(covered.sum()))
        if progress is not None:
            progress((number + 1) / len(paths))
    return log.result(x)


class _Log:
    """What happens, counted as it happens."""

    def __init__(self, intervals: int) -> None:
        self.intervals = intervals
        self.now = 0
        self.first_death: int | None = None
        self.service: int | None = None
        self.coverage: int | None = None
        self.served = 0
        self.geometric = 0
        self.before = (0, 0)  # served and geometric at the last pass's end
        self.trace = 0.0
        self.history: list[tuple[float, float, float, float]] = []

    def close(self, x: Vector, uncovered: bool) -> None:
        """End a pass."""
        served, hopeless = self.served - self.before[0], self.geometric - self.before[1]
        self.before = (self.served, self.geometric)
        self.history.append((served, float((x >= 1.0).sum()), float(x.min()), float(x.mean())))
        if self.service is None and served < SERVED * (self.intervals - hopeless):
            self.service = self.now - self.intervals + 1
        if self.coverage is None and uncovered:
            self.coverage = self.now

    def result(self, x: Vector) -> Lifetime:
        mean = self.trace / self.served if self.served else 0.0
        return Lifetime(
            self.first_death,
            self.service,
            self.coverage,
            self.served,
            self.now - self.served,
            self.geometric,
            x,
            np.array(self.history).reshape(-1, 4),
            mean,
        )


def _run_pass(here: Candidates, x: Vector, by: Policy, *, need: Need, log: _Log) -> None:
    """Serve the intervals of a pass in their order; takes the energy from `x`."""
    hopeless = cheapest(here, np.ones(here.count), need=need).chosen[:, 0] < 0
    d = here.gains.shape[1]
    none = np.zeros((d, d))
    for t in range(len(here)):
        log.now += 1
        log.geometric += int(hopeless[t])
        a, b = int(here.offsets[t]), int(here.offsets[t + 1])
        nodes, gains = here.nodes[a:b], here.gains[a:b]
        left = x[nodes]
        one = np.array([0, b - a], np.int32), np.arange(b - a, dtype=np.int32), gains
        prices = by.prices(left, nodes)
        if prices is None:
            alive = np.where(left >= 1.0, 0.0, np.inf)
            chosen, value = _lifetime.sharpest(*one, alive, none, need.k)
            if value[0] > need.bound_m2:
                continue
        else:
            alive = np.where(left >= 1.0, prices, np.inf)
            chosen, _ = _lifetime.cheapest(*one, alive, none, need.bound_m2, need.k)
            if chosen[0, 0] < 0:
                continue
        members = chosen[0]
        information = gains[members].T @ gains[members]
        log.trace += float(np.trace(np.linalg.inv(information)))
        log.served += 1
        x[nodes[members]] -= 1.0
        if log.first_death is None and bool((left[members] < 2.0).any()):
            log.first_death = log.now


def _candidates(field: Field, positions: Matrix) -> Candidates:
    return candidates(field.sensors, positions, sigma_m=field.sigma_m, reach_m=field.reach_m)


def _places(field: Field) -> Candidates:
    """Candidates at places on a grid over the nodes' box (in space: at the nodes themselves)."""
    c = np.asarray(field.sensors, np.float64)
    if c.ndim != 2 or not len(c):
        raise InputError(f"sensors of shape {c.shape}, expected (n, d) with n > 0")
    if c.shape[1] != 2:
        return _candidates(field, c)
    low, high = c.min(axis=0), c.max(axis=0)
    steps = np.arange(PLACES) / (PLACES - 1.0)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1)
    return _candidates(field, low + grid * (high - low))


def _covered(places: Candidates, alive: NDArray[np.bool_], k: int) -> NDArray[np.bool_]:
    """Which places (m,) are within reach of k living nodes."""
    owner = np.repeat(np.arange(len(places)), np.diff(places.offsets))
    return np.bincount(owner, alive[places.nodes], minlength=len(places)) >= k


def _paths(field: Field, passes: Matrix) -> Matrix:
    paths, d = np.asarray(passes, np.float64), np.asarray(field.sensors).shape[-1]
    if paths.ndim != 3 or paths.shape[2] != d or not paths.size:
        raise InputError(f"passes of shape {paths.shape}, expected (passes, intervals, {d})")
    return paths


def _battery(field: Field) -> Vector:
    """Residual energies (n,) at the start, a copy."""
    n = len(np.asarray(field.sensors))
    x = np.array(np.broadcast_to(np.asarray(field.battery, np.float64), (n,)))
    wrong = x[~(np.isfinite(x) & (x >= 0.0))]
    if wrong.size:
        raise InputError(f"battery: found {wrong[0]} sensings, expected 0 or more")
    return x
