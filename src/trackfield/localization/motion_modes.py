"""All states that readings of angles and motion leave possible, with weights and a verdict."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from trackfield.localization.motion_readings import BEARING, MotionReadings, doubt
from trackfield.localization.motion_search import Extent, Found, MotionSearch, forward
from trackfield.types import Matrix, Vector

AMBIGUOUS = math.log(100.0)  # a second state counts down to 1 % of the best one's likelihood
KEPT = 12.0  # nats by which a state may be less likely than the best and be returned
MOST = 64  # states returned
_SAME = 1e-5  # of the extent and speed, or a tenth of a standard deviation: one state
_NOISE, _MISFIT = 1e-2, 1e-6  # probability of a test's verdict where it does not hold


class Verdict(Enum):
    """What the readings say of a target's state; the value is the sentence to show."""

    UNIQUE = "The readings fix the state."
    EITHER_WAY = (
        "The readings fix the place and the line of motion, but not which way along it the target "
        "goes."
    )
    SEVERAL = "Several states explain the readings about equally well."
    UNDETERMINED = "The readings leave a direction of the state free."
    AT_REST = "The readings are no more than noise, as of a target at rest, which may be anywhere."
    UNEXPLAINED = "No state with a constant velocity explains the readings."
    TOO_FEW = "There are fewer readings, or places of sensors, than a state needs."


class MotionMode(NamedTuple):
    """A state (2 d,), position [m] and velocity [m/s], with its Cramer-Rao covariance.

    `cost` is half the squared misfit in standard deviations, `weight` the share of the likelihood
    among the states returned. Not `determined`: some direction is not fixed by the readings.
    """

    state: Vector
    covariance: Matrix
    cost: float
    weight: float
    determined: bool


class MotionFit(NamedTuple):
    """States at `t_s` that explain readings, the most likely first, and what to think of them.

    Where only the sizes of one moment's motions are known, each state is followed by the one with
    the opposite velocity. Only with the verdict `UNIQUE` is the first one an answer by itself.
    """

    t_s: float
    modes: tuple[MotionMode, ...]
    verdict: Verdict


def nothing(t_s: float, verdict: Verdict) -> MotionFit:
    """Return no state at all, and why."""
    return MotionFit(t_s, (), verdict)


def at_rest(given: MotionReadings) -> bool:
    """Whether rates and sizes of motion are as small as noise alone makes them in 99 % of cases."""
    moved = given.kind != BEARING
    if not moved.any():
        return False
    told = np.sum((given.value[moved] / given.sigma[moved]) ** 2)
    return bool(told <= chdtri(float(np.sum(moved)), _NOISE))


def fit_of(
    given: MotionReadings, found: Found, where: Extent, *, search: MotionSearch, t_s: float
) -> MotionFit:
    """Sort out the ends `found` of searches on `given`, whose times count from the ends' time.

    The states returned are those `t_s` later.
    """
    states, costs = _distinct(given, found, where, search)
    if not len(states):
        return nothing(t_s, Verdict.UNEXPLAINED)
    covariance, determined = doubt(given, states, extent_m=where.half_m)
    verdict = _verdict(given, costs, alone=bool(determined[0]))
    if given.reversible:
        d = given.dimensions
        flip = np.concatenate([np.ones(d), -np.ones(d)])
        states = np.repeat(states, 2, axis=0) * np.tile([np.ones(2 * d), flip], (len(states), 1))
        costs, determined = np.repeat(costs, 2), np.repeat(determined, 2)
        covariance = np.repeat(covariance, 2, axis=0)
        covariance[1::2] *= np.outer(flip, flip)
    weights = np.exp(costs[0] - costs)
    weights /= weights.sum()
    F = _carry(given.dimensions, t_s)
    modes = tuple(
        MotionMode(F @ x, F @ P @ F.T, float(cost), float(weight), bool(sure))
        for x, P, cost, weight, sure in zip(
            states, covariance, costs, weights, determined, strict=True
        )
    )
    return MotionFit(t_s, modes, verdict)


def _distinct(
    given: MotionReadings, found: Found, where: Extent, search: MotionSearch
) -> tuple[Matrix, Vector]:
    """States (k, 2 d) and costs (k,) of the maxima that count, each once."""
    d = given.dimensions
    state, cost, _ = found
    if given.reversible:  # the other of each pair follows later
        state = forward(state)
    speed = np.linalg.norm(state[:, d:], axis=1)
    away = np.linalg.norm(state[:, :d] - where.centre, axis=1)
    good = found.converged & (away <= where.reach_m) & (speed <= search.max_speed_m_s)
    state, cost, speed = state[good], cost[good], speed[good]
    near = cost <= cost.min(initial=math.inf) + KEPT
    state, cost, speed = state[near], cost[near], speed[near]
    kept: list[int] = []
    for i in range(len(state)):
        unit = np.repeat([_SAME * where.half_m, _SAME * (speed[i] + 1e-9)], d)
        apart = np.abs(state[kept] - state[i]) > unit
        if apart.any(axis=1).all():
            kept.append(i)
        if len(kept) == MOST:
            break
    return state[kept], cost[kept]


def _verdict(given: MotionReadings, costs: Vector, *, alone: bool) -> Verdict:
    spare = given.value.size - 2 * given.dimensions
    rivals = int(np.sum(costs < costs[0] + AMBIGUOUS))
    if at_rest(given):
        return Verdict.AT_REST
    if spare > 0 and 2.0 * costs[0] > chdtri(float(spare), _MISFIT):
        return Verdict.UNEXPLAINED
    if not alone:
        return Verdict.UNDETERMINED
    if rivals > 1:
        return Verdict.SEVERAL
    return Verdict.EITHER_WAY if given.reversible else Verdict.UNIQUE


def _carry(d: int, t_s: float) -> Matrix:
    """Matrix (2 d, 2 d) that carries a state `t_s` on."""
    F = np.eye(2 * d)
    F[:d, d:] = t_s * np.eye(d)
    return F


def enough(given: MotionReadings) -> bool:
    """Whether there are as many readings as unknowns, from two places at least."""
    places = len(np.unique(given.sensors, axis=0))
    distinct = given.value.size
    if np.ptp(given.t_s) == 0.0:  # a sensor says the same thing but once
        rows = np.column_stack([given.sensors, given.velocities, given.kind, given.falloff])
        distinct = len(np.unique(rows, axis=0))
    return places >= 2 and distinct >= 2 * given.dimensions
