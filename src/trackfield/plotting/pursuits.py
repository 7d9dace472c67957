"""A pursuit on a map: the ways of evaders and pursuers, and where they met."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike, NDArray

from trackfield.plotting.many import Scenery
from trackfield.plotting.style import GREY, PALETTE, frame_map, new_figure
from trackfield.types import Matrix, Reports, Status, Tracks, Truth, Vector


class Chase(NamedTuple):
    """What is drawn: pursuers' `paths` (steps, p, 2) [m] at `t_s` (steps,), and evaders.

    `captured` tells, by place in `truth.target_ids`, when evaders were captured [s] and by whom;
    `obstacles` are polygons (m, 2) [m]; `tracks` is what pursuers knew.
    """

    t_s: Vector
    paths: NDArray[np.float64]
    truth: Truth
    tracks: Tracks
    captured: Sequence[tuple[int, float, int]] = ()
    obstacles: Sequence[ArrayLike] = ()


def plot_pursuit(chase: Chase, scenery: Scenery, *, title: str = "") -> Figure:
    """Draw the ways of evaders (thick, grey) and pursuers (thin), captures as crosses.

    Points are what pursuers knew of evaders: shown rows of tracks. Of `scenery` the region and the
    sensors are drawn.
    """
    figure = new_figure(7.2, 7.0)
    axes = figure.add_subplot()
    frame_map(axes, title or "Pursuit")
    draw_pursuit(axes, chase)
    if scenery.sensors is not None:
        axes.plot(*scenery.sensors.T, ".", color="0.8", markersize=2, zorder=0)
    if scenery.region is not None:
        x_min, y_min, x_max, y_max = scenery.region
        axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max))
    axes.legend(fontsize=8, loc="best")
    return figure


def draw_pursuit(axes: Axes, chase: Chase) -> None:
    """Draw a pursuit into axes."""
    for corners in chase.obstacles:
        shape = np.asarray(corners, np.float64)
        axes.add_patch(Polygon(shape, closed=True, color="0.85", zorder=0))
    for j in range(len(chase.truth.target_ids)):
        path = chase.truth.position[chase.truth.target == j, :2]
        label = "evader" if j == 0 else None
        axes.plot(*path.T, color=GREY, linewidth=3, alpha=0.6, label=label)
        if len(path):
            axes.plot(*path[0], "o", color=GREY, markerfacecolor="none", markersize=8)
    known = _shown(chase.tracks)
    axes.plot(*known.T, ".", color="0.5", markersize=3, label="what is known of evaders")
    ends = _last_steps(chase)
    for i in range(chase.paths.shape[1]):
        path = chase.paths[: ends[i] + 1, i]
        colour = PALETTE[i % len(PALETTE)]
        axes.plot(*path.T, ".-", color=colour, linewidth=1, markersize=4, label=f"pursuer {i}")
        axes.plot(*path[0], "s", color=colour, markersize=7)
    for place, (_, t_s, pursuer) in enumerate(chase.captured):
        at = chase.paths[int(np.abs(chase.t_s - t_s).argmin()), pursuer]
        label = "captured" if place == 0 else None
        axes.plot(*at, "x", color="black", markersize=10, markeredgewidth=2, label=label)


def as_tracks(chase: Chase) -> Tracks:
    """Make rows of tracks of pursuers' ways, numbered from 1, for an animation."""
    steps, count = len(chase.t_s), int(chase.paths.shape[1])
    n = steps * count
    nothing = np.full((n, 1), np.nan)
    return Tracks(
        t_s=np.repeat(chase.t_s, count),
        track=np.tile(np.arange(1, count + 1, dtype=np.int32), steps),
        position=np.hstack([chase.paths.reshape(n, 2), nothing]),
        velocity=np.hstack([np.zeros((n, 2)), nothing]),
        covariance=np.zeros((n, 3)),
        status=np.full(n, Status.CONFIRMED, np.int32),
        target=np.full(n, -1, np.int32),
        nis=nothing[:, 0],
        target_ids=(),
    )


def known_places(tracks: Tracks) -> Reports:
    """Make reports of the shown rows of tracks, for an animation beside pursuers."""
    rows = np.isin(tracks.status, (Status.CONFIRMED, Status.COASTING))
    nothing = np.full(int(rows.sum()), np.nan)
    return Reports(
        t_s=tracks.t_s[rows],
        arrival_s=nothing,
        position=tracks.position[rows],
        covariance=tracks.covariance[rows],
        confidence=nothing,
    )


def _shown(tracks: Tracks) -> Matrix:
    return known_places(tracks).position[:, :2]


def _last_steps(chase: Chase) -> list[int]:
    """Until which step each pursuer's way is drawn: when all evaders are captured, it is over."""
    last = len(chase.t_s) - 1
    if chase.captured and len(chase.captured) == len(chase.truth.target_ids):
        last = int(np.searchsorted(chase.t_s, max(t_s for _, t_s, _ in chase.captured)))
    return [last] * chase.paths.shape[1]
