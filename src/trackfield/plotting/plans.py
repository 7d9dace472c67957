"""Plans as figures: how well a field locates, place by place."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke

from trackfield.plotting.style import GREY, NAMED, frame_map, new_figure
from trackfield.raster import Region
from trackfield.scheduling.accuracy import AccuracyMap
from trackfield.types import Matrix, Vector

_COARSE, _FINE = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)  # levels of contours
_FEW_LEVELS, _MOST_LEVELS = 3, 7
_ELLIPSES = 12  # along the longer side of a map
_HALO: list[AbstractPathEffect] = [
    withStroke(linewidth=2.0, foreground="white")
]  # round text on any colour
_SIZE_IN = 7.4  # of the longer side of a map


def plot_map(
    found: AccuracyMap, sensors: Matrix, *, names: tuple[str, ...] = (), title: str = ""
) -> Figure:
    """Draw a map of the rms error of positions with its contours [m], ellipses and `sensors`.

    Where no position follows the map is hatched. Sensors (n, 2) have `names` where they are few.
    """
    region = found.rms_m.region
    wide, high = region.x_max - region.x_min, region.y_max - region.y_min
    scale = _SIZE_IN / max(wide, high)
    figure = new_figure(max(scale * wide, 3.0) + 1.6, max(scale * high, 3.0) + 1.0)
    draw_map(figure.add_subplot(), found, sensors, names=names, title=title)
    return figure


def draw_map(
    axes: Axes,
    found: AccuracyMap,
    sensors: Matrix,
    *,
    names: tuple[str, ...] = (),
    title: str = "",
) -> None:
    """Draw such a map into axes of a figure."""
    frame_map(axes, title)
    axes.grid(visible=False)
    there = found.determined.values > 0.0
    region = found.rms_m.region
    handles: list[Patch] = [_hatched(axes, region)] if not there.all() else []
    if there.any():
        _draw_errors(axes, found)
        handles += _draw_ellipses(axes, found)
    (line,) = axes.plot(
        *sensors.T, "^", color="white", mec="black", ms=5, label="sensors", zorder=5
    )
    if len(sensors) > NAMED:
        line.set(marker=".", markersize=3.0 if len(sensors) <= 500 else 1.0, mew=0.3)
    for name, (x, y) in zip(names if len(sensors) <= NAMED else (), sensors, strict=False):
        text = axes.annotate(name, (x, y), (3, 3), textcoords="offset points", fontsize=7, zorder=6)
        text.set_path_effects(_HALO)
    axes.set(xlim=(region.x_min, region.x_max), ylim=(region.y_min, region.y_max))
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.1)}
    axes.legend(handles=[line, *handles], ncols=3, fontsize=8, frameon=False, **below)


def contour_levels(values: Vector) -> list[float]:
    """Find a few round numbers that `values` (n,) cross: 1, 2, 5 by powers of ten, or between."""
    low, high = (float(np.quantile(values, share)) for share in (0.01, 0.99))
    tens = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    levels: list[float] = []
    for bases in (_COARSE, _FINE):
        if len(levels) < _FEW_LEVELS:
            every = (float(f"{base:g}e{ten}") for ten in tens for base in bases)
            levels = [level for level in every if low < level < high]
    return levels[:: max(1, -(-len(levels) // _MOST_LEVELS))]


def _hatched(axes: Axes, region: Region) -> Patch:
    """Hatch the whole region; the map lies over it where a position follows."""
    x, y = (region.x_min, region.x_max), (region.y_min, region.y_max)
    style: dict[str, Any] = {
        "facecolor": "0.96",
        "edgecolor": "0.6",
        "hatch": "////",
        "linewidth": 0.0,
    }
    axes.fill_between(x, y[0], y[1], zorder=0.5, **style)
    return Patch(label="no position follows", **style)


def _draw_errors(axes: Axes, found: AccuracyMap) -> None:
    region, there = found.rms_m.region, found.determined.values > 0.0
    rms = np.ma.masked_array(found.rms_m.values, ~there)
    known = found.rms_m.values[there]
    low, high = (float(np.quantile(known, share)) for share in (0.01, 0.97))
    levels = contour_levels(known)
    image = axes.imshow(
        rms,
        norm=LogNorm(low, max(high, 1.2 * low)),
        origin="lower",
        extent=(region.x_min, region.x_max, region.y_min, region.y_max),
        cmap="YlGnBu_r",
        interpolation="nearest",
        zorder=1,
    )
    figure = axes.get_figure(root=True)
    if figure is not None:
        bar = figure.colorbar(image, ax=axes, shrink=0.8, ticks=levels or None, format="{x:g}")
        bar.minorticks_off()
        bar.set_label("rms error of a position [m]")
    if levels and min(rms.shape) > 1:
        x, y = _axes_of(found)
        lines = axes.contour(x, y, rms, levels=levels, colors="black", linewidths=0.8, zorder=3)
        for text in axes.clabel(lines, fmt="%g m", fontsize=8):
            text.set_path_effects(_HALO)


def _draw_ellipses(axes: Axes, found: AccuracyMap) -> list[Patch]:
    """Draw ellipses of one standard deviation on a coarse grid, all enlarged alike."""
    rows, columns = found.rms_m.values.shape
    x, y = _axes_of(found)
    step = max(1, round(max(rows, columns) / _ELLIPSES))
    picked = (slice(step // 2, None, step), slice(step // 2, None, step))
    there = found.determined.values[picked] > 0.0
    if not there.any():
        return []
    major, minor = found.major_m.values[picked][there], found.minor_m.values[picked][there]
    spacing = step * (x[1] - x[0] if columns > 1 else y[1] - y[0] if rows > 1 else 1.0)
    factor = 0.3 * spacing / float(np.median(major))
    factor = float(f"{factor:.1g}")
    grid = np.stack(np.meshgrid(x, y), axis=-1)[picked][there]
    axes.add_collection(
        EllipseCollection(
            2.0 * factor * np.minimum(major, spacing / factor),
            2.0 * factor * minor,
            np.degrees(found.angle_rad.values[picked][there]),
            units="xy",
            offsets=grid,
            offset_transform=axes.transData,
            facecolors="none",
            edgecolors=GREY,
            linewidths=0.8,
            zorder=2,
        )
    )
    label = f"standard deviations x {factor:g}"
    return [Patch(facecolor="none", edgecolor=GREY, label=label)]


def _axes_of(found: AccuracyMap) -> tuple[Vector, Vector]:
    """Centres of the columns and of the rows."""
    _, columns = found.rms_m.values.shape
    centres = found.rms_m.centres()
    return centres[:columns, 0], centres[::columns, 1]
