"""Twelve targets, reports and false alarms: the run that all trackers of reports are compared on.

A region of 100 x 100 m over 100 steps of a second. Three targets begin at once, the others within
60 s; each lives up to 70 s, at least 20 of them inside. Accelerations of .15 m/s^2, reports with
probability .73 and noise of .4 m, six false ones a step. Seeds 0 to 9 are for judging, 100 and up
for choosing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.association.contract import AnyAssociator, ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.metrics.many import ManyScore, Measure, score_steps
from trackfield.metrics.steps import side_by_side
from trackfield.raster import Raster, Region
from trackfield.types import Matrix, Status, Tracks, Truth

STEPS, SIDE_M, TARGETS = 100, 100.0, 12
ACCEL_SIGMA, SIGMA_M, P_DETECTION, FALSE_PER_SCAN = 0.15, 0.4, 0.73, 6.0
MATCH_M = 3.0
REGION = Region(0.0, 0.0, SIDE_M, SIDE_M)
LAST_BIRTH = 60  # the step from which on nobody comes


def scene(*, targets: int = TARGETS, false_per_scan: float = FALSE_PER_SCAN) -> Scene:
    """Tell trackers the region, rates and noise; of targets what anybody would guess."""
    reporting = Reporting(REGION, 1.0, SIGMA_M, (P_DETECTION,), false_per_scan)
    return Scene(reporting, Targets(ACCEL_SIGMA, births_per_s=0.1 * targets / TARGETS))


def true_priors() -> Scene:
    """Know too how long targets stay, and how often and where they appear until `LAST_BIRTH`."""
    stay = [0.0] * 29 + [1 / (40 - k) for k in range(39)] + [0.5]
    box = np.zeros((10, 10))
    box[1:9, 1:9] = 1.0
    targets = Targets(
        ACCEL_SIGMA,
        hazard=tuple(stay),
        births_per_s=0.15,
        initial_count=3.0,
        birth_map=Raster(REGION, box),
    )
    return Scene(scene().reporting, targets)


SCENE = scene()
UNKNOWN = Scene(Reporting(REGION), Targets(ACCEL_SIGMA))
"""Noise, detection and false reports are learned."""


class Run(NamedTuple):
    """Scans of reports, the truth, and which target (-1: none) made each report."""

    scans: tuple[ReportScan, ...]
    truth: Truth
    source: np.ndarray


def draw(seed: int, *, targets: int = TARGETS, false_per_scan: float = FALSE_PER_SCAN) -> Run:
    """Draw a run; the same seed gives the same one."""
    rng = np.random.default_rng(1000 + seed)
    paths = np.full((targets, STEPS, 2), np.nan)
    drawn = 0
    while drawn < targets:
        path = _path(rng, first=drawn <= 2)
        if np.count_nonzero(~np.isnan(path[:, 0])) >= 20:
            paths[drawn] = path
            drawn += 1
    rows = [_scan(rng, paths[:, t], false_per_scan) for t in range(STEPS)]
    ends = np.cumsum([len(row) for row in rows])
    scans = tuple(
        ReportScan(
            float(t),
            row[:, :2].copy(),
            np.full((len(row), 3), np.nan),
            np.arange(end - len(row), end, dtype=np.int32),
        )
        for t, (row, end) in enumerate(zip(rows, ends, strict=True))
    )
    who, t = np.nonzero(~np.isnan(paths[..., 0]))
    position = np.column_stack([paths[who, t], np.full(who.size, np.nan)])
    names = tuple(str(i) for i in range(targets))
    truth = Truth(t.astype(np.float64), who.astype(np.int32), position, names)
    return Run(scans, truth, np.concatenate([row[:, 2] for row in rows]).astype(np.int32))


def shown_by(tracker: AnyAssociator, run: Run) -> Tracks:
    """Rows that a tracker shows at each step, with lag 0."""
    state, rows = tracker.initial(), []
    for scan in run.scans:
        state, _ = tracker.step(state, scan)
        found = tracker.estimates(state)
        kept = np.flatnonzero(found.shown)
        at = np.full(kept.size, scan.t_s)
        rows.append(np.column_stack([at, found.track[kept], found.mean[kept, :2]]))
    return tracks_of(np.concatenate(rows))


def tracks_of(rows: Matrix) -> Tracks:
    """Make tracks of rows (n, 4) t, track, x, y."""
    n = len(rows)
    return Tracks(
        t_s=rows[:, 0],
        track=rows[:, 1].astype(np.int32),
        position=np.column_stack([rows[:, 2:], np.full(n, np.nan)]),
        velocity=np.zeros((n, 3)),
        covariance=np.zeros((n, 3)),
        status=np.full(n, Status.CONFIRMED, np.int32),
        target=np.full(n, -1, np.int32),
        nis=np.full(n, np.nan),
        target_ids=(),
    )


def judge(run: Run, tracks: Tracks) -> ManyScore:
    """Score what was shown at all steps: GOSPA of c = 5 m, p = 2; matches within 3 m."""
    steps = side_by_side(run.truth, tracks, times_s=np.arange(float(STEPS)))
    return score_steps(steps, measure=Measure(match_m=MATCH_M))


def _path(rng: np.random.Generator, *, first: bool) -> Matrix:
    """Positions (STEPS, 2) of a target that ends when it leaves; NaN where it is not there."""
    begin = 0 if first else int(rng.integers(0, 60))
    end = min(STEPS, begin + int(rng.integers(30, 70)))
    heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.5)
    place = rng.uniform(10, SIDE_M - 10, 2)
    velocity = speed * np.array([np.cos(heading), np.sin(heading)])
    path = np.full((STEPS, 2), np.nan)
    for t in range(begin, end):
        if t > begin:
            push = ACCEL_SIGMA * rng.standard_normal(2)
            place, velocity = place + velocity + 0.5 * push, velocity + push
        if np.any((place < 0) | (place > SIDE_M)):
            break
        path[t] = place
    return path


def _scan(rng: np.random.Generator, places: Matrix, false_per_scan: float) -> Matrix:
    """Draw the reports (m, 3) of one step, x, y, source, in any order."""
    rows = [
        (*(places[who] + SIGMA_M * rng.standard_normal(2)), who)
        for who in range(len(places))
        if not np.isnan(places[who, 0]) and rng.random() < P_DETECTION
    ]
    rows += [(*rng.uniform(0, SIDE_M, 2), -1) for _ in range(rng.poisson(false_per_scan))]
    return np.array([rows[i] for i in rng.permutation(len(rows))]).reshape(-1, 3)
