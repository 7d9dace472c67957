"""Closed loop: energy and error by policy, and how many steps a second a large field takes.

Range sensors anywhere in a dense field, one place of each target an interval; the tracker, the
scheduler and the meter are those of the package. Energy is that of the whole network, over seconds
in which a target was tracked: `above sleep` is what it spends more than if everybody slept. Times
are of the processor. Seeds from 500 on were never used for choosing anything.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.localization.trilateration import blue
from trackfield.metrics.error import match
from trackfield.network.energy import Energy, mode_powers
from trackfield.network.node_index import NodeIndex
from trackfield.network.site import SchedulingSettings, Site, Target
from trackfield.pipeline.tagged import Tracker
from trackfield.sensing.range import RangeModel
from trackfield.simulation.closed_loop import Outcome, Turn, closed_loop, outcome
from trackfield.simulation.on_demand import RangesOnDemand
from trackfield.simulation.tagged import to_truth
from trackfield.types import Matrix, join_rows, select_rows

SIGMA_M = 0.2
STEP_S = 0.5
TURN_S = 20.0  # how long a velocity lasts
WARM_S = 10.0
FIRST_SEED = 500


class World(NamedTuple):
    """A square field of `nodes`, and targets in the middle of it; their speed is per axis."""

    nodes: int = 2500
    targets: int = 1
    steps: int = 240
    spacing_m: float = 1.0
    reach_m: float = 4.0
    speed_m_s: float = 0.7

    @property
    def side_m(self) -> float:
        """Length of a side."""
        return self.spacing_m * math.sqrt(self.nodes)

    @property
    def model(self) -> RangeModel:
        """What each node measures."""
        return RangeModel(sigma_m=SIGMA_M, max_range_m=self.reach_m)


PHAM = World(441, spacing_m=0.5, reach_m=2.418, speed_m_s=0.35)


class Row(NamedTuple):
    """A policy, as a line of the table."""

    name: str
    settings: SchedulingSettings


def policy(**keys: object) -> SchedulingSettings:
    """Set intervals of a step, and no watch: the targets are inside all the time."""
    given = {"interval_s": STEP_S, "watch": "never", "sweep_s": 4.0, **keys}
    return SchedulingSettings(**given)  # type: ignore[arg-type]


ROWS = (
    Row("all in range", policy(policy="all")),
    *(Row(f"accuracy, {k} sensors", policy(sensors=k)) for k in (3, 4, 6, 9, 16)),
    Row("nearest, 4 sensors", policy(policy="nearest")),
    Row("soft, up to 3 sensors, .12 m^2", policy(policy="soft", sensors=3)),
    Row("soft, up to 3 sensors, .05 m^2", policy(policy="soft", sensors=3, bound_m2=0.05)),
    *(Row(f"accuracy, 4 sensors, bursts of {b}", policy(burst=b)) for b in (4, 14)),
    Row("accuracy, 3 sensors, bursts of 20", policy(sensors=3, burst=20)),
)


def paths(rng: np.random.Generator, world: World) -> Matrix:
    """Targets (targets, steps, 2) [m]: velocities that fade, pulled to the middle of the field."""
    side, speed = world.side_m, world.speed_m_s
    pull, parts = (speed / (side / 8.0)) ** 2, 5
    h = STEP_S / parts
    keep = math.exp(-h / TURN_S)
    kick = speed * math.sqrt(1.0 - keep**2)
    place = side / 2.0 + side / 8.0 * rng.standard_normal((world.targets, 2))
    velocity = speed * rng.standard_normal((world.targets, 2))
    found = np.empty((world.targets, world.steps, 2))
    for k in range(world.steps):
        found[:, k] = place
        for _ in range(parts):
            drawn = rng.standard_normal((world.targets, 2))
            velocity = keep * velocity + kick * drawn - pull * (place - side / 2.0) * h
            place = place + h * velocity
    return found


def drive(world: World, settings: SchedulingSettings, seed: int) -> tuple[Site, list[Turn], Matrix]:
    """Run a world: its site, its intervals, and where the targets really were."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, world.side_m, (world.nodes, 2))
    accel = world.speed_m_s * math.sqrt(2.0 / TURN_S)
    site = Site(
        "dense",
        tuple(f"s{i}" for i in range(world.nodes)),
        np.column_stack([places, np.full(world.nodes, np.nan)]),
        (world.model,) * world.nodes,
        target=Target(motion="cv", accel_sigma_m_s2=accel),
        scheduling=settings,
    )
    ways = paths(rng, world)
    draws = np.random.default_rng([seed, 1])
    senses = RangesOnDemand(NodeIndex(places), world.model, ways, STEP_S, draws, settings.burst)
    loop = closed_loop(site, senses, Tracker(site), duration_s=world.steps * STEP_S)
    return site, list(loop), ways


def errors(turns: Sequence[Turn], ways: Matrix) -> Matrix:
    """Errors (m,) [m] of what was shown, the beginning aside."""
    names = tuple(f"tag{i}" for i in range(len(ways)))
    truth = to_truth(STEP_S * np.arange(ways.shape[1]), ways, names)
    tracks = join_rows([turn.tracks for turn in turns])
    found = match(truth, select_rows(tracks, tracks.t_s >= WARM_S))
    return np.hypot(found.error[:, 0], found.error[:, 1])


class Found(NamedTuple):
    """A policy over some runs: error [m], energies per tracked second [J/s], nodes, tracking."""

    rmse_m: float
    above_sleep: float
    total: float
    sensing: float
    active: float
    tracked: float


def measure(settings: SchedulingSettings, seeds: Sequence[int], world: World = World()) -> Found:  # noqa: B008 (immutable)
    """Run a policy over some seeds."""
    squares, parts = [], list[Outcome]()
    for seed in seeds:
        site, turns, ways = drive(world, settings, seed)
        squares.append(errors(turns, ways) ** 2)
        parts.append(outcome([turn for turn in turns if turn.told.t_s >= WARM_S], site))
    tracked = sum(part.tracked_s for part in parts)
    duration = sum(part.duration_s for part in parts)
    in_mode = np.sum([part.in_mode_s for part in parts], axis=0) / duration
    return Found(
        math.sqrt(np.concatenate(squares).mean()),
        sum(part.above_sleep_j for part in parts) / tracked,
        sum(part.spent_j for part in parts) / tracked,
        float(in_mode[2] + in_mode[3]),
        float(in_mode[1]),
        tracked / (duration * world.targets),
    )


def unfiltered(seeds: Sequence[int], world: World = World()) -> float:  # noqa: B008 (immutable)
    """Error [m] of trilateration by all in range, each interval by itself: no filter."""
    squares = []
    for seed in seeds:
        _, turns, ways = drive(world, policy(policy="all"), seed)
        rng = np.random.default_rng(seed)
        places = rng.uniform(0.0, world.side_m, (world.nodes, 2))
        for turn in turns:
            if turn.told.t_s < WARM_S:
                continue
            k = round(turn.told.t_s / STEP_S)
            said = turn.readings
            found = blue(places[said.sensor], said.value, sigma_m=SIGMA_M)
            squares.append(float(((found.position - ways[0, k]) ** 2).sum()))
    return math.sqrt(np.mean(squares))


def awake(found: Found, world: World = World()) -> float:  # noqa: B008 (immutable)
    """Power in all [W] if those that do not sense, of a field without a scheduler, are awake."""
    powers = 1e-3 * mode_powers(Energy(), found.sensing - 1.0)
    others = world.nodes - found.sensing
    return float(powers[3] + (found.sensing - 1.0) * powers[2] + others * powers[1])


def seconds_a_step(world: World, seed: int = FIRST_SEED) -> float:
    """Processor time of a step in closed loop: sensing, tracking, scheduling and the meter."""
    before = time.process_time()
    _, turns, _ = drive(world, policy(), seed)
    whole = time.process_time() - before
    before = time.process_time()
    drive(world._replace(steps=1), policy(), seed)
    return (whole - (time.process_time() - before)) / (len(turns) - 1)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=8)
    runs = parser.parse_args().runs
    seeds = range(FIRST_SEED, FIRST_SEED + runs)
    head = ("policy", "RMSE [m]", "above sleep", "in all", "sense", "awake", "tracked")
    print("{:48s}{:>10s}{:>14s}{:>10s}{:>8s}{:>8s}{:>9s}".format(*head))
    pham = (ROWS[0], ROWS[2], Row("accuracy, 3 sensors, bursts of 30", policy(sensors=3, burst=30)))
    lines = [(row, World()) for row in ROWS] + [
        (row._replace(name=f"Pham's field, {row.name}"), PHAM) for row in pham
    ]
    for row, world in lines:
        found = measure(row.settings, seeds, world)
        print(
            f"{row.name:48s}{found.rmse_m:10.4f}{found.above_sleep:14.1f}{found.total:10.1f}"
            f"{found.sensing:8.1f}{found.active:8.1f}{found.tracked:9.3f}",
            flush=True,
        )
        if row.settings.policy == "all":
            print(f"{'the same, and nobody sleeps':48s}{awake(found, world):>34.1f}")
    print(f"{'all in range, each interval by itself':48s}{unfiltered(seeds):10.4f}")
    for nodes, targets in ((1000, 3), (10_000, 1), (10_000, 3), (10_000, 10)):
        world = World(nodes, targets, 400)
        best = min(seconds_a_step(world) for _ in range(3))
        print(f"{nodes:6d} nodes, {targets:2d} targets: {1.0 / best:6.0f} steps a second")


if __name__ == "__main__":
    main()
