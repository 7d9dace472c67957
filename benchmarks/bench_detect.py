"""Binary fields: runs that are right, and time per step; tracks on readings against reports.

The same runs go through track-before-detect and, unless `--readings`, through reports of each scan
(peeling) joined by the mixture of `bernoulli`. Times are of the processor, the mean over all steps.
Seeds from 20000 on were never used for choosing anything.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from walker_scenario import GRID, MODEL, Field, Run, Shown, Ways, draw, follow, wrong

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.contract import ReportScan
from trackfield.association.detect import Detect
from trackfield.association.detect_field import DetectField
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.localization.detection_cells import detection_cells
from trackfield.localization.peeling import peel
from trackfield.raster import Region
from trackfield.sensing.detection import DetectionModel

REGION = Region(-4.0, -4.0, 59.0, 59.0)
Follow = Callable[[Run], Sequence[Shown]]
SOFT_M = 1.0
WEAK = DetectionModel(p_detection=0.5, p_false=0.1)
SMALL = DetectionModel(radius_m=6.5)


class Row(NamedTuple):
    """A scenario, and the model that the trackers are told."""

    name: str
    k: int
    ways: Ways = Ways()
    field: Field = Field()
    told: DetectionModel = MODEL


ROWS = (
    Row("1 walker", 1),
    Row("2 walkers", 2),
    Row("3 walkers", 3),
    Row("3, two scans a second", 3, field=Field(step_s=0.5)),
    Row("3, R 6.5 m, told", 3, field=Field(SMALL), told=SMALL),
    Row("3, p .5, q .1, told", 3, field=Field(WEAK), told=WEAK),
    Row("3, R 7.0 m, not told", 3, field=Field(DetectionModel(radius_m=7.0))),
    Row("3, p .6, not told", 3, field=Field(DetectionModel(p_detection=0.6))),
    Row("3, 0.8 to 1.6 m/s, turning", 3, Ways(speed_m_s=(0.8, 1.6), turning=0.1)),
    Row("3, any edges", 3, Ways("cross")),
    Row("3, all meet in the centre", 3, Ways("centre")),
    Row("3, stop and go", 3, Ways(stops=True)),
)


def on_readings(row: Row) -> Follow:
    """Track on the readings."""
    told = replace(row.told, edge_m=SOFT_M)
    tracker = Detect(DetectField(GRID, told, delivery=0.9, step_s=row.field.step_s))
    return lambda run: follow(tracker, run)


def on_reports(row: Row) -> Follow:
    """Peel each scan into reports, and join them by the mixture."""
    cells = detection_cells(row.told, GRID, region=REGION)
    tracker = Bernoulli(Scene(Reporting(REGION), Targets(lifetime_s=300.0, births_per_s=0.02)))

    def run_through(run: Run) -> list[Shown]:
        state, found, count = tracker.initial(), [], 0
        for t_s, value in zip(run.times, run.values, strict=True):
            reports = peel(cells, value == 1, delivery=0.9)
            numbers = np.arange(count, count + len(reports.position), dtype=np.int32)
            count += len(numbers)
            scan = ReportScan(float(t_s), reports.position, reports.covariance, numbers)
            state, _ = tracker.step(state, scan)
            now = tracker.estimates(state)
            rows = zip(now.track[now.shown], now.mean[now.shown], strict=True)
            found.append({int(i): (float(m[0]), float(m[1])) for i, m in rows})
        return found

    return run_through


def share_right(follow_run: Follow, runs: Sequence[Run]) -> tuple[float, float]:
    """Count runs that are right [%], and the processor time per step [s]."""
    right, spent, steps = 0, 0.0, 0
    for run in runs:
        before = time.process_time()
        shown = follow_run(run)
        spent += time.process_time() - before
        steps += len(shown)
        right += not wrong(shown, run)
    return 100.0 * right / len(runs), spent / steps


def main() -> None:
    """Print a row a scenario."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=int, nargs="?", default=20)
    parser.add_argument("--first", type=int, default=9000, help="first seed")
    parser.add_argument("--readings", action="store_true", help="leave the reports out")
    parser.add_argument("--only", default="", help="rows whose name holds this")
    asked = parser.parse_args()
    makers = (on_readings,) if asked.readings else (on_readings, on_reports)
    print(f"{asked.runs} runs each{'':16s} readings: right  ms/step   reports: right  ms/step")
    for row in (row for row in ROWS if asked.only in row.name):
        seeds = range(asked.first, asked.first + asked.runs)
        runs = [draw(seed, row.k, ways=row.ways, field=row.field) for seed in seeds]
        cells = [share_right(make(row), runs) for make in makers]
        shown = "   ".join(f"{r:13.0f} % {1e3 * s:8.2f}" for r, s in cells)
        print(f"{row.name:28s}{shown}", flush=True)


if __name__ == "__main__":
    main()
