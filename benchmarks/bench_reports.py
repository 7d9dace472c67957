"""Many unknown targets from reports: accuracy and cost of the trackers, side by side.

The scene: 12 targets that come, wander and go in 100 m x 100 m within 100 steps, reported with
probability .73 and .4 m noise per axis, among 6 false reports a step. Everything a tracker shows
counts at the step it is shown. All trackers take the same steps in turn in one process, so that a
busy machine slows all of them alike; times are of the processor.

    python benchmarks/bench_reports.py [seeds]
"""

from __future__ import annotations

import datetime
import math
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.metrics.many import Measure, score_many
from trackfield.raster import Raster, Region
from trackfield.types import Matrix, Tracks, Truth

STEPS, BLOCK, SIDE_M = 100, 20, 100.0
ACCEL, SIGMA_M, P_DETECTION = 0.15, 0.4, 0.73
REGION = Region(0.0, 0.0, SIDE_M, SIDE_M)
F = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1.0]])
G = np.array([[0.5, 0], [0, 0.5], [1, 0], [0, 1.0]])

Shown = Iterator[tuple[int, float, float]]  # identity, x, y
Step = Callable[[int, Matrix], Shown]
"""Takes the reports (n, 2) of a step, and tells what is shown after it."""

DEFAULT = BernoulliSettings()


class World(NamedTuple):
    """True states (targets, STEPS, 4), NaN where a target is not there; reports of every step."""

    truth: Matrix
    reports: list[Matrix]


class Kind(NamedTuple):
    """How crowded a world is."""

    targets: int = 12
    false: float = 6.0


ORDINARY, DENSE = Kind(), Kind(40, 20.0)


class Score(NamedTuple):
    """GOSPA (c 5 m, p 2), identity switches, MOTA, and processor time of every step [s]."""

    gospa: float
    switches: int
    mota: float
    seconds: list[float]


def world(seed: int, kind: Kind = ORDINARY) -> World:
    """Draw targets that stay for at least 20 steps, and their reports."""
    rng = np.random.default_rng(1000 + seed)
    truth = np.full((kind.targets, STEPS, 4), np.nan)
    made = 0
    while made < kind.targets:
        path = _path(rng, first=int(rng.integers(0, 60)) if made > 2 else 0)
        if np.isfinite(path[:, 0]).sum() >= 20:
            truth[made] = path
            made += 1
    reports: list[Matrix] = []
    for t in range(STEPS):
        rows = [
            state[:2] + SIGMA_M * rng.standard_normal(2)
            for state in truth[:, t]
            if np.isfinite(state[0]) and rng.random() < P_DETECTION
        ]
        rows += [rng.uniform(0, SIDE_M, 2) for _ in range(rng.poisson(kind.false))]
        reports.append(np.array([rows[j] for j in rng.permutation(len(rows))]).reshape(-1, 2))
    return World(truth, reports)


def _path(rng: np.random.Generator, first: int) -> Matrix:
    last = min(STEPS, first + int(rng.integers(30, 70)))
    heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.5)
    x = np.array([*rng.uniform(10, 90, 2), speed * np.cos(heading), speed * np.sin(heading)])
    path = np.full((STEPS, 4), np.nan)
    for t in range(first, last):
        if t > first:
            x = F @ x + G @ (ACCEL * rng.standard_normal(2))
        if (x[:2] < 0).any() or (x[:2] > SIDE_M).any():
            break
        path[t] = x
    return path


def ordinary(kind: Kind = ORDINARY) -> Scene:
    """Know the reports; of targets only what anybody would guess."""
    reporting = Reporting(REGION, 1.0, SIGMA_M, (P_DETECTION,), kind.false)
    return Scene(reporting, Targets(ACCEL, births_per_s=0.1 * kind.targets / 12))


def unknown() -> Scene:
    """Noise, detection and false reports are learned."""
    return Scene(Reporting(REGION), Targets(ACCEL))


def true_priors() -> Scene:
    """Know how long targets stay, where and how often they appear (until step 60)."""
    stay = [0.0] * 29 + [1 / (40 - k) for k in range(39)] + [0.5]
    box = np.zeros((10, 10))
    box[1:9, 1:9] = 1.0
    targets = Targets(
        ACCEL,
        hazard=tuple(stay),
        births_per_s=0.15,
        initial_count=3.0,
        birth_map=Raster(REGION, box),
    )
    return Scene(ordinary().reporting, targets)


def ours(
    scene: Scene,
    settings: BernoulliSettings = DEFAULT,
    *,
    last_birth: int = STEPS,
) -> Step:
    """Make the Bernoulli mixture; after `last_birth` it is told that nobody comes any more."""
    closed = Scene(scene.reporting, _without_births(scene.targets))
    trackers = Bernoulli(scene, settings), Bernoulli(closed, settings)
    held = {"state": trackers[0].initial()}

    def step(t: int, position: Matrix) -> Shown:
        tracker = trackers[t >= last_birth]
        number = np.arange(len(position), dtype=np.int32) + 1000 * t
        scan = ReportScan(float(t), position, np.full((len(position), 3), np.nan), number)
        held["state"], _ = tracker.step(held["state"], scan)
        found = tracker.estimates(held["state"])
        for k in np.flatnonzero(found.shown):
            yield int(found.track[k]), float(found.mean[k, 0]), float(found.mean[k, 1])

    return step


def _without_births(targets: Targets) -> Targets:
    return Targets(
        targets.accel_sigma_m_s2,
        targets.velocity_sigma_m_s,
        targets.lifetime_s,
        targets.hazard,
        births_per_s=0.0,
        birth_map=targets.birth_map,
    )


def stonesoup_gnn(min_points: int = 3, gate: float = 3.0, misses: int = 3) -> Step:
    """Make Stone Soup's global nearest neighbour, tuned on other seeds."""
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    start = datetime.datetime(2024, 1, 1, tzinfo=datetime.UTC)
    motion = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=F, covariance_matrix=ACCEL**2 * G @ G.T + 1e-9 * np.eye(4)
    )
    predictor = KalmanPredictor(motion)
    sensor = LinearGaussian(4, (0, 1), SIGMA_M**2 * np.eye(2))
    updater = KalmanUpdater(sensor)
    hypotheses = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=gate)
    associator = GNNWith2DAssignment(hypotheses)
    prior = GaussianState(np.zeros((4, 1)), np.diag([0.0, 0.0, 1.0, 1.0]), timestamp=start)
    starting = GNNWith2DAssignment(hypotheses)
    initiator = MultiMeasurementInitiator(
        prior, UpdateTimeStepsDeleter(2), starting, updater, sensor, min_points=min_points
    )
    deleter = UpdateTimeStepsDeleter(misses)
    held: dict[str, Any] = {"tracks": set(), "names": {}}

    def step(t: int, position: Matrix) -> Shown:
        now = start + datetime.timedelta(seconds=t)
        detections = {Detection(z.reshape(2, 1), timestamp=now) for z in position}
        used: set[Detection] = set()
        for track, hypothesis in associator.associate(held["tracks"], detections, now).items():
            if hypothesis:
                track.append(updater.update(hypothesis))
                used.add(hypothesis.measurement)
            else:
                track.append(hypothesis.prediction)
        held["tracks"] -= deleter.delete_tracks(held["tracks"], timestamp=now)
        held["tracks"] |= initiator.initiate(detections - used, now)
        for track in held["tracks"]:
            name = held["names"].setdefault(track.id, len(held["names"]) + 1)
            yield name, float(track.state_vector[0, 0]), float(track.state_vector[1, 0])

    return step


def scored(step: Step, given: World) -> Score:
    """Run one tracker alone."""
    return compare({"one": step}, given)["one"]


def compare(steps: dict[str, Step], given: World) -> dict[str, Score]:
    """Run trackers through a world, some steps of each in turn."""
    rows: dict[str, list[tuple[float, float, float, float]]] = {name: [] for name in steps}
    seconds: dict[str, list[float]] = {name: [] for name in steps}
    for block in range(0, STEPS, BLOCK):
        for name, step in steps.items():
            for t in range(block, block + BLOCK):
                before = time.process_time()
                shown = list(step(t, given.reports[t]))
                seconds[name].append(time.process_time() - before)
                rows[name] += [(float(t), *row) for row in shown]
    truth = _truth(given.truth)
    found: dict[str, Score] = {}
    for name in steps:
        score = score_many(truth, _tracks(rows[name]), measure=Measure(cutoff_m=5.0, order=2.0))
        mota = score.clear_mot.mota
        found[name] = Score(
            score.sets.gospa_m,
            score.clear_mot.switches,
            0.0 if mota is None else mota,
            seconds[name],
        )
    return found


def _truth(states: Matrix) -> Truth:
    target, step = np.nonzero(np.isfinite(states[:, :, 0]))
    order = np.lexsort((target, step))
    target, step = target[order], step[order]
    position = np.column_stack([states[target, step, :2], np.full(len(step), np.nan)])
    names = tuple(str(i) for i in range(len(states)))
    return Truth(step.astype(np.float64), target.astype(np.int32), position, names)


def _tracks(rows: list[tuple[float, float, float, float]]) -> Tracks:
    table = np.array(rows).reshape(-1, 4)
    n = len(table)
    blank = np.full((n, 3), np.nan)
    return Tracks(
        t_s=table[:, 0],
        track=table[:, 1].astype(np.int32),
        position=np.column_stack([table[:, 2:], np.full(n, np.nan)]),
        velocity=blank,
        covariance=blank,
        status=np.ones(n, dtype=np.int32),
        target=np.full(n, -1, dtype=np.int32),
        nis=np.full(n, np.nan),
        target_ids=(),
    )


def contestants() -> dict[str, Step]:
    """Make all trackers anew."""
    steps = {
        "ordinary priors": ours(ordinary()),
        "everything learned": ours(unknown()),
        "true priors": ours(true_priors(), last_birth=60),
        "JIPDA collapse": ours(ordinary(), BernoulliSettings(recent_scans=0)),
        "propagation only": ours(ordinary(), BernoulliSettings(cluster_work=0)),
    }
    try:
        steps["Stone Soup GNN"] = stonesoup_gnn()
    except ModuleNotFoundError:
        print("Stone Soup is not installed (make bench installs it)", file=sys.stderr)
    return steps


def table(title: str, scores: list[dict[str, Score]]) -> None:
    """Print the means over worlds, and the cost of a step."""
    print(title)
    for name in scores[0]:
        mine = [score[name] for score in scores]
        seconds = 1e3 * np.concatenate([score.seconds for score in mine])
        print(
            f"{name:20s} GOSPA {np.mean([s.gospa for s in mine]):.3f} m   "
            f"switches {np.mean([s.switches for s in mine]):.1f}   "
            f"MOTA {np.mean([s.mota for s in mine]):.3f}   "
            f"{np.median(seconds):.3f} ms a step (mean {seconds.mean():.3f}, "
            f"99 % {np.percentile(seconds, 99):.2f})"
        )


def crowd(spacing_m: float, *, targets: int = 100, false: float = 50.0, steps: int = 40) -> None:
    """Print the cost of targets that walk abreast, as far apart as told."""
    rng = np.random.default_rng(0)
    scene = Scene(
        Reporting(REGION, 1.0, SIGMA_M, (P_DETECTION,), false), Targets(initial_count=targets)
    )
    step, seconds = ours(scene), []
    x = np.column_stack(
        [50.0 + spacing_m * (np.arange(targets) - targets / 2), np.full(targets, 20.0)]
    )
    for t in range(steps):
        x = x + np.array([0.0, 0.8]) + 0.05 * rng.standard_normal(x.shape)
        seen = x[rng.random(targets) < P_DETECTION]
        seen = seen + SIGMA_M * rng.standard_normal(seen.shape)
        reports = np.concatenate([seen, rng.uniform(0, SIDE_M, (rng.poisson(false), 2))])
        before = time.process_time()
        list(step(t, reports))
        seconds.append(time.process_time() - before)
    print(
        f"{targets} abreast, {spacing_m:g} m apart: {1e3 * np.mean(seconds):.1f} ms a step, "
        f"at most {1e3 * np.max(seconds):.1f}"
    )


def growth() -> None:
    """Print how the cost of a step grows with the number of targets at the same density."""
    counts, costs = (25, 50, 100, 200, 400), []
    for n in counts:
        rng = np.random.default_rng(n)
        side, false = SIDE_M * math.sqrt(n / 12), n / 2.0
        region = Region(0.0, 0.0, side, side)
        reporting = Reporting(region, 1.0, SIGMA_M, (P_DETECTION,), false)
        step = ours(Scene(reporting, Targets(births_per_s=n / 120, initial_count=n)))
        x, v, seconds = rng.uniform(0, side, (n, 2)), rng.normal(0, 0.7, (n, 2)), []
        for t in range(25):
            x = x + v
            v = np.where((x < 0) | (x > side), -v, v)
            seen = x[rng.random(n) < P_DETECTION]
            seen = seen + SIGMA_M * rng.standard_normal(seen.shape)
            reports = np.concatenate([seen, rng.uniform(0, side, (rng.poisson(false), 2))])
            before = time.process_time()
            list(step(t, reports))
            seconds.append(time.process_time() - before)
        costs.append(float(np.median(seconds[5:])))
        print(f"{n} targets: {1e3 * costs[-1]:.2f} ms a step")
    print(f"grows with the power {np.polyfit(np.log(counts), np.log(costs), 1)[0]:.2f}")


def main() -> None:
    """Print accuracy and cost of all trackers."""
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
    table("12 targets, 6 false reports", [compare(contestants(), world(s)) for s in seeds])
    dense = [compare({"dense": ours(ordinary(DENSE))}, world(s, DENSE)) for s in seeds]
    table("40 targets, 20 false reports", dense)
    for spacing_m in (0.5, 1.0, 2.0):
        crowd(spacing_m)
    growth()


if __name__ == "__main__":
    main()
