"""Figures 11, 12 and 19 of Oh's paper."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from trackfield.experiments.oh_pursuit import (
    EVADER_M_S2,
    NOISES,
    STEP_S,
    THRUST_M_S2,
    WAYS,
    Pursued,
    race,
)
from trackfield.plotting.pursuits import Chase, draw_pursuit
from trackfield.plotting.style import GREY, PALETTE, frame_map, new_figure
from trackfield.pursuit.steering import time_to_rest

_SEED = 12  # of the run that Fig. 12 shows


def pursuit_figures(found: Pursued) -> dict[str, Figure]:
    """Draw the figures, by file name without its suffix."""
    return {
        "fig11_times": _fig11(),
        "fig12_robust": _fig12(),
        "fig19_pursuit": _fig19(found),
    }


def _fig11() -> Figure:
    """Curves of equal time, the switching curve, and where a step may lead: Oh, Fig. 11."""
    figure = new_figure(6.4, 5.4)
    axes = figure.add_subplot()
    x, v = np.meshgrid(np.linspace(-8.0, 8.0, 321), np.linspace(-4.0, 4.0, 161))
    times = time_to_rest(x, v, limit_m_s2=THRUST_M_S2)
    lines = axes.contour(x, v, times, levels=np.arange(1.0, 11.0), colors=GREY, linewidths=0.8)
    axes.clabel(lines, fontsize=7, fmt="%g s")
    speed = np.linspace(-4.0, 4.0, 81)
    axes.plot(-speed * np.abs(speed) / (2.0 * THRUST_M_S2), speed, color="black", linewidth=2)
    wide, fast, swerve = 1.0, 0.5, 2.0 * EVADER_M_S2
    corners = [
        (
            a * wide + b * STEP_S * fast + c * 0.5 * STEP_S**2 * swerve,
            b * fast + c * STEP_S * swerve,
        )
        for a, b, c in ((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (-1, -1, -1), (1, -1, -1), (1, 1, -1))
    ]
    place = np.array([4.0, -1.5]) + np.array(corners)
    axes.add_patch(Polygon(place, closed=True, color=PALETTE[0], alpha=0.4))
    axes.plot(*place[[0, 3]].T, "o", color=PALETTE[1], markersize=4, label="the worst two corners")
    axes.set(
        xlabel="offset [m]",
        ylabel="velocity [m/s]",
        title="Fig. 11: time to capture, switching curve, and where a step may lead",
        xlim=(-8.0, 8.0),
        ylim=(-4.0, 4.0),
    )
    axes.legend(fontsize=8, loc="upper right")
    return figure


def _fig12() -> Figure:
    """Offsets of one pursuer by plain and by robust steering, the same start: Oh, Fig. 12."""
    figure = new_figure(7.0, 4.4)
    axes = figure.add_subplot()
    frame_map(axes, "Fig. 12: offset from the evader")
    for i, way in enumerate(WAYS):
        run = race(way, NOISES[-1], 0.5, rng=np.random.default_rng(_SEED), runs=1)
        label = f"{way}: {run.captured_s[0]:.1f} s"
        axes.plot(*run.path[:, 0, :2].T, ".-", color=PALETTE[i], linewidth=1, label=label)
    axes.legend(fontsize=8)
    return figure


def _fig19(found: Pursued) -> Figure:
    figure = new_figure(6.4, 6.4)
    axes = figure.add_subplot()
    frame_map(axes, "Fig. 19: two pursuers after two walkers that cross")
    run = found.picture
    places = {name: place for place, name in enumerate(run.truth.target_ids)}
    captured = tuple(
        (places[fate.target], fate.captured_s, fate.pursuer)
        for fate in run.fates
        if fate.captured_s is not None and fate.pursuer is not None
    )
    draw_pursuit(axes, Chase(run.t_s, run.paths, run.truth, run.tracks, captured))
    axes.set(xlim=(0.0, 60.0), ylim=(0.0, 60.0))
    axes.legend(fontsize=8)
    return figure
