"""Pursuit: separation of eight pursuers among polygons, captures in the binary field, times.

`python benchmarks/bench_pursuit.py [RUNS]`; seeds were used to choose nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfield.experiments.oh_walkers import scenario as walkers
from trackfield.pipeline.rows import Row, tracks_of
from trackfield.pursuit.assignment import assign
from trackfield.pursuit.coordinator import coordinator
from trackfield.pursuit.settings import PursuitSettings
from trackfield.pursuit.vehicles import Thruster
from trackfield.simulation.game_outcome import played
from trackfield.simulation.scenario import Obstacle, Party, Pursuer, Pursuit, Reports, Scenario
from trackfield.simulation.world import make_world

FRESH = 80_000
SHAPES = (
    ((12.0, 12.0), (18.0, 12.0), (18.0, 18.0), (12.0, 18.0)),
    ((25.0, 8.0), (30.0, 10.0), (27.0, 16.0)),
    ((10.0, 26.0), (16.0, 24.0), (22.0, 30.0), (14.0, 32.0)),
)


class Kept(NamedTuple):
    """What many games came to: least distances [m], steps too near, evaders captured and in all."""

    apart_m: float
    clear_m: float
    collisions: int
    captured: int
    evaders: int
    games_won: int


def crowd(seed: int) -> Scenario:
    """Eight pursuers and eight evaders among polygons, with actuators that err."""
    rng = np.random.default_rng(seed)
    spots = np.array([[2.0 + 5.0 * i, y] for i in range(8) for y in (3.0, 37.0)])
    at = spots[rng.permutation(16)[:8]].tolist()
    return Scenario(
        duration_s=25.0,
        region=(0.0, 0.0, 40.0, 40.0),
        reports=Reports(),
        targets=(
            Party(
                count=8,
                at_start=8,
                border="bounce",
                speed_m_s=(0.5, 1.0),
                accel_sigma_m_s2=0.05,
            ),
        ),
        pursuit=Pursuit(
            sight="exact", speed_m_s=2.0, error_m_s2=0.05, capture_m=0.5, confirm_steps=4
        ),
        pursuers=tuple(Pursuer((x, y)) for x, y in at),
        obstacles=tuple(Obstacle(shape) for shape in SHAPES),
    )


def demonstration(seed: int) -> Scenario:
    """Two pursuers after two walkers that cross the binary field of Oh's demonstration."""
    pursuers = (Pursuer((20.0, 30.0)), Pursuer((40.0, 30.0)))
    own = walkers(2, np.random.default_rng(seed))
    return replace(own, pursuit=Pursuit(), pursuers=pursuers)


def games(make: Callable[[int], Scenario], runs: int, first_seed: int = FRESH) -> Kept:
    """Play `runs` games."""
    seeds = range(first_seed, first_seed + runs)
    found = [played(make_world(make(seed), seed=seed)) for seed in seeds]
    return Kept(
        min(one.apart_m for one in found),
        min(one.clear_m for one in found),
        sum(one.collisions for one in found),
        sum(one.captured for one in found),
        sum(len(one.fates) for one in found),
        sum(one.captured == len(one.fates) for one in found),
    )


def assignment_s(n: int, seed: int = FRESH) -> float:
    """Processor time of a bottleneck assignment n x n [s], the least of ten."""
    costs = np.random.default_rng(seed).random((n, n))
    return min(_timed(lambda: assign(costs)) for _ in range(10))


def coordination_s(n: int, seed: int = FRESH) -> float:
    """Processor time of a step of n double integrators after n tracks [s], the least of thirty."""
    rng = np.random.default_rng(seed)
    evaders, pursuers = rng.normal(0.0, 50.0, (2, n, 4)) * [1.0, 1.0, 0.01, 0.01]
    rows = tracks_of(
        [
            Row(0.0, j, x, y, vx, vy, 0.1, 0.0, 0.1, 1)
            for j, (x, y, vx, vy) in enumerate(evaders.tolist())
        ]
    )
    made = coordinator(Thruster(1.0, 3.0), PursuitSettings())
    empty = made.initial()
    return min(
        _timed(lambda: made.step(empty, 0.0, tracks=rows, pursuers=pursuers)) for _ in range(30)
    )


def _timed(call: Callable[[], object]) -> float:
    begun = time.process_time()
    call()
    return time.process_time() - begun


def main() -> None:
    """Print all of it."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"bottleneck of 500 x 500: {1e3 * assignment_s(500):.1f} ms")
    print(f"coordination of 100 x 100: {1e3 * coordination_s(100):.1f} ms")
    print("binary field:", games(demonstration, max(runs // 4, 1)))
    print("among obstacles:", games(crowd, runs))


if __name__ == "__main__":
    main()
