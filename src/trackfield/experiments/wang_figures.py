"""Figures 2-4 and 6-9 of Wang's paper, from the reproduction's own runs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trackfield.experiments.wang_roads import EKF, IEKF, LIVE, MLE, PAPER, SAFE, Outcome
from trackfield.experiments.wang_tables import BAD_START, ROADS, TESTBED
from trackfield.plotting.style import GREY, PALETTE
from trackfield.types import Vector

SMOOTH_STEPS = 10  # of errors over time, so that lines can be told apart


def figures(outcomes: Mapping[str, Outcome]) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    drawn = {"testbed": _testbed(outcomes[TESTBED])}
    for end, road in ROADS.items():
        drawn[f"road_{end.lower()}"] = _road(outcomes[road], f"Road {road}")
    drawn["bad_start"] = _bad_start(outcomes[BAD_START])
    return drawn


def _testbed(outcome: Outcome) -> Figure:
    """Figs. 2-4: the robot's track by each filter."""
    figure = _figure(9.0, 3.7)
    for axes, name in zip(figure.subplots(1, 3, sharey=True), (PAPER, EKF, MLE), strict=True):
        _track(axes, outcome, name, colour=PALETTE[1])
        axes.set(title=name, xlabel="x [m]", aspect="equal")
    figure.axes[0].set_ylabel("y [m]")
    return figure


def _road(outcome: Outcome, title: str) -> Figure:
    """Figs. 6-9: one run's tracks, and RMSE over time of all runs."""
    figure = _figure(9.0, 6.4)
    axes = figure.subplot_mosaic([["road", "corner"], ["error", "error"]], width_ratios=(3, 2))
    names = (PAPER, EKF, MLE, LIVE)
    for name, colour in zip(names, PALETTE, strict=False):
        _track(axes["road"], outcome, name, colour=colour)
        _track(axes["corner"], outcome, name, colour=colour)
    axes["road"].set(title=title, xlabel="x [m]", ylabel="y [m]", aspect="equal")
    x, y = _corner(outcome)
    axes["corner"].set(
        title="The corner", xlabel="x [m]", xlim=(x - 2, x + 2), ylim=(y - 2, y + 2), aspect="equal"
    )
    axes["corner"].legend(fontsize=7, loc="lower left")
    _errors(axes["error"], outcome, names)
    axes["error"].set_ylim(0.0, 0.1)
    return figure


def _bad_start(outcome: Outcome) -> Figure:
    """RMSE over time after a start that is 2 m wrong on each axis."""
    figure = _figure(7.0, 3.4)
    axes = figure.subplots()
    _errors(axes, outcome, (PAPER, EKF, IEKF, SAFE), smooth=1)
    axes.set(title="First position wrong by 2 m on each axis", yscale="log", xlim=(0.0, 10.0))
    return figure


def _corner(outcome: Outcome) -> tuple[float, float]:
    """Find the middle of the turn."""
    vx, vy = outcome.drive.truth[:, 2:].T
    heading = np.unwrap(np.arctan2(vy, vx))
    middle = int(np.argmin(np.abs(heading - 0.5 * (heading[0] + heading[-1]))))
    return float(outcome.drive.truth[middle, 0]), float(outcome.drive.truth[middle, 1])


def _track(axes: Axes, outcome: Outcome, name: str, *, colour: str) -> None:
    drive = outcome.drive
    if not axes.lines:
        axes.plot(*drive.sensors.T, "o", color=GREY, markersize=3, label="sensors")
        axes.plot(*drive.truth[:, :2].T, color="black", linewidth=1.5, label="truth")
    axes.plot(*outcome.entries[name].track.T, color=colour, linewidth=0.8, label=name)


def _errors(
    axes: Axes, outcome: Outcome, names: tuple[str, ...], *, smooth: int = SMOOTH_STEPS
) -> None:
    t_s = outcome.drive.t_s
    for name, colour in zip(names, PALETTE, strict=False):
        error = np.sqrt(_averaged(outcome.entries[name].over_time, smooth))
        axes.plot(t_s, error, color=colour, linewidth=1.2, label=name)
    bound = np.sqrt(_averaged(outcome.bound**2, smooth))
    axes.plot(t_s, bound, "--", color="black", linewidth=1.0, label="PCRB of the model")
    axes.set(xlabel="time [s]", ylabel="RMSE per axis [m]")
    axes.legend(fontsize=8, ncols=2)
    axes.grid(alpha=0.3)


def _averaged(values: Vector, steps: int) -> Vector:
    """Average over `steps` steps around each; steps without a value do not count."""
    some = ~np.isnan(values)
    ones = np.ones(steps)
    count = np.convolve(some.astype(np.float64), ones, mode="same")
    total = np.convolve(np.where(some, values, 0.0), ones, mode="same")
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
