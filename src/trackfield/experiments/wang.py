"""Wang, Fu, Zhang: the paper's comparison again, and what its result depends on.

All errors are RMSE per axis, sqrt(mean of (ex^2 + ey^2)/2) over all steps and runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import wang_roads as roads
from trackfield.experiments import wang_tables as tables
from trackfield.experiments import wang_testbed as testbed
from trackfield.experiments.results import Table
from trackfield.experiments.wang_roads import (
    ADDITIVE,
    EKF,
    IEKF,
    PAPER,
    ROBUST,
    SAFE,
    THREE,
    Outcome,
    Part,
)
from trackfield.experiments.wang_tables import ROADS, Scores
from trackfield.simulation.roads import Nlos

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Size(NamedTuple):
    """How much a reproduction runs."""

    testbed_runs: int
    road_runs: int
    from_m: float  # where on the way from A the roads begin; the corner is at 40 m
    matched: Part
    bad_starts: Part


FULL = Size(100, 100, 0.0, Part(20, 10), Part(8, 20))
QUICK = Size(12, 12, 30.0, Part(3, 10, 100), Part(1, 12, 100))
RUNS_OF_FILTERS = 29  # over all parts, for the progress


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """What was found: tables, sentences, the scores behind them, and what figures need.

    `scores` and `outcomes` are by part, then by filter.
    """

    tables: tuple[Table, ...]
    findings: tuple[str, ...]
    scores: Scores
    outcomes: dict[str, Outcome]

    def to_dict(self) -> dict[str, object]:
        """Give tables, findings and scores as plain objects."""
        return {
            "paper": "wang",
            "tables": [table._asdict() for table in self.tables],
            "findings": list(self.findings),
            "scores": {
                part: {name: score.to_dict() for name, score in scores.items()}
                for part, scores in self.scores.items()
            },
        }

    def figures(self) -> dict[str, Figure]:
        """Draw the paper's figures with Matplotlib, by file name."""
        from trackfield.experiments.wang_figures import figures

        return figures(self.outcomes)


def reproduce(
    rng: np.random.Generator,
    *,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Reproduction:
    """Run Wang's experiments 4.2 and 4.3, and those that tell what they depend on.

    `quick` takes a dozen runs of the second part of the roads instead of a hundred runs of all.
    `progress` is called with shares from 0 to 1.
    """
    outcomes = _outcomes(rng, QUICK if quick else FULL, _Ticker(progress))
    scores = tables.score(outcomes, rng)
    return Reproduction(tables.tables(scores), tables.findings(scores), scores, outcomes)


def _outcomes(rng: np.random.Generator, size: Size, tick: Callable[[], None]) -> dict[str, Outcome]:
    compared = (PAPER, EKF, ADDITIVE, THREE, IEKF)
    outcomes: dict[str, Outcome] = {}
    for name, accel in (
        (tables.TESTBED, testbed.PAPER_ACCEL),
        (tables.TESTBED_BETTER, testbed.BETTER_ACCEL),
    ):
        race = testbed.race(rng, runs=size.testbed_runs, accel=accel)
        outcomes[name] = roads.run([race], (PAPER, EKF), tick=tick)
    for end, name in ROADS.items():
        race = roads.road(rng, end, runs=size.road_runs, from_m=size.from_m)
        outcome = roads.run([race], compared, tick=tick)
        outcomes[name] = outcome._replace(
            entries={**outcome.entries, **roads.default_tracker(race)}
        )
    for end, name in ROADS.items():
        race = roads.road(rng, end, runs=size.road_runs, from_m=size.from_m, nlos=Nlos())
        outcome = roads.run([race], (PAPER, EKF, ROBUST), tick=tick)
        outcomes[tables.blocked(name)] = outcome._replace(
            entries={**outcome.entries, **roads.default_tracker(race)}
        )
    outcomes[tables.MATCHED] = roads.run(roads.matched(rng, size.matched), compared, tick=tick)
    bad = roads.bad_starts(rng, size.bad_starts)
    outcomes[tables.BAD_START] = roads.run(bad, (PAPER, EKF, IEKF, SAFE), tick=tick)
    return outcomes


class _Ticker:
    """Counts the filters that have run."""

    def __init__(self, progress: Callable[[float], None] | None) -> None:
        self.progress = progress
        self.done = 0

    def __call__(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(min(self.done / RUNS_OF_FILTERS, 1.0))
