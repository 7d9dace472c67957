"""A robot that follows a target: both ways, the discs it kept to, and what stood in its way."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from trackfield.plotting.style import GREY, PALETTE, frame_map, new_figure
from trackfield.types import Matrix

_DISCS = 8  # that are drawn along the way, at most


class Chase(NamedTuple):
    """What is drawn: the target's `track` and the `robot` (n, 2) [m], at the same times.

    `others` are ways of other robots (n, 2) by name; `reach_m` draws some of the discs; `nodes`
    (m, 2) and obstacles, polygons (k, 2), are what stands there; `late` are steps without the hop.
    """

    track: Matrix
    robot: Matrix
    reach_m: float | None = None
    others: dict[str, Matrix] | None = None
    nodes: Matrix | None = None
    obstacles: Sequence[Matrix] = ()
    late: Sequence[int] = ()


def plot_chase(chase: Chase, *, title: str = "") -> Figure:
    """Draw a robot and its target as a map."""
    figure = new_figure(7.0, 6.4)
    draw_chase(figure.add_subplot(), chase, title=title)
    return figure


def draw_chase(axes: Axes, chase: Chase, *, title: str = "") -> None:
    """Draw a robot and its target into axes of a figure."""
    frame_map(axes, title)
    if chase.nodes is not None:
        axes.plot(*chase.nodes.T, ".", color="0.75", markersize=2.5, zorder=1, label="nodes")
    for polygon in chase.obstacles:
        axes.add_patch(Polygon(np.asarray(polygon), color="0.6", zorder=1))
    if chase.reach_m is not None:
        for k in np.linspace(0, len(chase.track) - 1, _DISCS).astype(int):
            x, y = chase.track[k]
            axes.add_patch(Circle((x, y), chase.reach_m, fill=False, color="0.85", zorder=1))
    axes.plot(*chase.track.T, color="black", linewidth=1.6, zorder=2, label="target")
    for style, (name, way) in zip(("--", ":", "-."), (chase.others or {}).items(), strict=False):
        axes.plot(*way.T, style, color=PALETTE[1], linewidth=1.4, zorder=3, label=name)
    axes.plot(
        *chase.robot.T, "-", marker="^", markersize=3.5, color=PALETTE[0], zorder=4, label="robot"
    )
    for end, mark in ((0, "o"), (-1, "s")):
        axes.plot(*chase.robot[end], mark, color=PALETTE[0], markersize=8, zorder=5)
    late = np.asarray(chase.late, np.intp)
    if late.size:
        axes.plot(*chase.robot[late].T, "x", color=PALETTE[1], zorder=6, label="hop lost")
    if chase.obstacles:
        axes.plot([], [], "s", color="0.6", label="obstacles")
    if chase.reach_m is not None:
        axes.plot([], [], "o", color=GREY, fillstyle="none", label="where the robot may be")
    axes.legend(fontsize=8)
