"""Walkers on a field of binary sensors, and what "right" means for a run (the bars of the fields).

12 x 12 nodes at 5 m, R 7.62 m, p .7, q .05, 10 % of messages lost, 6 nodes dead; 75 s. Times of
entry, edges, speeds and manners of walking differ, so that nothing is tuned to one generator.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from trackfield.sensing.detection import DetectionModel, simulate
from trackfield.types import Matrix, Vector

SIDE_M = 55.0
GRID = np.array([(5.0 * j, 5.0 * i) for i in range(12) for j in range(12)])
GATE_M = 6.0


@dataclass(frozen=True)
class Ways:
    """How walkers walk: `kind` is "edges" (each from another edge to the one across), "cross"
    (any edges, also the same), or "centre" (all meet in the middle, at any angles)."""

    kind: str = "edges"
    speed: tuple[float, float] = (1.2, 1.2)
    turning: float = 0.0  # [rad] in a root of a second
    stops: bool = False


class Run(NamedTuple):
    """Values (steps, n) as scans hold them, true positions (steps, k, 2) (NaN: not there), dead."""

    times: Vector
    values: np.ndarray
    truth: Matrix
    dead: np.ndarray


def field_run(seed, k, *, ways=Ways(), model=DetectionModel(), step_s=1.0, says_zero=False):  # noqa: B008
    """Draw a run of `k` walkers."""
    rng = np.random.default_rng(seed)
    times = np.arange(1, round(75.0 / step_s) + 1) * step_s
    edges = rng.permutation(4)
    meeting = rng.uniform(30.0, 40.0)
    paths = [_path(rng, ways, edges[j % 4], meeting) for j in range(k)]
    truth = np.full((len(times), k, 2), np.nan)
    for j, path in enumerate(paths):
        there = (times >= path[0, 0]) & (times <= path[-1, 0])
        for axis in range(2):
            truth[there, j, axis] = np.interp(times[there], path[:, 0], path[:, 1 + axis])
    dead = rng.choice(len(GRID), 6, replace=False)
    alive = np.ones(len(GRID), bool)
    alive[dead] = False
    said = simulate(model, GRID, paths=truth, rng=rng, delivery=0.9, alive=alive)
    values = np.where(said.received, 1, -1).astype(np.int8)
    if says_zero:
        heard = (rng.random(values.shape) < 0.9) & alive
        values = np.where(heard, said.detected, -1).astype(np.int8)
    return Run(times, values, truth, dead)


def _path(rng, ways, edge, meeting):
    """Rows t, x, y every tenth of a second from one border to another."""
    speed = rng.uniform(*ways.speed)
    begin = rng.uniform(0.0, 15.0)
    if ways.kind == "centre":
        angle = rng.uniform(0.0, 2.0 * np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        middle = SIDE_M / 2.0 + rng.normal(0.0, 4.0, 2)
        back = min(
            (m if d > 0 else SIDE_M - m) / abs(d) for m, d in zip(middle, along, strict=True)
        )
        start = middle - back * along
        begin = max(0.0, meeting + rng.normal(0.0, 3.0) - back / speed)
    else:
        if ways.kind == "cross":
            edge, begin = rng.integers(4), rng.uniform(0.0, 20.0)
        start = _on_edge(edge, rng.uniform(0.2, 0.8) * SIDE_M)
        aim = _on_edge((edge + 2) % 4, rng.uniform(0.2, 0.8) * SIDE_M)
        if ways.kind == "cross" and rng.random() < 0.5:
            side = _on_edge((edge + 1) % 4, rng.uniform(0.2, 0.8) * SIDE_M)
            aim = side if np.linalg.norm(side - start) > 0.6 * SIDE_M else aim
        along = (aim - start) / np.linalg.norm(aim - start)
    heading, position, rows, t = np.arctan2(along[1], along[0]), start, [], begin
    pause = rng.uniform(10.0, 25.0) if ways.stops else np.inf
    until = pause + rng.uniform(3.0, 8.0)
    while t < 80.0 and ((position >= -0.01) & (position <= SIDE_M + 0.01)).all():
        rows.append([t, *position])
        heading += ways.turning * np.sqrt(0.1) * rng.standard_normal()
        pace = 0.0 if pause <= t - begin < until else speed
        position = position + 0.1 * pace * np.array([np.cos(heading), np.sin(heading)])
        t += 0.1
    return np.array(rows)


def _on_edge(edge, along):
    return np.array([(along, 0.0), (SIDE_M, along), (along, SIDE_M), (0.0, along)][edge])


def wrong(shown, run):
    """Say why a run is not right, nothing if it is; `shown` is a dict track: (x, y) a step."""
    k = run.truth.shape[1]
    owner, own, switches = {}, np.zeros(run.truth.shape[:2], int), 0
    for s, tracks in enumerate(shown):
        here = [j for j in range(k) if not np.isnan(run.truth[s, j, 0])]
        gap = {
            (j, i): np.hypot(*(np.array(at) - run.truth[s, j]))
            for j in here
            for i, at in tracks.items()
        }
        for j in here:
            if gap.get((j, owner.get(j)), np.inf) <= GATE_M and owner[j] not in own[s]:
                own[s, j] = owner[j]
        free = [i for i in tracks if i not in own[s]]
        open_ = [j for j in here if not own[s, j]]
        if free and open_:
            cost = np.array([[min(gap[j, i], 1e3) for i in free] for j in open_])
            cost[cost > GATE_M] = 1e3
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                if cost[row, column] <= GATE_M:
                    j, i = open_[row], free[column]
                    switches += j in owner and owner[j] != i
                    owner[j] = own[s, j] = i
    faults = ["switch"] if switches else []
    lives = [sum(i in tracks for tracks in shown) for i in {i for t in shown for i in t}]
    if sum(life >= 5 for life in lives) != k:
        faults.append("count")
    for j in range(k):
        steps = np.flatnonzero(~np.isnan(run.truth[:, j, 0]))
        if not own[:, j].any():
            faults.append("never")
            continue
        mine = np.bincount(own[own[:, j] > 0, j]).argmax()
        near = np.array(
            [
                mine in shown[s]
                and np.hypot(*(np.array(shown[s][mine]) - run.truth[s, j])) <= GATE_M
                for s in steps
            ]
        )
        settled = run.times[steps] >= run.times[steps[0]] + 5.0
        if near[settled].mean() < 0.8:
            faults.append("cover")
        if not near[-3:].all():
            faults.append("end")
    return faults
