"""Passes through Pham's field under a soft or a hard bound, until batteries are empty."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments.pham_soft_paths import SIDE_M, SIGMA_M
from trackfield.filtering import kalman
from trackfield.motion import SteppedAcceleration
from trackfield.raster import Region
from trackfield.scheduling import soft_bound, soft_tracking, soft_weights
from trackfield.scheduling.cheapest import cheapest
from trackfield.scheduling.soft_bound import Asked, Care
from trackfield.scheduling.soft_tracking import Info, Request, Rule, Service, State
from trackfield.sensing.range import RangeModel
from trackfield.sensing.range_outlook import outlook, standing
from trackfield.types import Gaussian, Matrix, Vector

REACH_M = 1.4
BATTERY = 30  # readings
MODEL = RangeModel(sigma_m=SIGMA_M, max_range_m=REACH_M)
FIELD = Region(-0.3, -0.3, SIDE_M + 0.3, SIDE_M + 0.3)
_SPREAD_SIGMAS = 1.3  # of a prediction an axis, as demand sees it
_START_SIGMAS = (2.0, 1.0)  # of position and of velocity a second, when a target is handed over


class Runs(NamedTuple):
    """Runs side by side: `sensors` (r, n, 2), `paths` (r, passes, 25, 2) [m].

    `bound` (r,) in sigma^2, `agility` (r,) is q/s: the standard deviation of the acceleration that
    the filter allows for, in sigma/s^2; `demand` (r, n) weighs the nodes, and `geometry` (r,)
    chooses without regard to batteries.
    """

    sensors: Matrix
    paths: Matrix
    bound: Vector
    agility: Vector
    demand: Matrix
    geometry: NDArray[np.bool_]


class Outcome(NamedTuple):
    """What happened in each interval, (steps, r), and when the first node was empty.

    `asked` sensors; `kept` (1 or 0): a set under the bound was found, and what was heard kept it;
    `error` [sigma]; `distance2` of the error under the covariance (2 on the average if honest);
    `first_death` (r,) in intervals, 0 if nobody died.
    """

    asked: Matrix
    kept: Matrix
    error: Matrix
    distance2: Matrix
    first_death: NDArray[np.int64]


def some(runs: Runs, rows: NDArray[np.intp]) -> Runs:
    """Take some of the runs, or the same one more than once."""
    return Runs(
        runs.sensors[rows],
        runs.paths[rows],
        runs.bound[rows],
        runs.agility[rows],
        runs.demand[rows],
        runs.geometry[rows],
    )


def simulate(
    runs: Runs,
    rng: np.random.Generator,
    *,
    hard: bool = False,
    judged: NDArray[np.int64] | None = None,
) -> Outcome:
    """Track pass after pass, each from a fresh hand-over, each reading out of a battery.

    Under the soft bound, or the `hard` one on snapshots of three sensors, with the same filter.
    Each run takes part in the first `judged` (r,) passes (all), and in later ones until its first
    node is empty; the outcome is NaN where it did not, and ends with the passes that are judged.
    """
    count, passes, steps = runs.paths.shape[:3]
    told = np.full(count, passes) if judged is None else judged
    energy = np.full(runs.sensors.shape[:2], float(BATTERY))
    death = np.zeros(count, np.int64)
    table = np.full((4, int(told.max()) * steps, count), np.nan)
    for i in range(passes):
        left = np.flatnonzero((i < told) | (death == 0))
        if not left.size:
            break
        now = some(runs, left)
        for k, (row, rest) in enumerate(_passed(now, i, energy[left], rng, hard=hard)):
            energy[left] = rest
            if i < told.max():
                table[:, i * steps + k, left] = row
            death[(energy < 1.0).any(axis=1) & (death == 0)] = i * steps + k + 1
    asked, kept, error, distance2 = table
    return Outcome(asked, kept, error, distance2, death)


def _passed(
    runs: Runs, which: int, energy: Matrix, rng: np.random.Generator, *, hard: bool
) -> Iterator[tuple[Matrix, Matrix]]:
    """Track one pass; yield what came of each interval, and the energy that it left."""
    service = Service(MODEL, runs.bound * SIGMA_M**2, field=FIELD)
    rule = snapshots(runs.geometry) if hard else soft_bound.choose
    way = runs.paths[:, which]
    state = soft_tracking.init(_handed_over(way, rng))
    for k in range(way.shape[1]):
        predicted = _predicted(state, runs.agility) if k else state
        request = soft_tracking.ask(
            predicted,
            runs.sensors,
            service=service,
            weights=_weights(runs, energy),
            rule=rule,
        )
        z = _heard(request, runs.sensors, way[:, k], rng)
        state, info = soft_tracking.hear(
            predicted, request, z, sensors=runs.sensors, service=service
        )
        energy = energy - _spent(request, energy.shape)
        yield _judged(state.belief, way[:, k], request, info), energy


def demand(sensors: Matrix, places: Matrix) -> Matrix:
    """Shares (r, n) of the demand of sensors (r, n, 2) by the `places` (r, m, 2) of past passes."""
    return np.array(
        [
            soft_weights.shares(c, p, reach_m=REACH_M, spread_m=_SPREAD_SIGMAS * SIGMA_M)
            for c, p in zip(sensors, places, strict=True)
        ]
    )


def snapshots(geometry: NDArray[np.bool_]) -> Rule:
    """Give the rule of the hard bound: three sensors that locate the target alone, Pham (5.4).

    By `geometry` (r,) the three that do it best, whatever their batteries hold.
    """

    def choose(
        prior: Gaussian,
        sensors: Matrix,
        *,
        models: RangeModel,
        bound_m2: float | Vector,
        weights: Vector,
        care: Care,
    ) -> Asked:
        seen = outlook(models, sensors, position=standing(prior, 2))
        reach = seen.distance + care.edge_sigmas * seen.along
        sure = (reach <= models.max_range_m) & np.isfinite(weights)
        choice = cheapest(
            np.zeros((2, 2)),
            seen.unit / models.sigma_m,
            weights=np.where(sure, weights, np.inf),
            bound=np.where(geometry, 0.0, bound_m2),
            limits=(3, 3),
        )
        return Asked(choice._replace(feasible=choice.trace <= bound_m2), sure)

    return choose


def _weights(runs: Runs, energy: Matrix) -> Matrix:
    scarce = soft_weights.weights(np.maximum(energy, 0.0), runs.demand)
    return np.where(runs.geometry[:, None] & np.isfinite(scarce), 1.0, scarce)


def _handed_over(paths: Matrix, rng: np.random.Generator) -> Gaussian:
    """Beliefs about the beginnings of `paths` (r, 25, 2), off by as much as they say."""
    spread = np.repeat(np.array(_START_SIGMAS) * SIGMA_M, 2)
    begun = np.concatenate([paths[:, 0], paths[:, 1] - paths[:, 0]], axis=1)
    covariance = np.broadcast_to(np.diag(spread**2), (len(paths), 4, 4))
    return Gaussian(begun + spread * rng.standard_normal(begun.shape), covariance)


def _predicted(state: State, agility: Vector) -> State:
    unit = SteppedAcceleration((SIGMA_M**2, SIGMA_M**2))
    noise = agility[:, None, None] ** 2 * unit.noise(1.0)
    return state._replace(belief=kalman.predict(state.belief, unit.transition(1.0), noise))


def _heard(request: Request, sensors: Matrix, truth: Matrix, rng: np.random.Generator) -> Matrix:
    """Draw what the asked sensors hear of targets at `truth` (r, 2): ranges, or NaN."""
    at = sensors[np.arange(len(truth))[:, None], np.maximum(request.sensors, 0)]
    r: Matrix = np.linalg.norm(at - truth[:, None], axis=-1)
    hears = (request.sensors >= 0) & (r <= REACH_M)
    return np.where(hears, r + SIGMA_M * rng.standard_normal(r.shape), np.nan)


def _judged(belief: Gaussian, truth: Matrix, request: Request, info: Info) -> Matrix:
    """Rows (4, r) of `Outcome` for one interval: asked, kept, error, distance2."""
    mean, covariance = standing(belief, 2)
    off = mean - truth
    distance2 = (off * np.linalg.solve(covariance, off[..., None])[..., 0]).sum(axis=-1)
    row = np.empty((4, len(off)))
    row[0] = (request.sensors >= 0).sum(axis=1)
    row[1] = request.choice.feasible & info.kept
    row[2] = np.linalg.norm(off, axis=1) / SIGMA_M
    row[3] = distance2
    return row


def _spent(request: Request, shape: tuple[int, ...]) -> Matrix:
    """Count readings (r, n) that were asked for."""
    spent = np.zeros((shape[0], shape[1] + 1))
    rows = np.broadcast_to(np.arange(shape[0])[:, None], request.sensors.shape)
    np.add.at(spent, (rows, request.sensors), 1.0)  # -1, nobody, is the last column
    return spent[:, :-1]
