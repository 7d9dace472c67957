"""Targets that cross Pham's field: along sinusoids, as the filter thinks they move, or turning.

One interval is 1 s; a path has as many points as a pass has intervals.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackfield.types import Matrix

SIDE_M = 10.0
SPEED_M_S = 0.4
INTERVALS = 25
SIGMA_M = 0.1
_START_M = 0.2  # from the border
_DRAWN = 256  # paths at a time, of which those are kept that stay in the field

Draw = Callable[[np.random.Generator, int], Matrix]


def sinusoids(rng: np.random.Generator, count: int) -> Matrix:
    """Paths (count, 25, 2) from any side straight across, y = y0 + A sin(2 pi x/10 + phase).

    A is .5 to 1.5, y0 such that the path stays in the field: accelerations up to .95 sigma/s^2.
    """
    amplitude = rng.uniform(0.5, 1.5, (count, 1))
    phase = rng.uniform(0.0, 2.0 * np.pi, (count, 1))
    margin = amplitude + _START_M
    middle = margin + (SIDE_M - 2.0 * margin) * rng.random((count, 1))
    x = _START_M + SPEED_M_S * np.arange(INTERVALS) + np.zeros((count, 1))
    y = middle + amplitude * np.sin(2.0 * np.pi * x / SIDE_M + phase)
    return _turned(np.stack([x, y], axis=-1), rng)


def wandering(agility: float) -> Draw:
    """Paths of white acceleration, `agility` sigma/s^2 an axis: the filter's own model.

    Those are drawn that stay in the field, which are the slower ones: .33 a second on the average.
    """

    def steps(rng: np.random.Generator) -> Matrix:
        velocity = np.zeros((_DRAWN, INTERVALS, 2))
        velocity[..., 0] = SPEED_M_S
        push = agility * SIGMA_M * rng.standard_normal(velocity.shape)
        velocity[:, 1:] += np.cumsum(push[:, :-1], axis=1)
        return velocity + 0.5 * push

    return lambda rng, count: _kept(rng, count, steps)


def turning(rng: np.random.Generator, count: int) -> Matrix:
    """Paths of straight legs and of turns of .2 to .5 rad/s that last 2 to 5 intervals.

    A turn begins with probability .2 in an interval: lateral accelerations .8 to 2 sigma/s^2.
    """

    def steps(rng: np.random.Generator) -> Matrix:
        rate = np.zeros((_DRAWN, INTERVALS))
        left = np.zeros(_DRAWN, int)
        now = np.zeros(_DRAWN)
        for k in range(INTERVALS):
            begins = (left == 0) & (rng.random(_DRAWN) < 0.2)
            left = np.where(begins, rng.integers(2, 6, _DRAWN), left)
            drawn = rng.choice([-1.0, 1.0], _DRAWN) * rng.uniform(0.2, 0.5, _DRAWN)
            now = np.where(begins, drawn, np.where(left > 0, now, 0.0))
            rate[:, k], left = now, np.maximum(left - 1, 0)
        heading = rng.uniform(-0.4, 0.4, (_DRAWN, 1)) + np.cumsum(rate, axis=1)
        return SPEED_M_S * np.stack([np.cos(heading), np.sin(heading)], axis=-1)

    return _kept(rng, count, steps)


def _kept(
    rng: np.random.Generator, count: int, steps: Callable[[np.random.Generator], Matrix]
) -> Matrix:
    found: list[Matrix] = []
    while sum(map(len, found)) < count:
        way = steps(rng)
        start = np.column_stack([np.full(_DRAWN, _START_M), rng.uniform(1.0, SIDE_M - 1.0, _DRAWN)])
        path = start[:, None] + np.cumsum(way, axis=1) - way
        inside = ((path > 0.5 * _START_M) & (path < SIDE_M - 0.5 * _START_M)).all(axis=(1, 2))
        found.append(path[inside])
    return _turned(np.concatenate(found)[:count], rng)


def _turned(paths: Matrix, rng: np.random.Generator) -> Matrix:
    """Let each path begin at any of the four sides."""
    swapped = np.where((rng.random(len(paths)) < 0.5)[:, None, None], paths[..., ::-1], paths)
    return np.where((rng.random(len(paths)) < 0.5)[:, None, None], SIDE_M - swapped, swapped)
