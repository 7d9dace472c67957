"""Binary fields: runs that are right, and time per step; tracks on readings against reports.

The same runs go through track-before-detect and through reports of each scan (peeling) joined by
the mixture of `bernoulli`. Times are of the processor: the mean over all steps, and the worst.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

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


def on_readings(model: DetectionModel) -> Follow:
    """Track on the readings; the model is told."""
    told = DetectionModel(model.radius_m, model.p_detection, model.p_false, edge_m=SOFT_M)
    tracker = Detect(DetectField(GRID, told, delivery=0.9))
    return lambda run: follow(tracker, run)


def on_reports(model: DetectionModel) -> Follow:
    """Peel each scan into reports, and join them by the mixture."""
    cells = detection_cells(model, GRID, region=REGION)
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
    """Print a row a scenario; the number of runs may be given (default 20)."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    seeds = range(9000, 9000 + count)
    weak = DetectionModel(p_detection=0.5, p_false=0.1)
    small = DetectionModel(radius_m=6.5)
    rows = [
        ("1 walker", 1, Ways(), MODEL),
        ("2 walkers", 2, Ways(), MODEL),
        ("3 walkers", 3, Ways(), MODEL),
        ("3, R 6.5 m, told", 3, Ways(), small),
        ("3, p .5, q .1, told", 3, Ways(), weak),
        ("3, any edges", 3, Ways("cross"), MODEL),
    ]
    print(f"{count} runs each{'':16s} readings: right  ms/step   reports: right  ms/step")
    for name, k, ways, model in rows:
        runs = [draw(seed, k, ways=ways, field=Field(model)) for seed in seeds]
        cells = [share_right(make(model), runs) for make in (on_readings, on_reports)]
        print(f"{name:28s}" + "   ".join(f"{r:13.0f} % {1e3 * s:8.2f}" for r, s in cells))


if __name__ == "__main__":
    main()
