"""Wang 4.3 and what it leaves out: roads with a corner, matched motion, bad starts, blocked ranges.

Each part runs its filters on the same readings and keeps what tables and figures need.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackfield.experiments import wang_contest as contest
from trackfield.experiments.wang_contest import Race, Rule
from trackfield.filtering.converted import Mode
from trackfield.filtering.robust import Student
from trackfield.motion import SteppedAcceleration
from trackfield.pipeline.tagged import track
from trackfield.simulation import roads, tagged
from trackfield.simulation.roads import Drive, End, Nlos
from trackfield.types import Gaussian, Matrix, Vector

PAPER = "KF+MLE (paper)"
MLE = "MLE alone"
EKF = "EKF"
ADDITIVE = "EKF, additive noise only"
THREE = "EKF, nearest three sensors"
IEKF = "IEKF"
SAFE = "KF+MLE, safeguarded"
ROBUST = "IEKF, Student weights"
LIVE = "default tracker, live"
LAGGED = "default tracker, lag 10"
LAG_STEPS = 10

RULES: dict[str, Rule] = {
    PAPER: contest.kf_mle(Mode.PAPER),
    EKF: contest.ekf,
    ADDITIVE: contest.ekf_additive,
    THREE: contest.ekf_three,
    IEKF: contest.iekf(),
    SAFE: contest.kf_mle(Mode.SAFE),
    ROBUST: contest.iekf(Student()),
}
ROAD_ACCEL = (0.025, 0.025)  # of the paper's filters
MATCHED_ACCEL = (0.025, 0.01)  # of the paper's target
BAD_START_M = 2.0  # wrong by this on each axis
START_COVARIANCE = 0.01 * np.eye(4)


class Entry(NamedTuple):
    """How one filter fared.

    Mean square error per axis of each run (runs,) and over time (K,) [m^2], mean NEES (None where
    there is none), and the first run's track (K, 2).
    """

    square: Vector
    over_time: Vector
    nees: float | None
    track: Matrix


class Outcome(NamedTuple):
    """One part: its filters by name, the least RMSE per axis (K,) [m], and the last drive."""

    entries: dict[str, Entry]
    bound: Vector
    drive: Drive


class Part(NamedTuple):
    """How much to run: drives, runs on each, steps of each (matched drives only)."""

    drives: int
    runs: int
    steps: int = 400


Tick = Callable[[], None]


def run(races: list[Race], names: tuple[str, ...], *, tick: Tick) -> Outcome:
    """Run filters over races of equal length; runs of all races count as one set."""
    entries: dict[str, Entry] = {}
    for name in names:
        parts = [contest.follow(RULES[name], race) for race in races]
        shown = [part.position for part in parts]
        nees = float(np.mean([part.nees for part in parts]))
        entries[name] = _entry(races, shown, nees=nees)
        if name == PAPER:
            fixes = [part.prelocalized for part in parts]
            entries[MLE] = _entry(races, [fix for fix in fixes if fix is not None], nees=None)
        tick()
    bounds = np.array([contest.bound(race) for race in races])
    return Outcome(entries, np.sqrt((bounds**2).mean(axis=0)), races[-1].drive)


def road(
    rng: np.random.Generator,
    end: End,
    *,
    runs: int,
    from_m: float = 0.0,
    nlos: Nlos | None = None,
) -> Race:
    """Prepare Wang 4.3: to C or D round the corner, with the paper's starts and noise."""
    drive = roads.follow_road(rng, end, from_m=from_m)
    return Race(
        drive=drive,
        ranges=roads.ranges(rng, drive, runs=runs, nlos=nlos),
        start=Gaussian(roads.starts(rng, drive, runs=runs), START_COVARIANCE),
        motion=SteppedAcceleration(ROAD_ACCEL),
        model=roads.RANGES,
        dt_s=roads.DT_S,
    )


def matched(rng: np.random.Generator, part: Part) -> list[Race]:
    """Drives whose motion is really that of the filters' model."""
    races: list[Race] = []
    for _ in range(part.drives):
        drive = roads.matched(rng, steps=part.steps, accel_variance=MATCHED_ACCEL)
        races.append(
            Race(
                drive=drive,
                ranges=roads.ranges(rng, drive, runs=part.runs),
                start=Gaussian(roads.starts(rng, drive, runs=part.runs), START_COVARIANCE),
                motion=SteppedAcceleration(MATCHED_ACCEL),
                model=roads.RANGES,
                dt_s=roads.DT_S,
            )
        )
    return races


def bad_starts(rng: np.random.Generator, part: Part) -> list[Race]:
    """Prepare matched drives with starts wrong by 2 m on each axis; the filters are told so."""
    covariance = np.diag([BAD_START_M**2, BAD_START_M**2, 0.01, 0.01])
    spoiled: list[Race] = []
    for race in matched(rng, part):
        mean = race.start.mean.copy()
        signs = rng.choice([-1.0, 1.0], (part.runs, 2))
        mean[:, :2] = race.drive.start[:2] + BAD_START_M * signs
        spoiled.append(race._replace(start=Gaussian(mean, covariance)))
    return spoiled


def default_tracker(race: Race) -> dict[str, Entry]:
    """Run the default tracker on the same readings: told of no start, live and with a lag.

    Steps before it has a track are left out of its errors: the first, seldom more.
    """
    runs = len(race.ranges)
    site = roads.site(race.drive, model=race.model)
    names = tuple(str(i) for i in range(runs))
    readings = tagged.to_readings(race.drive.t_s, race.ranges, site.sensor_ids, names)
    entries: dict[str, Entry] = {}
    for name, lag in ((LIVE, 0), (LAGGED, LAG_STEPS)):
        rows = track(site, readings, lag_steps=lag).tracks
        run_of = np.array([int(target) for target in rows.target_ids])[rows.target]
        step = np.rint(rows.t_s / race.dt_s).astype(np.int64) - 1
        position = np.full((len(race.drive.t_s), runs, 2), np.nan)
        position[step, run_of] = rows.position[:, :2]
        entries[name] = _entry([race], [position], nees=None)
    return entries


def _entry(races: list[Race], shown: list[Matrix], *, nees: float | None) -> Entry:
    square = [contest.squares(p, race.drive) for p, race in zip(shown, races, strict=True)]
    first = np.isnan(square[0]).all(axis=1)  # steps without any track
    whole = np.concatenate(square, axis=1)
    over_time = np.full(first.shape, np.nan)
    over_time[~first] = np.nanmean(whole[~first], axis=1)
    return Entry(np.nanmean(whole, axis=0), over_time, nees, shown[0][:, 0])
