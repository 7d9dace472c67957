"""How simulated targets come, move and go: truth, drawn from a scenario's parties."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError
from trackfield.raster import Region
from trackfield.simulation.deployment import middle_of
from trackfield.simulation.scenario import Party, Scenario, Span
from trackfield.types import Matrix, Truth, Vector

_TRIES = 1000  # to draw a target that stays long enough


class Life(NamedTuple):
    """One target: where it is (m, 2) [m] at its `first` step and those that follow.

    Who flees from pursuers does so by `evade_m_s2`, at `speed_m_s` of an axis at most. `level` is
    the amplitude at 1 m of the source that it is.
    """

    first: int
    path: Matrix
    evade_m_s2: float
    speed_m_s: float
    level: float


def truth_of(scenario: Scenario, rng: np.random.Generator) -> Truth:
    """Draw all targets: rows in order of time, then target; targets t1, t2, ... as they come.

    Times are those of the scans. `ConfigurationError` for a party whose targets hardly ever stay
    `least_s`.
    """
    lives = lives_of(scenario, rng)
    lengths = np.array([len(life.path) for life in lives], np.int64)
    target = np.repeat(np.arange(len(lives), dtype=np.int32), lengths)
    step = np.concatenate([life.first + np.arange(len(life.path)) for life in lives] or [target])
    position = np.full((target.size, 3), np.nan)
    if lives:
        position[:, :2] = np.concatenate([life.path for life in lives])
    order = np.lexsort((target, step))
    return Truth(
        t_s=scenario.step_s * step[order].astype(np.float64),
        target=target[order],
        position=position[order],
        target_ids=tuple(f"t{i + 1}" for i in range(len(lives))),
    )


def lives_of(scenario: Scenario, rng: np.random.Generator) -> list[Life]:
    """Draw all targets, in the order in which they come: those of `truth_of`."""
    lives = [
        life
        for number, party in enumerate(scenario.targets, start=1)
        for life in _lives(scenario, party, rng, f"targets[{number}]")
    ]
    return sorted(lives, key=lambda life: life.first)


def _lives(scenario: Scenario, party: Party, rng: np.random.Generator, where: str) -> list[Life]:
    born = int(rng.poisson(party.births_per_s * scenario.duration_s))
    enter_s = np.concatenate(
        [
            np.zeros(party.at_start),
            rng.uniform(*party.enter_s, party.count - party.at_start),
            rng.uniform(0.0, scenario.duration_s, born),
        ]
    )
    first = np.minimum(np.ceil(enter_s / scenario.step_s - 1e-9), scenario.steps - 1).astype(int)
    lives: list[Life] = []
    for place, step in enumerate(first.tolist()):
        left = scenario.steps - step
        least = min(party.least_s / scenario.step_s, left)
        for _ in range(_TRIES):
            path = _path(scenario, party, rng, (place, _lifetime(scenario, party, rng, left)))
            if len(path) >= max(least, 1):
                break
        else:
            raise ConfigurationError(
                [
                    f"{where}.least_s: found {party.least_s:g}, and no target of {_TRIES} that "
                    "stays so long, expected less, a longer life or slower targets"
                ]
            )
        lives.append(Life(step, path, party.evade_m_s2, party.speed_m_s[1], party.level))
    return lives


def _lifetime(scenario: Scenario, party: Party, rng: np.random.Generator, left: int) -> int:
    """Draw the steps that a target lives, at most those that are `left`, at least one."""
    if party.lifetime_s is not None:
        lifetime_s = rng.uniform(*party.lifetime_s)
    elif party.mean_lifetime_s is not None:
        lifetime_s = rng.exponential(party.mean_lifetime_s)
    else:
        return left
    return int(np.clip(round(lifetime_s / scenario.step_s), 1, left))


def _path(
    scenario: Scenario, party: Party, rng: np.random.Generator, which: tuple[int, int]
) -> Matrix:
    """Path (m, 2) [m] of target number `which[0]` of a party over `which[1]` steps or fewer."""
    place, steps = which
    region, times = scenario.area, scenario.step_s * np.arange(steps, dtype=np.float64)
    speed = rng.uniform(*party.speed_m_s)
    if party.motion == "random":
        inset = party.inset_m
        start = rng.uniform(np.add(region[:2], inset), np.subtract(region[2:], inset))
        path = start + times[:, None] * speed * _direction(rng.uniform(-np.pi, np.pi))
        moving = np.ones(steps, np.bool_)
    elif party.motion == "row":
        ahead = _direction(np.deg2rad(party.heading_deg))
        aside = np.array([ahead[1], -ahead[0]])
        middle = middle_of(region) if party.start is None else np.array(party.start)
        start = middle + (place - 0.5 * (party.count - 1)) * party.spacing_m * aside
        path = start + times[:, None] * speed * ahead
        moving = np.ones(steps, np.bool_)
    else:
        way = _way(party, rng, times, speed)
        corners = (
            _across(region, party, rng)
            if party.motion == "crossing"
            else _walk(region, party, rng, way[-1])
        )
        path = _along(corners, way)
        moving = np.append(np.diff(way) > 0.0, [False])[: len(path)]
    path = path + _driven(party.accel_sigma_m_s2, scenario.step_s, moving, rng)
    if party.border == "bounce":
        return _folded(path, region)
    outside = np.flatnonzero(~region.contains(path))
    return path[: outside[0]] if outside.size else path


def _driven(
    sigma: float, dt_s: float, moving: NDArray[np.bool_], rng: np.random.Generator
) -> Matrix:
    """Draw what accelerations N(0, sigma^2) add to a path (m, 2), from zero on: Oh (6) and (9).

    Steps in which the target does not move add nothing.
    """
    accel = sigma * rng.standard_normal((max(len(moving) - 1, 0), 2))
    before = dt_s * (np.cumsum(accel, axis=0) - accel)  # velocity when the step begins
    moves = (dt_s * before + 0.5 * dt_s**2 * accel) * moving[:-1, None]
    return np.concatenate([np.zeros((min(len(moving), 1), 2)), np.cumsum(moves, axis=0)])


def _way(party: Party, rng: np.random.Generator, times: Vector, speed: float) -> Vector:
    """Way (m,) [m] that a walker has gone by each time: it walks, stops, and walks again."""
    if party.go_s is None:
        return speed * times
    ends, way, walks = [0.0], [0.0], True
    while ends[-1] <= times[-1]:
        span: Span = party.go_s if walks else party.stop_s
        lasts = rng.uniform(*span)
        ends.append(ends[-1] + lasts)
        way.append(way[-1] + (speed * lasts if walks else 0.0))
        walks = not walks
    return np.interp(times, ends, way)


def _across(region: Region, party: Party, rng: np.random.Generator) -> Matrix:
    """Two corners (2, 2) [m]: where a straight line past the middle enters the region and leaves.

    It goes through a point that is uniform in the disc of `within_m` about the middle.
    """
    aside = _direction(rng.uniform(-np.pi, np.pi)) * party.within_m * np.sqrt(rng.random())
    through = np.clip(middle_of(region) + aside, region[:2], region[2:])
    ahead = _direction(rng.uniform(-np.pi, np.pi))
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.array([region[:2], region[2:]])
        reach = (walls - through) / ahead
    forward = np.where(ahead > 0.0, reach[1], np.where(ahead < 0.0, reach[0], np.inf)).min()
    backward = np.where(ahead > 0.0, reach[0], np.where(ahead < 0.0, reach[1], -np.inf)).max()
    ends = through + np.array([[backward], [forward]]) * ahead
    return np.clip(ends, region[:2], region[2:])  # on the border, in spite of rounding


def _walk(region: Region, party: Party, rng: np.random.Generator, length: float) -> Matrix:
    """Corners (k, 2) [m] of a walk: the path that is given, or random ones `length` long."""
    if party.path:
        return np.array(party.path)
    low, high = np.add(region[:2], party.inset_m), np.subtract(region[2:], party.inset_m)
    corners = [rng.uniform(low, high), rng.uniform(low, high)]
    gone = float(np.linalg.norm(corners[1] - corners[0]))
    while gone < length:
        corners.append(rng.uniform(low, high))
        gone += float(np.linalg.norm(corners[-1] - corners[-2]))
    return np.array(corners)


def _along(corners: Matrix, way: Vector) -> Matrix:
    """Points (m, 2) after the ways (n,) along a line of corners (k, 2); no point beyond its end."""
    marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    way = way[way <= marks[-1]]
    return np.column_stack([np.interp(way, marks, corners[:, axis]) for axis in (0, 1)])


def _folded(path: Matrix, region: Region) -> Matrix:
    """Path (m, 2) thrown back by the walls, as often as it takes."""
    low, size = np.array(region[:2]), np.subtract(region[2:], region[:2])
    way = np.mod(path - low, 2.0 * size)
    return low + np.minimum(way, 2.0 * size - way)


def _direction(heading: float) -> Vector:
    return np.array([np.cos(heading), np.sin(heading)])
