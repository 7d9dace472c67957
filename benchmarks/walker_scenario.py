"""Walkers on a field of binary sensors, and what "right" means for a run.

12 x 12 nodes at 5 m, R 7.62 m, p .7, q .05, 10 % of messages lost, 6 nodes dead; 75 s. Times of
entry, edges, speeds and manners of walking differ, so that nothing is tuned to one generator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from trackfield.association.detect import Detect, ReadingScan
from trackfield.sensing.detection import DetectionModel, simulate
from trackfield.types import Matrix, Vector

SIDE_M, GATE_M, DURATION_S = 55.0, 6.0, 75.0
GRID = np.array([(5.0 * j, 5.0 * i) for i in range(12) for j in range(12)])
MODEL = DetectionModel()
Shown = Mapping[int, tuple[float, float]]


class Ways(NamedTuple):
    """How walkers walk.

    `kind` is "edges" (each from another edge to the one across), "cross" (any edges, also the same)
    or "centre" (all meet in the middle, at any angles); `turning` is in rad per root of a second.
    """

    kind: str = "edges"
    speed_m_s: tuple[float, float] = (1.2, 1.2)
    turning: float = 0.0
    stops: bool = False


class Run(NamedTuple):
    """Values (steps, n) of scans, true positions (steps, k, 2) (NaN: not there), dead nodes."""

    times: Vector
    values: NDArray[np.int8]
    truth: Matrix
    dead: NDArray[np.intp]


class Field(NamedTuple):
    """What sensors are and say: once in `step_s`, their silence too with `says_zero`."""

    model: DetectionModel = MODEL
    step_s: float = 1.0
    says_zero: bool = False


def draw(seed: int, k: int, *, ways: Ways = Ways(), field: Field = Field()) -> Run:  # noqa: B008 - immutable
    """Draw a run of `k` walkers."""
    rng = np.random.default_rng(seed)
    times = np.arange(1, round(DURATION_S / field.step_s) + 1) * field.step_s
    edges, meeting = rng.permutation(4), float(rng.uniform(30.0, 40.0))
    truth = np.full((len(times), k, 2), np.nan)
    for j in range(k):
        path = _path(rng, ways, edge=int(edges[j % 4]), meeting=meeting)
        there = (times >= path[0, 0]) & (times <= path[-1, 0])
        for axis in range(2):
            truth[there, j, axis] = np.interp(times[there], path[:, 0], path[:, 1 + axis])
    dead = rng.choice(len(GRID), 6, replace=False)
    alive = ~np.isin(np.arange(len(GRID)), dead)
    said = simulate(field.model, GRID, paths=truth, rng=rng, delivery=0.9, alive=alive)
    values = np.where(said.received, 1, -1)
    if field.says_zero:
        heard = (rng.random(values.shape) < 0.9) & alive
        values = np.where(heard, said.detected, -1)
    return Run(times, values.astype(np.int8), truth, dead)


def follow(tracker: Detect, run: Run, *, seed: int = 0) -> list[Shown]:
    """Tell what a tracker shows after each scan, as track: (x, y)."""
    state, found = tracker.initial(seed), []
    for t_s, value in zip(run.times, run.values, strict=True):
        state, _ = tracker.step(state, ReadingScan(float(t_s), value))
        now = tracker.estimates(state)
        rows = zip(now.track[now.shown], now.mean[now.shown], strict=True)
        found.append({int(i): (float(m[0]), float(m[1])) for i, m in rows})
    return found


def wrong(shown: Sequence[Shown], run: Run) -> list[str]:
    """Say why a run is not right, nothing if it is.

    Right: exactly k identities shown for 5 steps or more; no walker's identity switches; each
    walker has its own track within 6 m in 80 % of its steps from 5 s after its entry, and in its
    last 3 steps.
    """
    k = run.truth.shape[1]
    own, faults = _owners(shown, run)
    lives = [sum(i in now for now in shown) for i in {i for now in shown for i in now}]
    if sum(life >= 5 for life in lives) != k:
        faults.append("count")
    for j in range(k):
        steps = np.flatnonzero(~np.isnan(run.truth[:, j, 0]))
        if not own[:, j].any():
            faults.append("never")
            continue
        mine = int(np.bincount(own[own[:, j] > 0, j]).argmax())
        near = np.array([_gap(shown[s].get(mine), run.truth[s, j]) <= GATE_M for s in steps])
        settled = run.times[steps] >= run.times[steps[0]] + 5.0
        if near[settled].mean() < 0.8:
            faults.append("cover")
        if not near[-3:].all():
            faults.append("end")
    return faults


def _owners(shown: Sequence[Shown], run: Run) -> tuple[NDArray[np.intp], list[str]]:
    """Track of each walker in each step (0: none), kept while it stays near; what went wrong."""
    own = np.zeros(run.truth.shape[:2], np.intp)
    last: dict[int, int] = {}
    switched = False
    for s, now in enumerate(shown):
        here = np.flatnonzero(~np.isnan(run.truth[s, :, 0])).tolist()
        for j in here:
            kept = last.get(j, 0)
            if kept not in own[s] and _gap(now.get(kept), run.truth[s, j]) <= GATE_M:
                own[s, j] = kept
        free, alone = [i for i in now if i not in own[s]], [j for j in here if not own[s, j]]
        cost = np.array([[_gap(now[i], run.truth[s, j]) for i in free] for j in alone])
        if not cost.size:
            continue
        cost[cost > GATE_M] = 1e3
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            if cost[row, column] <= GATE_M:
                j, i = alone[row], free[column]
                switched |= last.get(j, i) != i
                last[j] = own[s, j] = i
    return own, ["switch"] if switched else []


def _gap(place: tuple[float, float] | None, truth: Vector) -> float:
    return np.inf if place is None else float(np.hypot(*(np.array(place) - truth)))


def _path(rng: np.random.Generator, ways: Ways, *, edge: int, meeting: float) -> Matrix:
    """Rows t, x, y every tenth of a second from one border to another."""
    speed = float(rng.uniform(*ways.speed_m_s))
    start, along, begin = _entry(rng, ways.kind, edge)
    if ways.kind == "centre":
        start, along, back = _through_centre(rng)
        begin = max(0.0, meeting + float(rng.normal(0.0, 3.0)) - back / speed)
    heading, position, t = float(np.arctan2(along[1], along[0])), start, begin
    pause = float(rng.uniform(10.0, 25.0)) if ways.stops else np.inf
    until = pause + float(rng.uniform(3.0, 8.0))
    rows: list[list[float]] = []
    while t < DURATION_S + 5.0 and bool(np.all((position >= -0.01) & (position <= SIDE_M + 0.01))):
        rows.append([t, float(position[0]), float(position[1])])
        heading += ways.turning * np.sqrt(0.1) * float(rng.standard_normal())
        pace = 0.0 if pause <= t - begin < until else speed
        position = position + 0.1 * pace * np.array([np.cos(heading), np.sin(heading)])
        t += 0.1
    return np.array(rows)


def _entry(rng: np.random.Generator, kind: str, edge: int) -> tuple[Vector, Vector, float]:
    begin = float(rng.uniform(0.0, 15.0))
    if kind == "cross":
        edge, begin = int(rng.integers(4)), float(rng.uniform(0.0, 20.0))
    start = _on_edge(rng, edge)
    aim = _on_edge(rng, (edge + 2) % 4)
    if kind == "cross" and rng.random() < 0.5:
        side = _on_edge(rng, (edge + 1) % 4)
        aim = side if np.linalg.norm(side - start) > 0.6 * SIDE_M else aim
    return start, (aim - start) / np.linalg.norm(aim - start), begin


def _through_centre(rng: np.random.Generator) -> tuple[Vector, Vector, float]:
    angle = float(rng.uniform(0.0, 2.0 * np.pi))
    along = np.array([np.cos(angle), np.sin(angle)])
    middle = SIDE_M / 2.0 + rng.normal(0.0, 4.0, 2)
    back = float(np.min(np.where(along > 0, middle, SIDE_M - middle) / np.abs(along)))
    return middle - back * along, along, back


def _on_edge(rng: np.random.Generator, edge: int) -> Vector:
    a = float(rng.uniform(0.2, 0.8)) * SIDE_M
    return np.array([(a, 0.0), (SIDE_M, a), (a, SIDE_M), (0.0, a)][edge])
