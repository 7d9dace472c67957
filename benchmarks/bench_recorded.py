"""Accuracy on recorded runs: one set of defaults, calibrated elsewhere or not at all.

Each line is a run and a way to calibrate; columns are the horizontal RMSE [m] live, with lags of
2 s and 5 s, the share of truth inside the 95 % ellipse (live) and the clipped NIS.

    python benchmarks/bench_recorded.py [FOLDER]    FOLDER holds other recordings (lias_fast, ...)
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackfield.calibration.ranges import calibrate
from trackfield.io.measurements import read_readings
from trackfield.io.recorded import recorded
from trackfield.io.truth import read_truth
from trackfield.metrics.score import Score, score
from trackfield.network.site import Site
from trackfield.network.site_file import load_site, site_from_toml
from trackfield.pipeline.tagged import track
from trackfield.types import Readings, Tracks, Truth, select_rows

LAGS_S = (0.0, 2.0, 5.0)
OTHER = Path(__file__).parents[2] / "shared" / "data"


class Case(NamedTuple):
    """A run, the site it is tracked on, and from when on it is scored."""

    name: str
    site: Site
    readings: Readings
    truth: Truth
    from_s: float = -np.inf


class Result(NamedTuple):
    """Scores of a case by lag."""

    case: Case
    scores: tuple[Score, ...]


def plaza_cases() -> Iterator[Case]:
    """Each plaza run on its own, and calibrated on the other."""
    runs = {name: recorded(name) for name in ("plaza1", "plaza2")}
    for name, other in (("plaza2", "plaza1"), ("plaza1", "plaza2")):
        run, source = runs[name], runs[other]
        learned = calibrate(source.site, source.readings, source.truth).site
        place = {sensor: i for i, sensor in enumerate(learned.sensor_ids)}
        models = tuple(learned.models[place[sensor]] for sensor in run.site.sensor_ids)
        site = replace(run.site, models=models)
        yield Case(f"{name}, calibrated on {other}", site, run.readings, run.truth)
        yield Case(f"{name}, self-calibrating", run.site, run.readings, run.truth)


def folder_cases(folder: Path, target: str) -> Iterator[Case]:
    """Take a recording in files, calibrated on its first third or by itself; score the rest."""
    readings = read_readings(folder / "measurements.csv")
    truth = read_truth(folder / "truth.csv")
    file = folder / "site.toml"
    plain = '[site]\nsensors_file = "sensors.csv"\n'
    site = load_site(file) if file.is_file() else site_from_toml(plain, folder, str(file))
    mine = select_rows(readings, readings.target == readings.target_ids.index(target))
    third = float(mine.t_s[0] + (mine.t_s[-1] - mine.t_s[0]) / 3)
    first = select_rows(mine, mine.t_s < third)
    learned = calibrate(site, first, truth).site
    name = f"{folder.name} {target}"
    yield Case(f"{name}, calibrated on its first third", learned, mine, truth, third)
    yield Case(f"{name}, self-calibrating", site, mine, truth, third)


def evaluate(case: Case) -> Result:
    """Track a case live and with lags."""
    scores: list[Score] = []
    for lag_s in LAGS_S:
        tracks: Tracks = track(case.site, case.readings, lag_s=lag_s).tracks
        scores.append(score(case.truth, select_rows(tracks, tracks.t_s >= case.from_s)))
    return Result(case, tuple(scores))


def main() -> None:
    """Print the table."""
    other = Path(sys.argv[1]) if len(sys.argv) > 1 else OTHER
    cases = list(plaza_cases())
    if (other / "lias_fast").is_dir():
        for target in ("tag0", "tag1", "tag2"):
            cases += folder_cases(other / "lias_fast", target)
    else:
        print(f"{other}: no recordings there; plaza only")
    print(f"{'':48s} {'live':>7s} {'2 s':>7s} {'5 s':>7s} {'in 95':>6s} {'NIS':>5s}")
    for case in cases:
        name, scores = case.name, evaluate(case).scores
        rmse = " ".join(f"{s.rmse_m:7.3f}" for s in scores)
        print(f"{name:48s} {rmse} {scores[0].inside_95:6.2f} {scores[0].nis:5.2f}", flush=True)


if __name__ == "__main__":
    main()
