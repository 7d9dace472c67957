"""Oh, IV.B: what loss, delay, misplaced sensors and the number of moves do to the tracks.

The paper claims no loss of performance up to a position error of .7 sensor spacings, and tracking
up to 50 % lost and 90 % delayed packets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trackfield.experiments import oh_network as network
from trackfield.experiments.oh_network import (
    OURS,
    PAPER_CENTRAL,
    SAMPLED,
    Conditions,
    Field,
    Tracker,
)
from trackfield.experiments.results import Interval, Table, mean_interval

LOSS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.7)  # of a hop; what is lost in all is measured
DELAY = (0.0, 0.3, 0.6, 0.75, 0.9)  # of a hop
MISPLACED = (0.0, 0.25, 0.5, 0.7, 1.0)  # per axis, in sensor spacings
MOVES = (100, 300, 1000, 3000, 10_000)
COMPARED = (PAPER_CENTRAL, OURS)


class Point(NamedTuple):
    """One setting of a sweep: what was measured of the network, GOSPA by tracker."""

    setting: float
    lost: float
    delayed: float
    gospa_m: Mapping[str, Interval]


Sweep = tuple[Point, ...]


class Sweeps(NamedTuple):
    """All sweeps; that of moves has the MCMCDA trackers only."""

    loss: Sweep
    delay: Sweep
    misplaced: Sweep
    moves: Sweep


class Worlds(NamedTuple):
    """Which worlds a sweep goes over, and how many steps of each."""

    seeds: Sequence[int]
    steps: int


def sweeps(
    worlds: Worlds, rng: np.random.Generator, *, thin: int = 1, tick: Callable[[], None]
) -> Sweeps:
    """Run every sweep over some worlds; `thin` takes every so many of the settings.

    `tick` is called after each setting.
    """

    def fields(misplaced_m: float) -> dict[str, list[Field]]:
        return {
            fusion: [
                network.field(fusion, seed, misplaced_m=misplaced_m, steps=worlds.steps)
                for seed in worlds.seeds
            ]
            for fusion in network.FUSIONS
        }

    base = fields(0.0)

    def over(conditions: Conditions, made: Mapping[str, list[Field]], setting: float) -> Point:
        point = _point(COMPARED, made, conditions, setting=setting, rng=rng)
        tick()
        return point

    few: list[Point] = []
    for moves in MOVES[::thin]:
        own = [t._replace(moves=moves) for t in (PAPER_CENTRAL, SAMPLED)]
        few.append(_point(own, base, Conditions(), setting=float(moves), rng=rng))
        tick()
    return Sweeps(
        loss=tuple(over(Conditions(p_loss=p), base, p) for p in LOSS[::thin]),
        delay=tuple(over(Conditions(p_delay=p), base, p) for p in DELAY[::thin]),
        misplaced=tuple(
            over(Conditions(misplaced_m=error), fields(error), error) for error in MISPLACED[::thin]
        ),
        moves=tuple(few),
    )


def settings(thin: int = 1) -> int:
    """Count the settings of all sweeps."""
    return sum(len(one[::thin]) for one in (LOSS, DELAY, MISPLACED, MOVES))


def tables(found: Sweeps) -> tuple[Table, ...]:
    """Make a table of each sweep: GOSPA [m] live, with intervals over the worlds."""
    titles = {
        "loss": ("Loss: GOSPA live [m] (c 5, p 2)", "lost in all"),
        "delay": ("Delay: GOSPA live [m]", "delayed of received"),
        "misplaced": ("Misplaced sensors: GOSPA live [m]", "error per axis [spacings]"),
        "moves": ("Moves a step of MCMCDA: GOSPA live [m]", "moves"),
    }
    made: list[Table] = []
    for name, (title, column) in titles.items():
        sweep: Sweep = getattr(found, name)
        rows = tuple(
            (_setting(name, point), *(one.text() for one in point.gospa_m.values()))
            for point in sweep
        )
        made.append(Table(title, (column, *sweep[0].gospa_m), rows))
    return tuple(made)


def _setting(name: str, point: Point) -> str:
    match name:
        case "loss":
            return f"{100 * point.lost:.0f} % (hop {100 * point.setting:.0f} %)"
        case "delay":
            return f"{100 * point.delayed:.0f} % (hop {100 * point.setting:.0f} %)"
        case "misplaced":
            return f"{point.setting:g}"
        case _:
            return f"{point.setting:.0f}"


def _point(
    trackers: Sequence[Tracker],
    fields: Mapping[str, list[Field]],
    conditions: Conditions,
    *,
    setting: float,
    rng: np.random.Generator,
) -> Point:
    gospa: dict[str, Interval] = {}
    lost, delayed = 0.0, 0.0
    for tracker in trackers:
        runs = [network.run(tracker, made, conditions) for made in fields[tracker.fusion]]
        gospa[tracker.name] = mean_interval(np.array([r.live.sets.gospa_m for r in runs]), rng)
        sent = sum(r.passed.sent for r in runs)
        lost = sum(r.passed.lost for r in runs) / max(sent, 1)
        delayed = sum(r.passed.delayed for r in runs) / max(sent - lost * sent, 1.0)
    return Point(setting, lost, delayed, gospa)
