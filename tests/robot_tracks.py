"""Tracks for robots to follow: sinusoids across Pham's field, and paths without a period."""

from __future__ import annotations

import numpy as np

from trackfield.raster import Region

FIELD = Region(0.0, 0.0, 10.0, 10.0)
NON_PERIODIC = ("straight", "waypoints", "turns", "walk")


def sinusoid(steps=96, periods=3.0, amplitude=3.0, phase=0.0, across=10.0):
    """From x = 0 to `across` in equal steps of x, about y = 5; (steps + 1, 2) [m]."""
    share = np.linspace(0.0, 1.0, steps + 1)
    wave = amplitude * np.sin(2.0 * np.pi * periods * share + phase)
    return np.column_stack([across * share, 5.0 + wave])


def wander(rng, kind, steps):
    """A path without a period, .2 m a step; (steps + 1, 2) [m]."""
    if kind == "straight":
        heading = np.full(steps, rng.uniform(0.0, 2.0 * np.pi))
    elif kind == "waypoints":
        place, goal, headings = rng.uniform(0.0, 10.0, 2), rng.uniform(0.0, 10.0, 2), []
        for _ in range(steps):
            while np.linalg.norm(goal - place) < 0.2:
                goal = rng.uniform(0.0, 10.0, 2)
            headings.append(np.arctan2(*(goal - place)[::-1]))
            place = place + 0.2 * np.array([np.cos(headings[-1]), np.sin(headings[-1])])
        heading = np.array(headings)
    elif kind == "turns":
        switch = rng.random(steps) < 0.05
        rates = np.where(rng.random(steps) < 0.5, 0.0, rng.uniform(-0.3, 0.3, steps))
        latest = np.maximum.accumulate(np.where(switch, np.arange(steps), 0))
        heading = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(rates[latest])
    else:
        heading = rng.uniform(0.0, 2.0 * np.pi, steps)
    steps_m = 0.2 * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.vstack([[5.0, 5.0], 5.0 + np.cumsum(steps_m, axis=0)])
