"""The mixture where targets are many: a dense scene, rows side by side, growth of the cost.

Times are of the processor. `python benchmarks/bench_crowds.py [SEEDS]` runs the dense scene with
the seeds 0 to SEEDS - 1, 10 if not told.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator

import numpy as np
from report_scenario import P_DETECTION, REGION, SIDE_M, SIGMA_M, draw, judge, scene, tracks_of

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.raster import Region
from trackfield.types import Matrix

DENSE = {"targets": 40, "false_per_scan": 20.0}


def timed(tracker: Bernoulli, scans: Iterator[ReportScan]) -> Iterator[tuple[float, Matrix]]:
    """Yield the processor time of each step [s] and what it shows, rows (n, 4) t, track, x, y."""
    state = tracker.initial()
    for scan in scans:
        before = time.process_time()
        state, _ = tracker.step(state, scan)
        found = tracker.estimates(state)
        spent = time.process_time() - before
        rows = np.column_stack([found.track, found.mean[:, :2]])[found.shown]
        yield spent, np.column_stack([np.full(len(rows), scan.t_s), rows])


def dense(seeds: int) -> None:
    """Print scores and cost of 40 targets among 20 false reports a step."""
    gospa, seconds = [], []
    for seed in range(seeds):
        run = draw(seed, **DENSE)
        steps = list(timed(Bernoulli(scene(**DENSE)), iter(run.scans)))
        seconds += [spent for spent, _ in steps]
        tracks = tracks_of(np.concatenate([rows for _, rows in steps]))
        gospa.append(judge(run, tracks).sets.gospa_m)
    print(
        f"40 targets, 20 false reports: GOSPA {np.mean(gospa):.3f} m, {1e3 * np.mean(seconds):.2f} "
        f"ms a step (99 % {1e3 * np.percentile(seconds, 99):.2f})"
    )


def abreast(
    spacing_m: float, *, targets: int = 100, false: float = 50.0, steps: int = 40
) -> Iterator[ReportScan]:
    """Yield scans of targets that walk side by side."""
    rng = np.random.default_rng(0)
    place = np.column_stack(
        [50.0 + spacing_m * (np.arange(targets) - targets / 2), np.full(targets, 20.0)]
    )
    for t in range(steps):
        place = place + np.array([0.0, 0.8]) + 0.05 * rng.standard_normal(place.shape)
        yield _scan(t, place, rng, side_m=SIDE_M, false=false)


def crowd(spacing_m: float) -> None:
    """Print the cost of 100 targets that walk abreast among 50 false reports a step."""
    told = Scene(
        Reporting(REGION, 1.0, SIGMA_M, (P_DETECTION,), 50.0), Targets(initial_count=100.0)
    )
    seconds = [spent for spent, _ in timed(Bernoulli(told), abreast(spacing_m))]
    print(
        f"100 abreast, {spacing_m:g} m apart: {1e3 * np.mean(seconds):.1f} ms a step, "
        f"at most {1e3 * np.max(seconds):.1f}"
    )


def wanderers(targets: int, side_m: float, *, steps: int = 25) -> Iterator[ReportScan]:
    """Yield scans of targets that turn about at the border."""
    rng = np.random.default_rng(targets)
    place, velocity = rng.uniform(0, side_m, (targets, 2)), rng.normal(0, 0.7, (targets, 2))
    for t in range(steps):
        place = place + velocity
        velocity = np.where((place < 0) | (place > side_m), -velocity, velocity)
        yield _scan(t, place, rng, side_m=side_m, false=targets / 2.0)


def growth(counts: tuple[int, ...] = (25, 50, 100, 200, 400)) -> None:
    """Print how the cost of a step grows with the number of targets at the same density."""
    costs: list[float] = []
    for n in counts:
        side_m = SIDE_M * math.sqrt(n / 12)
        reporting = Reporting(
            Region(0.0, 0.0, side_m, side_m), 1.0, SIGMA_M, (P_DETECTION,), n / 2.0
        )
        told = Scene(reporting, Targets(births_per_s=n / 120, initial_count=float(n)))
        seconds = [spent for spent, _ in timed(Bernoulli(told), wanderers(n, side_m))]
        costs.append(float(np.median(seconds[5:])))
        print(f"{n} targets: {1e3 * costs[-1]:.2f} ms a step")
    print(f"grows with the power {np.polyfit(np.log(counts), np.log(costs), 1)[0]:.2f}")


def _scan(
    t: int, place: Matrix, rng: np.random.Generator, *, side_m: float, false: float
) -> ReportScan:
    seen = place[rng.random(len(place)) < P_DETECTION]
    seen = seen + SIGMA_M * rng.standard_normal(seen.shape)
    reports = np.concatenate([seen, rng.uniform(0, side_m, (rng.poisson(false), 2))])
    number = np.arange(len(reports), dtype=np.int32) + 1000 * t
    return ReportScan(float(t), reports, np.full((len(reports), 3), np.nan), number)


def main(arguments: list[str]) -> None:
    """Print all three."""
    dense(int(arguments[0]) if arguments else 10)
    for spacing_m in (0.5, 1.0, 2.0):
        crowd(spacing_m)
    growth()


if __name__ == "__main__":
    main(sys.argv[1:])
