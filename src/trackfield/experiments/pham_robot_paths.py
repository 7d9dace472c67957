"""Pham, chapter 4: how long the robot's way is against the shortest there is, and the rule's."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.raster import Region
from trackfield.robot.horizon import Horizon, horizon_path
from trackfield.robot.optimum import shortest_tour
from trackfield.robot.rule import Link, path_length, rule_path
from trackfield.types import Matrix

FIELD = Region(0.0, 0.0, 10.0, 10.0)
SENSING_M = 1.4
RANGES_M = (2.0, 2.5, 4.0, 6.0)
NOISES_M = (0.0, 0.02, 0.1)
KINDS = ("straight", "waypoints", "turns", "walk")
_STEP_M = 0.2


class Ratios(NamedTuple):
    """Lengths over that of the shortest tour, a row a run (n,): the rule's, and with foresight.

    The tour knows the whole track from the start; all three see it with the noise or not.
    """

    noise_m: float
    range_m: float
    rule: Matrix
    ahead: Matrix


class Wandering(NamedTuple):
    """Length with foresight over that of the rule on paths of a kind without a period, (n,)."""

    kind: str
    ratio: Matrix


def sinusoid(steps: int, periods: float, amplitude: float, phase: float) -> Matrix:
    """Track (steps + 1, 2) [m] across the field from x = 0 to 10, about y = 5."""
    share = np.linspace(0.0, 1.0, steps + 1)
    wave = amplitude * np.sin(2.0 * np.pi * periods * share + phase)
    return np.column_stack([10.0 * share, 5.0 + wave])


def on_sinusoids(rng: np.random.Generator, *, runs: int) -> list[Ratios]:
    """Draw `runs` sinusoids of 1.5 to 4 periods, amplitudes of 1 to 4 m, any phase; see them noisy.

    The robot begins at the target and is within reach of each place that it is told.
    """
    periods = rng.uniform(1.5, 4.0, runs)
    steps = (periods * rng.uniform(24.0, 40.0, runs)).astype(int)
    shape = zip(steps, periods, rng.uniform(1.0, 4.0, runs), strict=True)
    tracks = [sinusoid(int(n), p, a, float(rng.uniform(0.0, 2.0 * np.pi))) for n, p, a in shape]
    found: list[Ratios] = []
    for noise in NOISES_M:
        seen = [track + noise * rng.standard_normal(track.shape) for track in tracks]
        for comm in RANGES_M:
            pairs = zip(tracks, seen, strict=True)
            rows = np.array([_ratios(*pair, Link(comm, SENSING_M).reach_m) for pair in pairs])
            found.append(Ratios(noise, comm, rows[:, 0], rows[:, 1]))
    return found


def without_period(rng: np.random.Generator, *, runs: int) -> list[Wandering]:
    """Draw `runs` paths of each kind, seen exactly, at reaches of .6, 1.1 and 2.6 m by turns."""
    found: list[Wandering] = []
    for kind in KINDS:
        ratios: list[float] = []
        for k in range(runs):
            track, reach = wander(rng, kind, 120), (0.6, 1.1, 2.6)[k % 3]
            rule = path_length(track[0], rule_path(track[0], track, reach_m=reach))
            ahead = _led(track, track, reach)
            ratios.append(ahead / rule if rule > 0.0 else 1.0)
        found.append(Wandering(kind, np.array(ratios)))
    return found


def wander(rng: np.random.Generator, kind: str, steps: int) -> Matrix:
    """Walk from the middle of the field without a period, .2 m a step; (steps + 1, 2) [m].

    Straight on; to random places of the field; turning at random rates for random times; anywhere.
    """
    if kind == "straight":
        heading = np.full(steps, rng.uniform(0.0, 2.0 * np.pi))
    elif kind == "waypoints":
        heading = _headings_to_places(rng, steps)
    elif kind == "turns":
        switch = rng.random(steps) < 0.05
        rates = np.where(rng.random(steps) < 0.5, 0.0, rng.uniform(-0.3, 0.3, steps))
        latest = np.maximum.accumulate(np.where(switch, np.arange(steps), 0))
        heading = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(rates[latest])
    else:
        heading = rng.uniform(0.0, 2.0 * np.pi, steps)
    walked = _STEP_M * np.column_stack([np.cos(heading), np.sin(heading)])
    return 5.0 + np.vstack([np.zeros(2), np.cumsum(walked, axis=0)])


def _headings_to_places(rng: np.random.Generator, steps: int) -> Matrix:
    place, goal, headings = np.full(2, 5.0), rng.uniform(0.0, 10.0, 2), np.empty(steps)
    for k in range(steps):
        while np.linalg.norm(goal - place) < _STEP_M:
            goal = rng.uniform(0.0, 10.0, 2)
        headings[k] = np.arctan2(goal[1] - place[1], goal[0] - place[0])
        place = place + _STEP_M * np.array([np.cos(headings[k]), np.sin(headings[k])])
    return headings


def _led(track: Matrix, seen: Matrix, reach: float) -> float:
    """Length with foresight, the robot starting at the target."""
    t_s = np.arange(float(len(seen)))
    horizon = Horizon(region=FIELD)
    path = horizon_path(track[0], seen, t_s=t_s, reach_m=reach, horizon=horizon)
    return path_length(track[0], path)


def _ratios(track: Matrix, seen: Matrix, reach: float) -> tuple[float, float]:
    best = shortest_tour(track[0], track, radius_m=reach).bound_m
    rule = path_length(track[0], rule_path(track[0], seen, reach_m=reach))
    return rule / best, _led(track, seen, reach) / best
