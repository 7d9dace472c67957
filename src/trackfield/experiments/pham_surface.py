"""Pham 3.6: a target above a parabolic surface of 441 nodes, tracked with four in reach of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from trackfield.filtering import extended, kalman
from trackfield.filtering.extended import Ranges
from trackfield.filtering.kalman import Linear
from trackfield.localization import trilateration
from trackfield.localization.bounds import range_bound
from trackfield.localization.information import reading_gains
from trackfield.motion import ConstantVelocity
from trackfield.network.boxes import Box
from trackfield.network.energy import Energy, network_power
from trackfield.network.layouts import paraboloid, random_on_surface
from trackfield.raster import Region
from trackfield.scheduling.paper_selection import function_3d
from trackfield.scheduling.selection import select
from trackfield.sensing.range import RangeModel, distance
from trackfield.types import Gaussian, Indices, Matrix, Vector

NODES, NEEDED = 441, 4
BOX = Box(np.zeros(3), np.array([10.0, 10.0, 6.0]))
ABOVE_M, REACH_M, SIGMA_M = 0.5, 1.4, 0.1
"""The height is Pham's; reach and noise are those of chapter 5, as chapter 3 gives none."""
DURATION_S, CYCLE_S = 10.0, 0.05
ASTRAY_M = 0.75
ACCEL_DENSITY = 0.5  # [m^2/s^3], chosen on noise not used here
START_SIGMA = 0.05  # of the first belief about the truth, position [m] and velocity [m/s]


class Flight(NamedTuple):
    """Nodes (441, 3) [m], and the target's way: `t_s` (k,), `position` (k, 3) [m]."""

    nodes: Matrix
    t_s: Vector
    position: Matrix


class Tracked(NamedTuple):
    """What a way of selecting came to; a row a cycle, means over the runs that kept the target.

    `astray` counts the others, that were farther than `ASTRAY_M` from it at some time (means are
    over them where there are no others): nodes lie on a surface, and ranges to nodes in a plane
    have a second solution on its other side.

    `squared` (k,) [m^2] of the filter's errors, `fix_squared` (k,) those of trilateration alone,
    NaN where ranges went into the filter as they are; `bound` (k,) [m^2], the trace of the bound of
    the ranges that were taken; `asked` (k,) and `reached` (k,) how many nodes measured, and could
    have; `power_mw` (k,); `path` (k, 3) [m], the estimates of one run.
    """

    squared: Vector
    fix_squared: Vector
    bound: Vector
    asked: Vector
    reached: Vector
    power_mw: Vector
    path: Matrix
    astray: int = 0


Choose = Callable[[Matrix, Gaussian], Indices]


class Tactic(NamedTuple):
    """A way of tracking: who is asked, and whether trilateration stands before the filter."""

    choose: Choose
    fixes: bool


def flight(rng: np.random.Generator, *, cycles: int | None = None) -> Flight:
    """Draw nodes on the surface; the target's speed is sinusoidal in x and y, its height parabolic.

    x = 5 - 4 cos(pi t / 10), y = 5 + 2.5 sin(2 pi t / 10), half a metre above the surface. Pham
    gives neither; with these the way goes up one side of the bowl, down, and up the other.
    """
    height = paraboloid(BOX)
    nodes = random_on_surface(Region(0.0, 0.0, 10.0, 10.0), NODES, height=height, rng=rng)
    count = round(DURATION_S / CYCLE_S)
    t_s: Vector = CYCLE_S * np.arange(count, dtype=np.float64)[: cycles or count]
    phase = np.pi * t_s / DURATION_S
    plane = np.column_stack([5.0 - 4.0 * np.cos(phase), 5.0 + 2.5 * np.sin(2.0 * phase)])
    return Flight(nodes, t_s, np.column_stack([plane, height(plane) + ABOVE_M]))


def ways() -> Mapping[str, Tactic]:
    """List the ways: the paper's (the fourth node by the trace of Theta), and what is better."""
    return {
        "Function-3D, trilateration": Tactic(_function_3d_printed, fixes=True),
        "Function-3D, ranges": Tactic(_function_3d, fixes=False),
        "best four, ranges": Tactic(_best_four, fixes=False),
        "best four for the filter, ranges": Tactic(_best_for_filter, fixes=False),
        "all in reach, trilateration": Tactic(_all, fixes=True),
        "all in reach, ranges": Tactic(_all, fixes=False),
    }


def track(flown: Flight, tactic: Tactic, *, runs: int, rng: np.random.Generator) -> Tracked:
    """Track the target `runs` times, asking nodes by where the filter expects it."""
    first = np.random.default_rng(int(rng.integers(2**63)))
    all_runs = [_run(flown, tactic, first) for _ in range(runs)]
    near = [run for run in all_runs if run.rows[:, 0].max() <= ASTRAY_M**2]
    kept = near or all_runs
    columns = np.mean([run.rows for run in kept], axis=0).T
    return Tracked(*columns, path=kept[0].path, astray=runs - len(near))


class _Run(NamedTuple):
    rows: Matrix  # (k, 6), the columns of `Tracked`
    path: Matrix


def _run(flown: Flight, tactic: Tactic, rng: np.random.Generator) -> _Run:
    motion = ConstantVelocity(ACCEL_DENSITY, dimensions=3)
    F, Q = motion.transition(CYCLE_S), motion.noise(CYCLE_S)
    velocity = (flown.position[1] - flown.position[0]) / CYCLE_S
    start = START_SIGMA**2 * np.eye(6)
    mean = np.concatenate([flown.position[0], velocity])
    belief = Gaussian(mean + START_SIGMA * rng.standard_normal(6), start)
    rows = np.full((len(flown.t_s), 6), np.nan)
    path = np.empty_like(flown.position)
    for k, target in enumerate(flown.position):
        prior = kalman.predict(belief, F, Q) if k else belief
        inside = flown.nodes[distance(flown.nodes, target) <= REACH_M]
        asked = inside[tactic.choose(inside, prior)] if len(inside) > NEEDED else inside
        ranges = distance(asked, target) + SIGMA_M * rng.standard_normal(len(asked))
        belief, fix = _update(prior, asked, np.abs(ranges), fixes=tactic.fixes)
        path[k] = belief.mean[:3]
        bound = range_bound(asked, target, models=RangeModel(sigma_m=SIGMA_M)).covariance
        power = network_power(
            Energy(), NODES, measuring=len(asked), warned=len(inside) - len(asked)
        )
        rows[k] = (
            _square(path[k] - target),
            _square(fix - target),
            np.trace(bound),
            len(asked),
            len(inside),
            power,
        )
    return _Run(rows, path)


def _update(
    prior: Gaussian, asked: Matrix, ranges: Vector, *, fixes: bool
) -> tuple[Gaussian, Vector]:
    """Condition on a position of trilateration with its covariance (3.13), or on ranges."""
    if not fixes:
        sensor = Ranges(asked, RangeModel(sigma_m=SIGMA_M))
        return extended.iterate(prior, ranges, sensor).update.posterior, np.full(3, np.nan)
    fix = trilateration.ordinary(asked, ranges, sigma_m=SIGMA_M)
    linear = Linear(np.eye(3, 6), fix.covariance)
    return kalman.update(prior, fix.position, linear).posterior, fix.position


def _function_3d(sensors: Matrix, prior: Gaussian) -> Indices:
    return function_3d(sensors, prior.mean[:3])


def _function_3d_printed(sensors: Matrix, prior: Gaussian) -> Indices:
    return function_3d(sensors, prior.mean[:3], printed=True)


def _best_four(sensors: Matrix, prior: Gaussian) -> Indices:
    return select(_gains(sensors, prior), NEEDED).sensors


def _best_for_filter(sensors: Matrix, prior: Gaussian) -> Indices:
    information = np.linalg.inv(prior.covariance[:3, :3])
    return select(_gains(sensors, prior), NEEDED, prior=0.5 * (information + information.T)).sensors


def _all(sensors: Matrix, prior: Gaussian) -> Indices:
    return np.arange(len(sensors), dtype=np.int32)


def _gains(sensors: Matrix, prior: Gaussian) -> Matrix:
    return reading_gains(RangeModel(sigma_m=SIGMA_M), sensors, prior.mean[:3])


def _square(error: Vector) -> float:
    return float(error @ error)
