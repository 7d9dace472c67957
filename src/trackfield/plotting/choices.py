"""Which sensors were chosen for a target and what they leave unknown; where nodes would stand."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from trackfield.network.site import Site
from trackfield.plotting.style import GREY, NAMED, PALETTE, SIGMAS_95, frame_map, new_figure
from trackfield.raster import Region
from trackfield.scheduling.point import PointPlan
from trackfield.types import Matrix


def plot_choice(site: Site, plan: PointPlan) -> Figure:
    """Draw the field with the chosen sensors, and beside it what they leave unknown."""
    figure = new_figure(11.0, 5.2)
    field, close = figure.subplots(1, 2)
    _draw_field(field, site, plan)
    _draw_ellipses(close, plan)
    return figure


def plot_nodes(nodes: Matrix, region: Region, *, title: str = "") -> Figure:
    """Draw where nodes (n, 2) [m] would stand in a region."""
    figure = new_figure(6.4, 6.0)
    axes = figure.add_subplot()
    frame_map(axes, title)
    x_min, y_min, x_max, y_max = region
    wide, high = x_max - x_min, y_max - y_min
    axes.add_patch(Rectangle((x_min, y_min), wide, high, fill=False, ec=GREY))
    axes.plot(*nodes.T, "o", color=PALETTE[0], ms=4)
    axes.set_xlim(x_min - 0.03 * wide, x_max + 0.03 * wide)
    axes.set_ylim(y_min - 0.03 * high, y_max + 0.03 * high)
    return figure


def _draw_field(axes: Axes, site: Site, plan: PointPlan) -> None:
    frame_map(axes, f"{plan.chosen.size} of {plan.reach.size} sensors in reach")
    x, y = plan.position[:2]
    axes.plot(*site.positions[:, :2].T, ".", color=GREY, markersize=3, label="sensors")
    axes.plot(*site.positions[plan.reach, :2].T, ".", color=PALETTE[0], ms=6, label="in reach")
    for i in plan.chosen:
        axes.plot(*zip((x, y), site.positions[i, :2], strict=True), color=PALETTE[1], lw=1.2)
    chosen = site.positions[plan.chosen, :2]
    axes.plot(*chosen.T, "o", color=PALETTE[1], ms=8, label="chosen")
    if plan.chosen.size <= NAMED:
        for i, (px, py) in zip(map(int, plan.chosen), chosen.tolist(), strict=True):
            name, offset = site.sensor_ids[i], (4, 4)
            axes.annotate(name, (px, py), offset, textcoords="offset points", fontsize=8)
    axes.plot(x, y, "x", color="black", ms=10, mew=2, label="target")
    axes.legend(loc="best", fontsize=8)


def _draw_ellipses(axes: Axes, plan: PointPlan) -> None:
    """Draw 95 % ellipses about the target, for all that leave no direction unknown."""
    frame_map(axes, "95 % ellipses of the position")
    x, y = plan.position[:2]
    widest = 0.0
    sets = (
        ("all in reach", plan.all, PALETTE[0], ":"),
        (f"{plan.chosen.size} nearest", plan.nearest, PALETTE[2], "--"),
        ("chosen", plan.selection, PALETTE[1], "-"),
    )
    for name, known, colour, line in sets:
        if len(known.missing):
            continue
        width, height, angle = _axes_of(known.covariance[:2, :2])
        rms = np.sqrt(np.trace(known.covariance))
        label = f"{name}: rms {rms:.3g} m"
        shape = Ellipse((x, y), width, height, angle=angle, fill=False, ec=colour, ls=line, lw=1.6)
        shape.set_label(label)
        axes.add_patch(shape)
        widest = max(widest, width, height)
    axes.plot(x, y, "x", color="black", ms=8, mew=1.5)
    if widest:
        axes.set_xlim(x - 0.6 * widest, x + 0.6 * widest)
        axes.set_ylim(y - 0.6 * widest, y + 0.6 * widest)
        axes.legend(loc="upper right", fontsize=8)
    else:
        axes.text(0.5, 0.4, "a direction stays unknown", transform=axes.transAxes, ha="center")


def _axes_of(covariance: Matrix) -> tuple[float, float, float]:
    """Widths [m] and turn [deg] of the 95 % ellipse."""
    roots, axes = np.linalg.eigh(covariance)
    low, high = 2.0 * SIGMAS_95 * np.sqrt(roots)
    return float(high), float(low), float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
