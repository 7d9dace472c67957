"""Figures 1-3 of Cheng, Ghosh, Hu, from the reproduction's own runs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.experiments.cheng_example import (
    BAR_M,
    EACH,
    GRADIENT,
    RECTANGLE,
    SIGMAS,
    TOLD,
    WINDOW,
)
from trackfield.plotting.style import GREY, PALETTE, frame_map, new_figure

if TYPE_CHECKING:
    from trackfield.experiments.cheng_example import Example, Run

LOOKS = {
    GRADIENT: (PALETTE[1], "x"),
    TOLD: (PALETTE[4], "+"),
    EACH: (PALETTE[2], "1"),
    WINDOW: (PALETTE[0], "."),
}
SHOWN = SIGMAS[1]  # noise of the pass that Figs. 2 and 3 show


def figures(found: Example) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    shown = found.passes[SHOWN][0]
    return {
        "fig1_square_error": _landscape(found),
        "fig2_velocities": _velocities(shown),
        "fig3_trajectory": _trajectory(shown),
    }


def _landscape(found: Example) -> Figure:
    figure = new_figure(7.2, 4.4)
    axes = figure.add_subplot()
    at = found.landscape
    levels = np.log10(np.maximum(at.root_error, 1e-6))
    drawn = axes.contourf(at.x_m, at.y_m, levels, 24, cmap="viridis")
    figure.colorbar(drawn, label="log10 of the root of the least square error")
    _sensors(axes)
    axes.plot(*at.reached[:2], "o", color="white", label="gradient, from the origin")
    axes.plot(*at.truth[:2], "*", color=PALETTE[1], markersize=12, label="robot")
    frame_map(axes, "Fig. 1: square error as the robot enters the mid field")
    axes.legend(fontsize=8, loc="upper center")
    return figure


def _velocities(shown: Run) -> Figure:
    figure = new_figure(7.2, 4.0)
    axes = figure.add_subplot()
    for way, (colour, mark) in LOOKS.items():
        speed = np.clip(shown.states[way][:, 2], -0.3, 0.3)
        speed = speed * np.sign(speed[0] or 1.0)  # of scalar sensors the sign is anyone's
        axes.plot(shown.truth[:, 0], speed, mark, color=colour, label=way)
    axes.plot(shown.truth[:, 0], shown.truth[:, 2], color=GREY, label="truth")
    axes.set(
        xlabel="x of the robot [m]",
        ylabel="velocity along x [m/s]",
        title=f"Fig. 2: velocities in the mid field, noise {SHOWN:g} rad/s",
    )
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure


def _trajectory(shown: Run) -> Figure:
    figure = new_figure(7.2, 4.4)
    axes = figure.add_subplot()
    _sensors(axes)
    axes.plot(shown.truth[:, 0], shown.truth[:, 1], color=GREY, label="truth")
    for way, (colour, mark) in LOOKS.items():
        x, y = shown.states[way][:, :2].T
        axes.plot(x, y, mark, color=colour, label=way)
    frame_map(axes, f"Fig. 3: the pass in the mid field, noise {SHOWN:g} rad/s")
    axes.set(xlim=(-0.45, 0.45), ylim=(-0.15 - BAR_M, 0.15 + BAR_M))
    axes.legend(fontsize=8, loc="lower center", ncols=2)
    return figure


def _sensors(axes: Axes) -> None:
    axes.plot(RECTANGLE[:, 0], RECTANGLE[:, 1], "^", color="black", label="sensors")
