"""Beacons by signal strength: recorded walks, a simulated home, time and memory.

Recorded walks are tracked on a site that was calibrated on a survey alone; columns are the
horizontal RMSE [m] after the first 10 s, live and 5 s later, and the share of truth inside the 95 %
ellipse. In the home of `room_world` (6 x 4 m, four receivers) errors are given at rest, walking,
and in all.

    python benchmarks/bench_rssi.py [FOLDER]    FOLDER holds recordings (ble_calibration, ble_...)
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from room_world import RoomRun, room_run

from trackfield.calibration.fingerprints import calibrate_fingerprints
from trackfield.filtering import rssi_tracker
from trackfield.filtering.scans import Scan
from trackfield.io.fingerprints import read_fingerprints
from trackfield.io.measurements import read_readings
from trackfield.io.truth import read_truth
from trackfield.metrics.score import Score, score
from trackfield.network.site import Site
from trackfield.network.site_file import site_from_toml
from trackfield.pipeline.runs import track_readings
from trackfield.pipeline.scanned import ScanTracker
from trackfield.types import Matrix, Readings, Tracks, Truth, Vector, select_rows

OTHER = Path(__file__).parents[2] / "shared" / "data"
SITE = '[site]\nsensors_file = "sensors.csv"\n[models.ble]\nkind = "rssi"\n'
FROM_S = 10.0  # a walk is scored from then on
HOMES = range(100, 110)  # seeds that nothing was chosen on


class Walk(NamedTuple):
    """A recorded walk and its bars, live and 5 s later [m]; what a particle filter had."""

    folder: str
    live_m: float
    late_m: float
    known_m: float


WALKS = (
    Walk("ble_straight_01", 1.55, 1.395, 1.66),
    Walk("ble_straight_03", 1.70, 1.53, 1.79),
    Walk("ble_rectangular_without_rotation", 2.70, 2.43, 2.92),
)


class Errors(NamedTuple):
    """How far from the truth a home's beacon was shown (rows,) [m], and which rows are of rests."""

    off_m: Vector
    resting: NDArray[np.bool_]


def site_of(folder: Path, survey: Path | None) -> Site:
    """Make the site of recorded walks, calibrated on a survey if there is one."""
    site = site_from_toml(SITE, folder, "site.toml")
    if survey is None:
        return site
    found = read_fingerprints(survey, sensor_ids=site.sensor_ids)
    return calibrate_fingerprints(site, found).site


def tracked(
    site: Site, readings: Readings, *, seed: int = 0, lag_s: float = 0.0, every_s: float = 0.0
) -> Tracks:
    """Track the beacon of a run."""
    beacon = rssi_tracker.create(site, seed=seed)
    tracker = ScanTracker(site, beacon, lag_s=lag_s, every_s=every_s)
    return track_readings(tracker, [readings]).tracks


def walk_scores(
    site: Site, folder: Path, *, seed: int = 0, every_s: float = 0.0
) -> tuple[Score, Score]:
    """Score a recorded walk live and 5 s later, at all rows or so far apart."""
    readings = read_readings(folder / "measurements.csv", sensor_ids=site.sensor_ids)
    truth = read_truth(folder / "truth.csv")
    begin = float(readings.t_s[0]) + FROM_S
    live, late = (
        tracked(site, readings, seed=seed, lag_s=lag_s, every_s=every_s) for lag_s in (0.0, 5.0)
    )
    scores = [score(truth, select_rows(rows, rows.t_s >= begin)) for rows in (live, late)]
    return scores[0], scores[1]


def home_errors(run: RoomRun) -> Errors:
    """Errors of the beacon in a home after the first 10 s."""
    rows = tracked(run.site, run.readings)
    rows = select_rows(rows, rows.t_s >= FROM_S)
    off = np.linalg.norm(rows.position[:, :2] - _at(run.truth, rows.t_s), axis=1)
    begin, end = run.rest.T
    resting = ((rows.t_s[:, None] >= begin) & (rows.t_s[:, None] <= end)).any(axis=1)
    return Errors(off, resting)


def homes(rate_hz: float) -> Errors:
    """Errors in homes of all `HOMES`, at so many readings a second and receiver."""
    every = [home_errors(room_run(seed, rate_hz=rate_hz, duration_s=300.0)) for seed in HOMES]
    return Errors(*(np.concatenate(parts) for parts in zip(*every, strict=True)))


def cost(site: Site, folder: Path) -> tuple[float, float, int]:
    """Time of a scan of one reading and of one of all receivers [ms], bytes of a state."""
    readings = read_readings(folder / "measurements.csv", sensor_ids=site.sensor_ids)
    count = len(site.sensor_ids)
    unsaid = np.full(len(readings), np.nan)
    single = [
        Scan(float(t), readings.sensor[[i]], readings.value[[i]], unsaid[[i]])
        for i, t in enumerate(readings.t_s)
    ]
    level = np.array([float(readings.value[readings.sensor == i].mean()) for i in range(count)])
    whole = [
        Scan(0.45 * k, np.arange(count, dtype=np.int32), level, unsaid[:count]) for k in range(120)
    ]
    tracker = rssi_tracker.create(site)
    best: list[float] = []
    size = 0
    for scans in (single, whole):
        times: list[float] = []
        for _ in range(3):
            begin, state = time.process_time(), tracker.start()
            for scan in scans:
                state = tracker.step(state, scan)
            times.append((time.process_time() - begin) / len(scans))
            size = len(tracker.pack(state))
        best.append(1e3 * min(times))
    return best[0], best[1], size


def main() -> None:
    """Print the tables."""
    other = Path(sys.argv[1]) if len(sys.argv) > 1 else OTHER
    survey = other / "ble_calibration" / "fingerprints.csv"
    if survey.is_file():
        print(f"{'':40s} {'live':>6s} {'bar':>6s} {'5 s':>6s} {'bar':>6s} {'in 95':>6s}")
        for walk in WALKS:
            folder = other / walk.folder
            for name, known in (("", survey), (", no survey", None)):
                live, late = walk_scores(site_of(folder, known), folder)
                told = (
                    f"{live.rmse_m:6.2f} {walk.live_m:6.2f} {late.rmse_m:6.2f} {walk.late_m:6.2f}"
                )
                print(f"{walk.folder + name:40s} {told} {live.inside_95:6.2f}", flush=True)
        one, twelve, size = cost(site_of(other / WALKS[0].folder, survey), other / WALKS[0].folder)
        print(
            f"a scan of 1 reading {one:.2f} ms, of 12 {twelve:.2f} ms; a state {size / 1e3:.0f} kB"
        )
    else:
        print(f"{other}: no recordings there; homes only")
    print(f"\n{'home, median and 95 % [m]':26s} {'all':>11s} {'resting':>11s} {'walking':>11s}")
    for rate_hz in (1.0, 4.0):
        off, resting = homes(rate_hz)
        parts = (off, off[resting], off[~resting])
        told = " ".join("{:5.2f} {:5.2f}".format(*np.percentile(part, [50, 95])) for part in parts)
        print(f"{rate_hz:g} Hz a receiver          {told}", flush=True)


def _at(truth: Truth, t_s: Vector) -> Matrix:
    """Where the truth is at times (n,), (n, 2)."""
    columns = [np.interp(t_s, truth.t_s, truth.position[:, axis]) for axis in (0, 1)]
    return np.column_stack(columns)


if __name__ == "__main__":
    main()
