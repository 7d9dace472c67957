"""A robot that looks ahead: a string pulled tight through the discs to come, walked as it must be.

At each step the shortest tour leads through the present disc and those around the places where the
target is expected, as far as forecasts held so far. The robot walks along it, but no farther than
into the present disc: what it need not decide yet it decides later, knowing more. Where nothing can
be foretold this is the rule (4.11) itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trackfield.raster import Region
from trackfield.robot import forecast as robot_forecast
from trackfield.robot.forecast import Foresight, Memory
from trackfield.robot.optimum import shortest_tour
from trackfield.robot.rule import checked_track, least_move
from trackfield.types import Matrix, Vector

_GAP = 1e-3  # of the tour, to its bound: only its first leg is walked
_HALVINGS = 40


@dataclass(frozen=True, slots=True)
class Horizon:
    """How the robot looks ahead, and what it stakes on that.

    Forecasts count that erred by `tolerance` of the reach at most. Its way is never longer than the
    rule's and `stake` reaches. `region` is what is watched: the target need not be followed
    outside of it.
    """

    foresight: Foresight = field(default_factory=Foresight)
    tolerance: float = 0.8
    stake: float = 1.0
    region: Region | None = None


class Following(NamedTuple):
    """Where the robot is, (2,) [m], how far it went [m], the same of the rule, what was seen."""

    place: Vector
    way_m: float
    rule_place: Vector
    rule_way_m: float
    memory: Memory


class Advice(NamedTuple):
    """Where to go now, (2,) [m]; the tour (k, 2) through discs to come, k = 0 without foresight."""

    place: Vector
    ahead: Matrix


def begin(start: Vector) -> Following:
    """Begin at a place (2,) [m] with nothing seen."""
    place = np.asarray(start, np.float64)
    return Following(place, 0.0, place, 0.0, robot_forecast.NOTHING)


def step(
    state: Following, target: Vector, *, t_s: float, reach_m: float, horizon: Horizon
) -> tuple[Following, Advice]:
    """See the target at `target` (2,) [m], and say where to be within `reach_m` of it.

    The state that is returned has not moved yet: see `arrive`.
    """
    memory = robot_forecast.seen(state.memory, t_s, target)
    rule = least_move(state.rule_place, target, reach_m=reach_m)
    rule_way = state.rule_way_m + float(np.linalg.norm(rule - state.rule_place))
    state = Following(state.place, state.way_m, rule, rule_way, memory)
    place = state.place
    if np.linalg.norm(place - target) <= reach_m:
        return state, Advice(place, np.empty((0, 2)))
    ahead = _discs_ahead(memory, t_s, reach_m, horizon)
    if not len(ahead):
        wanted = least_move(place, target, reach_m=reach_m)
        return state, Advice(_within_stake(state, wanted, target, reach_m, horizon.stake), ahead)
    tour = shortest_tour(place, np.vstack([target, ahead]), radius_m=reach_m, gap=_GAP).path
    wanted = _first_inside(place, tour[0], target, reach_m)
    return state, Advice(_within_stake(state, wanted, target, reach_m, horizon.stake), tour)


def arrive(state: Following, place: Vector, *, way_m: float | None = None) -> Following:
    """Put the robot where it got to, by a straight way or one of `way_m` [m]."""
    walked = float(np.linalg.norm(place - state.place)) if way_m is None else way_m
    return state._replace(place=place, way_m=state.way_m + walked)


def horizon_path(
    start: Vector,
    targets: Matrix,
    *,
    t_s: Vector,
    reach_m: float | Vector,
    horizon: Horizon | None = None,
) -> Matrix:
    """Lead a robot from `start` (2,) that sees targets (n, 2) at `t_s` (n,), rising: (n, 2) [m]."""
    place, track = checked_track(start, targets)
    reach, state = np.broadcast_to(reach_m, len(track)), begin(place)
    path, settings = np.empty_like(track), horizon or Horizon()
    for k, (t, target) in enumerate(zip(t_s, track, strict=True)):
        state, advice = step(state, target, t_s=float(t), reach_m=float(reach[k]), horizon=settings)
        state = arrive(state, advice.place)
        path[k] = state.place
    return path


def _discs_ahead(memory: Memory, t_s: float, reach: float, horizon: Horizon) -> Matrix:
    """Where the target is expected, when that is in the region, (k, 2)."""
    tolerance = horizon.tolerance * reach
    ahead = robot_forecast.forecast(
        memory, t_s, tolerance_m=tolerance, foresight=horizon.foresight
    ).position
    return ahead if horizon.region is None else ahead[horizon.region.contains(ahead)]


def _first_inside(place: Vector, aim: Vector, target: Vector, reach: float) -> Vector:
    """First place in the disc on the way from outside to `aim` in it."""
    along, offset = aim - place, place - target
    a, b = along @ along, along @ offset
    root = np.sqrt(max(b * b - a * (offset @ offset - reach**2), 0.0))
    entry = place + min(1.0, max(0.0, (-b - root) / a)) * along
    return least_move(entry, target, reach_m=reach)


def _within_stake(
    state: Following, wanted: Vector, target: Vector, reach: float, stake: float
) -> Vector:
    """Go to `wanted`, or to what is nearest to it on the way to the rule's place and not too far.

    way + |M - M_rule| <= way of the rule + stake G holds ever: walking straight at the rule's place
    never breaks it, so that the robot could at any time end no farther behind the rule.
    """

    def over(place: Vector) -> float:
        gone = float(np.linalg.norm(place - state.place))
        back = float(np.linalg.norm(place - state.rule_place))
        return state.way_m + gone + back - state.rule_way_m - stake * reach

    if over(wanted) <= 0.0:
        return wanted
    safe = _first_inside(state.place, state.rule_place, target, reach)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (
            (middle, high) if over(safe + middle * (wanted - safe)) <= 0.0 else (low, middle)
        )
    return least_move(safe + low * (wanted - safe), target, reach_m=reach)
