"""Pham, chapter 5, with a bound on what the filter will know instead of on a snapshot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import pham_soft_paths as paths
from trackfield.experiments import pham_soft_tables
from trackfield.experiments.pham_soft_paths import INTERVALS, SIDE_M, SIGMA_M, Draw
from trackfield.experiments.pham_soft_runs import (
    REACH_M,
    Outcome,
    Runs,
    demand,
    simulate,
    some,
)
from trackfield.experiments.results import Table
from trackfield.metrics.consistency import INSIDE_95
from trackfield.types import Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NODES = 441
BOUND, AGILITY = 3.0, 0.6
BOUNDS = (1.0, 2.0, 3.0, 5.0)
AGILITIES = (0.3, 0.6, 0.9, 1.2)
TURNING = (0.6, 0.9, 1.2)
DRAWS: Mapping[str, Draw] = {
    "sinusoids": paths.sinusoids,
    "wandering": paths.wandering(AGILITY),
}


class Size(NamedTuple):
    """Fields; passes of a life at most, judged of it, on full batteries, in the past."""

    fields: int
    life: int
    judged: int
    fresh: int
    past: int


FULL = Size(3, 400, 200, 40, 100)
QUICK = Size(1, 8, 8, 4, 20)


class Summary(NamedTuple):
    """Means over intervals: share `failed`, sensors `asked`, `rmse` [sigma], `nees` (2 if honest).

    `inside`: share of errors inside the 95 % ellipse; `lost`: intervals in 5000 with an error
    beyond a sensor's reach, `lost_passes` the passes in 200 that had any.
    """

    failed: float
    asked: float
    rmse: float
    nees: float
    inside: float
    lost: float
    lost_passes: float


class Lives(NamedTuple):
    """Intervals until the first node is empty, one a field (f,); 0 where none was when it ended."""

    soft: Vector
    hard: Vector
    geometry: Vector


class Point(NamedTuple):
    """One setting on full batteries: the soft bound, and the hard one with the same filter."""

    bound: float
    agility: float
    soft: Summary
    hard: Summary


class Soft(NamedTuple):
    """Everything found; `judged` and `lives` by kind of path, `lives_by_bound` of wandering ones.

    `hard` is on full batteries, as the errors of a bound that is kept.
    """

    size: Size
    judged: Mapping[str, Summary]
    hard: Mapping[str, Summary]
    lives: Mapping[str, Lives]
    lives_by_bound: tuple[tuple[float, float], ...]
    grid: tuple[Point, ...]
    turning: tuple[Point, ...]


def soft(rng: np.random.Generator, *, quick: bool = False) -> Soft:
    """Run whole lives at B = 3 and q/s = .6, and all settings on full batteries."""
    size = QUICK if quick else FULL
    kinds = list(DRAWS)
    fields = SIDE_M * rng.random((size.fields, NODES, 2))
    ways, past = (
        np.stack([DRAWS[kind](rng, passes) for kind in kinds for _ in fields])
        for passes in (size.life, size.past)
    )
    count = len(ways)
    sensors = np.concatenate([fields] * len(kinds))
    runs = Runs(
        sensors,
        ways,
        np.full(count, BOUND),
        np.full(count, AGILITY),
        demand(sensors, past.reshape(count, -1, 2)),
        np.zeros(count, bool),
    )
    ours, by_bound = _soft_lives(runs, size, rng)
    deaths = np.stack([ours.first_death, *_hard_lives(runs, rng)])
    own = [slice(k * size.fields, (k + 1) * size.fields) for k in range(len(kinds))]
    grid, turning = _points(size, rng)
    return Soft(
        size=size,
        judged={kind: summary(ours, own[k], size.judged) for k, kind in enumerate(kinds)},
        hard={kind: _fresh(DRAWS[kind], 3 * size.fresh, rng, hard=True) for kind in kinds},
        lives={kind: Lives(*deaths[:, own[k]]) for k, kind in enumerate(kinds)},
        lives_by_bound=by_bound,
        grid=grid,
        turning=turning,
    )


def _soft_lives(
    runs: Runs, size: Size, rng: np.random.Generator
) -> tuple[Outcome, tuple[tuple[float, float], ...]]:
    """Run whole lives at B, and on the last field and kind of path at the other bounds."""
    count, others = len(runs.bound), [bound for bound in BOUNDS if bound != BOUND]
    row = np.minimum(np.arange(count + len(others)), count - 1)
    bounds = np.array([BOUND] * count + others)
    every = some(runs, row)._replace(bound=bounds)
    both = simulate(every, rng, judged=np.where(np.arange(len(row)) < count, size.judged, 0))
    last = dict(zip(bounds[count - 1 :], both.first_death[count - 1 :], strict=True))
    ours = both._replace(first_death=both.first_death[:count])
    return ours, tuple((bound, float(last[bound])) for bound in BOUNDS)


def _hard_lives(runs: Runs, rng: np.random.Generator) -> tuple[Vector, Vector]:
    """First empty nodes under the hard bound: by residual energy, and by geometry alone."""
    count = len(runs.bound)
    twice = np.arange(2 * count)
    every = some(runs, twice % count)._replace(geometry=twice >= count)
    ended = simulate(every, rng, hard=True, judged=np.zeros(2 * count, np.int64))
    death = ended.first_death.astype(np.float64)
    return death[:count], death[count:]


def summary(outcome: Outcome, runs: slice, passes: int) -> Summary:
    """Means over the first `passes` of some of the runs."""
    judged = slice(passes * INTERVALS)
    error = outcome.error[judged, runs]
    lost = error * SIGMA_M > REACH_M
    by_pass = lost.reshape(-1, INTERVALS, error.shape[1]).any(axis=1)
    distance2 = outcome.distance2[judged, runs]
    return Summary(
        failed=float(1.0 - outcome.kept[judged, runs].mean()),
        asked=float(outcome.asked[judged, runs].mean()),
        rmse=float(np.sqrt((error**2).mean())),
        nees=float(distance2.mean()),
        inside=float((distance2 <= INSIDE_95).mean()),
        lost=float(5000 * lost.mean()),
        lost_passes=float(200 * by_pass.mean()),
    )


def _points(size: Size, rng: np.random.Generator) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    grid: list[Point] = []
    for q in AGILITIES:
        draw = paths.wandering(q)
        hard = _fresh(draw, 2 * size.fresh, rng, agility=q, hard=True)
        for bound in BOUNDS:
            ours = _fresh(draw, size.fresh, rng, bound=bound, agility=q)
            grid.append(Point(bound, q, ours, hard))
    turning = tuple(
        Point(
            BOUND,
            q,
            *(_fresh(paths.turning, 3 * size.fresh, rng, agility=q, hard=h) for h in (False, True)),
        )
        for q in TURNING
    )
    return tuple(sorted(grid)), turning


def _fresh(
    draw: Draw,
    passes: int,
    rng: np.random.Generator,
    *,
    bound: float = BOUND,
    agility: float = AGILITY,
    hard: bool = False,
) -> Summary:
    """One pass a run, each through a field of its own on full batteries."""
    runs = Runs(
        SIDE_M * rng.random((passes, NODES, 2)),
        draw(rng, passes)[:, None],
        np.full(passes, bound),
        np.full(passes, agility),
        np.ones((passes, NODES)),
        np.zeros(passes, bool),
    )
    return summary(simulate(runs, rng, hard=hard), slice(None), 1)


def tables(found: Soft) -> tuple[Table, ...]:
    """Bars at B = 3, lives, all settings, and targets that turn."""
    return pham_soft_tables.tables(found)


def findings(found: Soft) -> tuple[str, ...]:
    """Say what the runs say, in sentences."""
    return pham_soft_tables.findings(found)


def figures(found: Soft) -> dict[str, Figure]:
    """Draw energy against error, and lives, by file name."""
    from trackfield.experiments.pham_soft_figures import figures as draw

    return draw(found)
