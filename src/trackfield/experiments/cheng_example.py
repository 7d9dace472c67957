"""Cheng, Ghosh, Hu, Example 5.1, Figs. 1-3: four scalar sensors about a robot on a line.

The paper's readings are not to be had, nor what noise they had: the robot is simulated, with
several noises.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import (
    make_smoothing_spline,  # pyright: ignore[reportUnknownVariableType]  it has no types
)

from trackfield.experiments.results import Table
from trackfield.localization import motion_newton, motion_snapshot, motion_window
from trackfield.localization.motion_newton import NewtonFix, SizeScan
from trackfield.localization.motion_readings import readings
from trackfield.sensing import motion_rate
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.types import Matrix, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECTANGLE = np.array([[0.3, 0.15], [-0.3, 0.15], [-0.3, -0.15], [0.3, -0.15]])
MORE = np.array([[0.0, 0.25], [0.0, -0.25]])  # sensors that a fifth and a sixth would be
SPEED_M_S, RATE_HZ = 0.12, 10.0
HALF_WAY_M, MID_FIELD_M = 0.4, 0.25  # of the robot's way; of where errors are judged
LANE_M, TURN_RAD = 0.05, 0.1  # how far the robot's line may be off the axis
BAR_M = 0.1  # "the error never exceeded 10cm"
SIGMAS = (0.003, 0.01, 0.05)  # [rad/s]
GUESS = np.array([0.0, 0.0, 0.1, 0.0])  # the origin; at rest would be a trap
CELLS = 121  # of a side of Fig. 1


class Size(NamedTuple):
    """How much is run: passes for each noise, moments for each number of sensors."""

    runs: int
    moments: int


FULL, QUICK = Size(20, 30), Size(1, 2)


class Run(NamedTuple):
    """One pass: times (T,), truth (T, 4), and states (T, 4) by each way in the mid field."""

    t_s: Vector
    truth: Matrix
    states: Mapping[str, Matrix]

    def errors_m(self, way: str) -> Vector:
        """Errors (T,) of the place where the robot was in the mid field."""
        return np.linalg.norm(self.states[way][:, :2] - self.truth[:, :2], axis=1)

    def worst_m(self, way: str) -> float:
        """Largest of the errors."""
        return float(self.errors_m(way).max())


GRADIENT, TOLD, EACH, WINDOW = WAYS = (
    "paper, from the origin",
    "paper, told the start",
    "Newton, told every state",
    "window fit",
)


class Landscape(NamedTuple):
    """Fig. 1: the root of the least square error (k, k) over the velocity, at places x and y (k,).

    `reached` is where the gradient came from the origin, `truth` where the robot was.
    """

    x_m: Vector
    y_m: Vector
    root_error: Matrix
    reached: Vector
    truth: Vector


class Moments(NamedTuple):
    """Of a number of sensors: exact states of one moment, each with either sign, (runs,).

    `found` tells whether the true one was among them.
    """

    sensors: int
    states: Vector
    found: Vector


class Example(NamedTuple):
    """What was found: passes by noise, moments by number of sensors, Fig. 1."""

    passes: Mapping[float, Sequence[Run]]
    moments: Sequence[Moments]
    landscape: Landscape


def run(rng: np.random.Generator, *, quick: bool = False) -> Example:
    """Run Example 5.1: passes with several noises, exact states of one moment, the landscape."""
    size = QUICK if quick else FULL
    passes = {sigma: [_pass(sigma, rng) for _ in range(size.runs)] for sigma in SIGMAS}
    moments = [_moments(count, size.moments, rng) for count in (4, 5, 6)]
    return Example(passes, moments, _landscape())


def tables(found: Example) -> tuple[Table, ...]:
    """Tell the passes and the moments."""
    rows = [
        (
            f"{sigma:g}",
            way,
            f"{100.0 * np.mean([one.worst_m(way) < BAR_M for one in runs]):.0f} %",
            f"{100.0 * np.mean([(one.errors_m(way) < BAR_M).mean() for one in runs]):.0f} %",
            f"{np.median([one.worst_m(way) for one in runs]):.3f}",
            f"{max(one.worst_m(way) for one in runs):.3f}",
        )
        for sigma, runs in found.passes.items()
        for way in WAYS
    ]
    title = (
        f"Example 5.1: largest error for |x| <= {MID_FIELD_M} m, {len(found.passes[SIGMAS[0]])} "
        "runs (paper: four runs, never above 10 cm, noise unknown)"
    )
    passes = Table(
        title,
        ("noise [rad/s]", "way", "runs below 10 cm", "moments", "median [m]", "worst [m]"),
        tuple(rows),
    )
    moments = Table(
        "One moment without noise: exact states, the sign of the velocity aside",
        ("scalar sensors", "mean", "most", "true state among them"),
        tuple(
            (
                str(m.sensors),
                f"{m.states.mean():.1f}",
                f"{m.states.max():.0f}",
                f"{100.0 * m.found.mean():.0f} %",
            )
            for m in found.moments
        ),
    )
    return passes, moments


def findings(found: Example) -> tuple[str, ...]:
    """Say what became of the example's claims."""
    share = {
        way: [np.mean([one.worst_m(way) < BAR_M for one in runs]) for runs in found.passes.values()]
        for way in WAYS
    }
    worst = max(one.worst_m(WINDOW) for runs in found.passes.values() for one in runs)
    four, *_, six = found.moments
    kept = {
        way: f"{100 * min(share[way]):.0f} to {100 * max(share[way]):.0f} %"
        for way in (GRADIENT, TOLD, EACH)
    }
    return (
        f"Newton from moment to moment keeps within 10 cm in {kept[GRADIENT]} of the passes when "
        f"it starts where the gradient leads from the origin, in {kept[TOLD]} when it is told the "
        f"true start, and in {kept[EACH]} when it is told the true state of every moment, for "
        f"noises of {SIGMAS[0]:g} to {SIGMAS[-1]:g} rad/s. The paper reports four of four; its "
        "readings, their rate, their noise and how smooth its spline was are not given.",
        f"A constant velocity fitted to the whole pass errs by {100 * worst:.1f} cm at worst, in "
        "every run, without any start.",
        f"One moment of four scalar sensors has {four.states.mean():.1f} exact states on average "
        f"(and each with the opposite velocity), so no solver of a moment can know the right one; "
        f"of six sensors it has {six.states.mean():.1f}.",
        "The start at zero velocity is a trap for both of the paper's methods: the slope in the "
        "velocity is exactly zero there. The reproduction starts at the origin with .1 m/s.",
    )


def figures(found: Example) -> dict[str, Figure]:
    """Draw Figs. 1-3 by file name."""
    from trackfield.experiments.cheng_example_figures import figures

    return figures(found)


def _pass(sigma: float, rng: np.random.Generator) -> Run:
    """Simulate one pass, and find it by the paper's steps and by a window."""
    model = MotionRateModel(sigma=sigma)
    heading = rng.uniform(-TURN_RAD, TURN_RAD)
    v = SPEED_M_S * np.array([math.cos(heading), math.sin(heading)])
    half = HALF_WAY_M / SPEED_M_S
    t = np.arange(-half, half, 1.0 / RATE_HZ)
    p = np.array([0.0, rng.uniform(-LANE_M, LANE_M)]) + t[:, None] * v
    truth = np.hstack([p, np.tile(v, (len(t), 1))])
    z = motion_rate.simulate(model, RECTANGLE, path=truth, rng=rng).value
    given = readings(model, np.tile(RECTANGLE, (len(t), 1)), z.ravel(), t_s=np.repeat(t, 4))
    fit = motion_window.window_fit(given, t_s=0.0)
    mid = np.abs(p[:, 0]) <= MID_FIELD_M
    smooth = np.column_stack([make_smoothing_spline(t, column)(t) for column in z.T])
    values = np.maximum(smooth, 0.0)[mid]
    first = SizeScan(RECTANGLE, values[0])
    states = {
        GRADIENT: _followed(values, motion_newton.gradient(first, GUESS).state),
        TOLD: _followed(values, truth[mid][0]),
        EACH: np.array(
            [
                motion_newton.newton(first._replace(value=value), state).state
                for value, state in zip(values, truth[mid], strict=True)
            ]
        ),
        WINDOW: np.hstack(
            [motion_window.path(fit, t[mid]), np.tile(fit.modes[0].state[2:], (mid.sum(), 1))]
        ),
    }
    return Run(t[mid], truth[mid], states)


def _followed(values: Matrix, start: Vector) -> Matrix:
    scan = SizeScan(RECTANGLE, values[0])
    found: list[NewtonFix] = motion_newton.follow(scan, values, start, step_s=1.0 / RATE_HZ)
    return np.array([fix.state for fix in found])


def _moments(count: int, runs: int, rng: np.random.Generator) -> Moments:
    """Count the exact states of moments anywhere in the rectangle, whichever way the robot goes."""
    sensors = np.vstack([RECTANGLE, MORE])[:count]
    model = MotionRateModel(sigma=0.001)
    states, found = np.empty(runs), np.empty(runs)
    for k in range(runs):
        heading = rng.uniform(-math.pi, math.pi)
        v = SPEED_M_S * np.array([math.cos(heading), math.sin(heading)])
        truth = np.concatenate([rng.uniform(-1.0, 1.0, 2) * RECTANGLE[0], v])
        z = motion_rate.strength(model, sensors, states=truth)
        modes = motion_snapshot.locate(sensors, z, model).modes
        exact = [mode.state for mode in modes if mode.cost < 1e-10]
        states[k] = len(exact) / 2.0
        found[k] = any(np.abs(state - truth).max() < 1e-5 for state in exact)
    return Moments(count, states, found)


def _landscape() -> Landscape:
    """Fig. 1: E of Cheng (11) when the robot enters the mid field, least over all velocities.

    For a heading, E is a square in the squared speed: least in closed form.
    """
    truth = np.array([-MID_FIELD_M, 0.02, SPEED_M_S, 0.0])
    b = motion_rate.strength(MotionRateModel(), RECTANGLE, states=truth)
    x, y = np.linspace(-0.5, 0.5, CELLS), np.linspace(-0.3, 0.3, CELLS)
    o = np.stack(np.meshgrid(x, y), axis=-1)[..., None, :] - RECTANGLE
    far = b**2 * np.sum(o**2, axis=-1) ** 2
    least = np.full(far.shape[:2], math.inf)
    for heading in np.linspace(0.0, math.pi, 180, endpoint=False):
        across = (o[..., 0] * math.sin(heading) - o[..., 1] * math.cos(heading)) ** 2
        square = np.sum(across * far, axis=-1) / np.maximum(np.sum(across**2, axis=-1), 1e-30)
        error = np.sum((across * square[..., None] - far) ** 2, axis=-1)
        least = np.minimum(least, error)
    reached = motion_newton.gradient(SizeScan(RECTANGLE, b), GUESS).state
    return Landscape(x, y, np.sqrt(least), reached, truth)
