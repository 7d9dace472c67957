"""Trackers of unknown targets on the same runs: ours beside Stone Soup's GNN and JPDA.

They take turns of some scans in one process, so that a busy machine slows all alike; times are of
the processor. What Stone Soup shows outside the region is not counted, which helps it by .1 m.
`python benchmarks/bench_trackers.py [SEEDS]` runs the seeds 0 to SEEDS - 1, 10 if not told.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import stonesoup_trackers
from report_scenario import (
    LAST_BIRTH,
    SCENE,
    UNKNOWN,
    Run,
    draw,
    judge,
    tracks_of,
    true_priors,
)

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import AnyAssociator, ReportScan
from trackfield.association.mcmcda import Mcmcda
from trackfield.association.model import Scene
from trackfield.association.nearest import Nearest
from trackfield.association.nearest_step import NearestSettings
from trackfield.association.sampling import Sampling
from trackfield.types import Matrix

Step = Callable[[ReportScan], Matrix]  # to rows (n, 3) of track, x, y
THEIRS = "Stone Soup GNN"
TURN = 20


class Result(NamedTuple):
    """Means over the runs: scores, and processor times per step [ms] with their 99th percentile."""

    gospa_m: float
    mota: float
    idf1: float
    switches: float
    mean_ms: float
    p99_ms: float


def trackers() -> dict[str, Callable[[], Step]]:
    """Name all trackers, ours first."""
    return {
        "bernoulli": lambda: steps_of(Bernoulli(SCENE)),
        "  all learned": lambda: steps_of(Bernoulli(UNKNOWN)),
        "  true priors": told_all,
        "  propagation": lambda: steps_of(Bernoulli(SCENE, BernoulliSettings(cluster_work=0))),
        "jipda": lambda: steps_of(Bernoulli(SCENE, BernoulliSettings(recent_scans=0))),
        "mcmcda 1000": lambda: steps_of(Mcmcda(SCENE, Sampling(moves=1000))),
        "mcmcda 5000": lambda: steps_of(Mcmcda(SCENE, Sampling(moves=5000))),
        "gnn": lambda: steps_of(Nearest(SCENE)),
        "nearest": lambda: steps_of(Nearest(SCENE, NearestSettings("greedy"))),
        THEIRS: stonesoup_trackers.gnn,
        "Stone Soup JPDA": stonesoup_trackers.jpda,
    }


def steps_of(tracker: AnyAssociator, late: AnyAssociator | None = None) -> Step:
    """Make a function that takes the next scan and tells what is shown; `late` ends the run."""
    held = {"state": tracker.initial()}

    def step(scan: ReportScan) -> Matrix:
        now = tracker if late is None or scan.t_s < LAST_BIRTH else late
        held["state"], _ = now.step(held["state"], scan)
        found = now.estimates(held["state"])
        return np.column_stack([found.track, found.mean[:, :2]])[found.shown]

    return step


def told_all() -> Step:
    """Make the mixture that knows the true priors; and, in time, that nobody comes any more."""
    told = true_priors()
    closed = Scene(told.reporting, replace(told.targets, births_per_s=0.0))
    return steps_of(Bernoulli(told), Bernoulli(closed))


def compare(makers: dict[str, Callable[[], Step]], runs: list[Run]) -> dict[str, Result]:
    """Run all trackers side by side, `TURN` scans at a time."""
    times: dict[str, list[float]] = {name: [] for name in makers}
    scores: dict[str, list[tuple[float, ...]]] = {name: [] for name in makers}
    for run in runs:
        steps = {name: make() for name, make in makers.items()}
        rows: dict[str, list[Matrix]] = {name: [] for name in makers}
        turns = [run.scans[start : start + TURN] for start in range(0, len(run.scans), TURN)]
        for turn, (name, step) in product(turns, steps.items()):
            for scan in turn:
                before = time.process_time()
                shown = step(scan)
                times[name].append(1e3 * (time.process_time() - before))
                inside = shown[SCENE.reporting.region.contains(shown[:, 1:])]
                rows[name].append(np.column_stack([np.full(len(inside), scan.t_s), inside]))
        for name, parts in rows.items():
            found = judge(run, tracks_of(np.concatenate(parts)))
            clear, identity = found.clear_mot, found.identity
            scores[name].append(
                (found.sets.gospa_m, clear.mota or 0.0, identity.idf1 or 0.0, clear.switches)
            )
    return {
        name: Result(
            *np.mean(scores[name], axis=0).tolist(),
            mean_ms=float(np.mean(times[name])),
            p99_ms=float(np.percentile(times[name], 99)),
        )
        for name in makers
    }


def main(arguments: list[str]) -> None:
    """Print a table."""
    seeds = int(arguments[0]) if arguments else 10
    found = compare(trackers(), [draw(seed) for seed in range(seeds)])
    theirs = found[THEIRS].mean_ms
    print(f"{'':16s}  GOSPA   MOTA   IDF1  switches  ms/step     p99  faster than {THEIRS}")
    for name, one in found.items():
        print(
            f"{name:16s} {one.gospa_m:6.3f} {one.mota:6.3f} {one.idf1:6.3f} {one.switches:9.1f} "
            f"{one.mean_ms:8.3f} {one.p99_ms:7.3f} {theirs / one.mean_ms:12.1f} x"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
