"""One scan of a field of sensors, with a map of the likelihood; and a raster of detections."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle

from trackfield.plotting.style import PALETTE, frame_map, new_figure
from trackfield.raster import Raster
from trackfield.types import Indices, Matrix, Vector

_NATS = 15.0  # less likely places than this below the best all look alike


class Scan(NamedTuple):
    """What the sensors said at one time, and what is known of the targets.

    `sensors` (n, 2) [m]; `values` (n,) are signals or detections, NaN where nothing was heard;
    `likelihood` is drawn under them; `reports` (k, 2) and `targets` (m, 2) [m] over them.
    """

    sensors: Matrix
    values: Vector
    likelihood: Raster | None = None
    reports: Matrix | None = None
    targets: Matrix | None = None


def plot_scan(scan: Scan, *, title: str = "") -> Figure:
    """Draw one scan as a map: a sensor's disc grows with what it said."""
    figure = new_figure(7.0, 6.4)
    draw_scan(figure.add_subplot(), scan, title=title)
    return figure


def draw_scan(axes: Axes, scan: Scan, *, title: str = "") -> None:
    """Draw one scan into axes of a figure."""
    frame_map(axes, title)
    if scan.likelihood is not None:
        _draw_likelihood(axes, scan.likelihood)
    axes.plot(*scan.sensors.T, ".", color="0.45", markersize=2.0, zorder=2)
    said = np.flatnonzero(np.nan_to_num(scan.values) > 0.0)
    if said.size:
        size = 12.0 + 60.0 * scan.values[said] / float(scan.values[said].max())
        x, y = scan.sensors[said].T
        axes.scatter(x, y, s=size, color=PALETTE[0], alpha=0.55, zorder=3, label="said something")
    silent = np.flatnonzero(np.isnan(scan.values))
    if silent.size:
        axes.plot(*scan.sensors[silent].T, "x", color=PALETTE[1], markersize=4, label="not heard")
    if scan.targets is not None and len(scan.targets):
        axes.plot(*scan.targets.T, "x", color="black", markersize=9, mew=2, label="targets")
    if scan.reports is not None and len(scan.reports):
        x, y = scan.reports.T
        ring = MarkerStyle("o", fillstyle="none")
        axes.plot(x, y, marker=ring, ls="none", color=PALETTE[1], ms=13, mew=2, label="reports")
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles, labels, loc="upper right", fontsize=8)


def plot_detections(t_s: Vector, sensor: Indices, *, sensors: int, title: str = "") -> Figure:
    """Draw a raster of detections: a dot where sensor (n,) of `sensors` detected at `t_s` (n,)."""
    figure = new_figure(11.0, 5.0)
    axes = figure.add_subplot()
    size = float(np.clip(4000.0 / max(sensors, 1) / 10.0, 1.0, 12.0))
    axes.plot(t_s, sensor, "|", color=PALETTE[0], markersize=size, mew=1.2)
    axes.set(xlabel="time [s]", ylabel="sensor, in the order of the site", title=title)
    axes.set_ylim(-0.5, sensors - 0.5)
    axes.grid(axis="x", color="0.92")
    return figure


def _draw_likelihood(axes: Axes, likelihood: Raster) -> None:
    x_min, y_min, x_max, y_max = likelihood.region
    best = float(np.max(likelihood.values))
    image = axes.imshow(
        likelihood.values,
        vmin=max(best - _NATS, float(np.min(likelihood.values))),
        vmax=best,
        alpha=0.7,
        origin="lower",
        extent=(x_min, x_max, y_min, y_max),
        cmap="YlOrBr",
        interpolation="nearest",
        zorder=1,
    )
    figure = axes.get_figure(root=True)
    if figure is not None:
        figure.colorbar(image, ax=axes, shrink=0.8, label="log-likelihood")
