"""A run of many targets: where tracks went, who was followed by which, and how many there were."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from trackfield.plotting.style import GREY, PALETTE, broken, frame_map, new_figure
from trackfield.raster import Region
from trackfield.types import Indices, Matrix, Reports, Status, Tracks, Truth, Vector

_FEW_SENSORS = 1000  # more of them are drawn as a tint
_POINTS = 20000  # reports that are drawn, at most
_SMALL: dict[str, Any] = {"textcoords": "offset points", "fontsize": 7}
_ROWS = 60  # of the timeline that have a name beside them, at most


class Scenery(NamedTuple):
    """What is drawn beside tracks, where it is known.

    `sensors` (n, 2) [m]; `followed` (rows,) holds for each row of the tracks the place in
    `truth.target_ids` of the target that it followed, -1 for none.
    """

    region: Region | None = None
    sensors: Matrix | None = None
    reports: Reports | None = None
    truth: Truth | None = None
    followed: Indices | None = None


NOTHING = Scenery()
"""Nothing is drawn beside the tracks."""


def plot_many(tracks: Tracks, scenery: Scenery = NOTHING, *, title: str = "") -> Figure:
    """Draw the shown rows of tracks as a map, a timeline of identities, and counts over time.

    A row of the timeline is a true target, coloured by the track that followed it (where `followed`
    is known), or a track.
    """
    shown = (tracks.status == Status.CONFIRMED) | (tracks.status == Status.COASTING)
    figure = new_figure(13.0, 6.8)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.1, 1.0), height_ratios=(2.2, 1.0))
    _draw_map(figure.add_subplot(grid[:, 0]), tracks, shown, scenery=scenery)
    top = figure.add_subplot(grid[0, 1])
    _draw_timeline(top, tracks, shown, scenery=scenery)
    _draw_counts(figure.add_subplot(grid[1, 1], sharex=top), tracks, shown, scenery=scenery)
    if title:
        figure.suptitle(title)
    return figure


def colour_of(track: int) -> str:
    """Colour of a track's identity, the same in every figure."""
    return PALETTE[(track - 1) % len(PALETTE)]


def _draw_map(axes: Axes, tracks: Tracks, shown: NDArray[np.bool_], *, scenery: Scenery) -> None:
    frame_map(axes, "Where targets went")
    if scenery.sensors is not None:
        size = 2.0 if len(scenery.sensors) <= _FEW_SENSORS else 0.5
        axes.plot(*scenery.sensors.T, ".", color="0.8", markersize=size, zorder=0, label="sensors")
    if scenery.reports is not None and len(scenery.reports):
        step = -(-len(scenery.reports) // _POINTS)
        x, y = scenery.reports.position[::step, :2].T
        axes.plot(x, y, ".", color="0.6", markersize=2.5, alpha=0.5, zorder=1, label="reports")
    if scenery.truth is not None:
        _draw_truth(axes, scenery.truth)
    gap = 3.0 * _step(tracks.t_s)
    for number in np.unique(tracks.track[shown]):
        rows = np.flatnonzero(shown & (tracks.track == number))
        path = broken(tracks.t_s[rows], tracks.position[rows, :2], gap_s=gap)
        colour = colour_of(int(number))
        axes.plot(*path.T, color=colour, linewidth=1.2, zorder=3)
        axes.plot(*tracks.position[rows[0], :2], "o", color=colour, markersize=3.5, zorder=4)
    axes.plot([], [], "o-", color=PALETTE[0], markersize=3.5, label="tracks, from the dot")
    if scenery.region is not None:
        x_min, y_min, x_max, y_max = scenery.region
        x = [x_min, x_max, x_max, x_min, x_min]
        axes.plot(x, [y_min, y_min, y_max, y_max, y_min], color="black", linewidth=0.8)
    figure = axes.get_figure(root=True)
    if figure is not None:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=5)


def _draw_truth(axes: Axes, truth: Truth) -> None:
    gap = 3.0 * _step(truth.t_s)
    for i in range(len(truth.target_ids)):
        own = truth.target == i
        path = broken(truth.t_s[own], truth.position[own, :2], gap_s=gap)
        label = "truth" if i == 0 else None
        axes.plot(*path.T, color=GREY, linewidth=3.0, alpha=0.6, zorder=2, label=label)


def _draw_timeline(
    axes: Axes, tracks: Tracks, shown: NDArray[np.bool_], *, scenery: Scenery
) -> None:
    """Draw a bar a row: of true targets over the tracks that followed them, or of tracks."""
    axes.set_title("Who was followed by which track" if _followed(scenery) else "Tracks in time")
    if scenery.truth is not None and scenery.followed is not None:
        truth, followed = scenery.truth, scenery.followed
        half = _step(truth.t_s) / 2
        for i in range(len(truth.target_ids)):
            _bars(axes, truth.t_s[truth.target == i], i, half, colours=["0.85"], width=5.0)
            rows = np.flatnonzero(shown & (followed == i))
            for number in np.unique(tracks.track[rows]):
                own = tracks.t_s[rows[tracks.track[rows] == number]]
                _bars(axes, own, i, half, colours=[colour_of(int(number))], width=3.0)
                if len(truth.target_ids) <= _ROWS // 2:
                    axes.annotate(str(number), (own.min(), i), (1, 3), **_SMALL)
        names: list[str] = list(truth.target_ids)
        axes.set_ylabel("true target")
    else:
        half = _step(tracks.t_s) / 2
        numbers = np.unique(tracks.track[shown])
        for i, number in enumerate(numbers):
            own = shown & (tracks.track == number)
            for status, width in ((Status.COASTING, 1.2), (Status.CONFIRMED, 3.5)):
                times = tracks.t_s[own & (tracks.status == status)]
                _bars(axes, times, i, half, colours=[colour_of(int(number))], width=width)
        names = [str(number) for number in numbers]
        axes.set_ylabel("track (thin: not detected)")
    if len(names) <= _ROWS:
        axes.set_yticks(range(len(names)), names, fontsize=7 if len(names) > 20 else 9)
    axes.set_ylim(-1.0, max(len(names), 1))
    axes.grid(axis="x", color="0.92")
    axes.tick_params(labelbottom=False)


def _bars(
    axes: Axes, times: Vector, row: int, half: float, *, colours: list[str], width: float
) -> None:
    """Draw a bar where `times` follow each other by at most three half steps."""
    if not times.size:
        return
    times = np.unique(times)
    cuts = np.flatnonzero(np.diff(times) > 3.0 * half)
    starts = np.concatenate([times[:1], times[cuts + 1]]) - half
    ends = np.concatenate([times[cuts], times[-1:]]) + half
    segments = [[(a, float(row)), (b, float(row))] for a, b in zip(starts, ends, strict=True)]
    axes.add_collection(LineCollection(segments, colors=colours, linewidths=width))
    axes.update_datalim([(float(starts[0]), float(row)), (float(ends[-1]), float(row))])
    axes.autoscale_view()


def _draw_counts(axes: Axes, tracks: Tracks, shown: NDArray[np.bool_], *, scenery: Scenery) -> None:
    axes.set(xlabel="time [s]", ylabel="targets")
    if scenery.truth is not None:
        times, counts = np.unique(scenery.truth.t_s, return_counts=True)
        axes.step(times, counts, where="mid", color=GREY, linewidth=2.5, label="truth")
    times = np.unique(tracks.t_s)
    counts = np.bincount(np.searchsorted(times, tracks.t_s[shown]), minlength=times.size)
    axes.step(times, counts, where="mid", color=PALETTE[0], linewidth=1.2, label="shown")
    axes.set_ylim(bottom=0.0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(color="0.92")
    axes.legend(loc="lower right", fontsize=9)


def _followed(scenery: Scenery) -> bool:
    return scenery.truth is not None and scenery.followed is not None


def _step(t_s: Vector) -> float:
    """Find the usual time between steps [s]; 1 s where there is only one."""
    steps = np.diff(np.unique(t_s))
    return float(np.median(steps)) if steps.size else 1.0
