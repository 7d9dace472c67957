"""A run of tagged targets: where they were, how far off, and whether innovations are honest."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from trackfield.network.site import Site
from trackfield.plotting.style import (
    GREY,
    NAMED,
    PALETTE,
    SIGMAS_95,
    broken,
    frame_map,
    new_figure,
)
from trackfield.types import Matrix, Status, Tracks, Truth, Vector

ELLIPSES = 40  # drawn along a track, at most
_FEW = 60  # rows, up to which each is marked


class Errors(NamedTuple):
    """Errors (m, >= 2) [m] of those `rows` (m,) of tracks that have a truth."""

    rows: NDArray[np.intp]
    error: Matrix


class Course(NamedTuple):
    """A straight pass: where it begins and ends (2, 2) [m], and how likely it is this one."""

    ends: Matrix
    weight: float


def plot_tracks(
    site: Site,
    tracks: Tracks,
    *,
    truth: Truth | None = None,
    errors: Errors | None = None,
    courses: Sequence[Course] = (),
) -> Figure:
    """Draw sensors, truth and tracks with 95 % ellipses, and beside it accuracy over time.

    `errors` are those of the tracks against the truth; without them the ellipses' size is shown.
    Below it stand the innovations, if there are any. `courses` are drawn the fainter the less
    likely they are.
    """
    figure = new_figure(12.0, 6.4)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0), height_ratios=(2.0, 1.0))
    shown = (tracks.status == Status.CONFIRMED) | (tracks.status == Status.COASTING)
    place = figure.add_subplot(grid[:, 0])
    _draw_courses(place, courses)
    _draw_map(place, site, tracks, shown=shown, truth=truth)
    judged = not np.isnan(tracks.nis[shown]).all()  # trajectories of passes have no innovations
    top = figure.add_subplot(grid[0, 1] if judged else grid[:, 1])
    _draw_accuracy(top, tracks, shown, errors=errors)
    if judged:
        _draw_nis(figure.add_subplot(grid[1, 1], sharex=top), tracks, shown)
    else:
        top.set_xlabel("time [s]")
        top.tick_params(labelbottom=True)
    figure.suptitle(site.name)
    return figure


def _draw_map(
    axes: Axes, site: Site, tracks: Tracks, *, shown: NDArray[np.bool_], truth: Truth | None
) -> None:
    _draw_sensors(axes, site)
    if truth is not None:
        for i in range(len(truth.target_ids)):
            own = truth.target == i
            x, y, _ = broken(truth.t_s[own], truth.position[own]).T
            label = "truth" if i == 0 else None
            axes.plot(x, y, color=GREY, linewidth=2.6, alpha=0.7, label=label, zorder=1)
    names = list(_targets(tracks))
    for i, (name, own) in enumerate(names):
        colour = PALETTE[i % len(PALETTE)]
        rows = np.flatnonzero(own & shown)
        x, y, _ = broken(tracks.t_s[rows], tracks.position[rows]).T
        label = "track" if len(names) == 1 else f"track of {name}"
        marker = "o" if rows.size <= _FEW else ""
        axes.plot(
            x, y, color=colour, linewidth=1.0, marker=marker, markersize=3, label=label, zorder=3
        )
        label = "95 % ellipse" if i == 0 else None
        _draw_ellipses(axes, tracks, rows, colour=colour, label=label)
    frame_map(axes, "Where it was")
    axes.margins(0.06)
    # Below the map, in the figure: the layout keeps room for it, however many rows it has.
    figure = axes.get_figure(root=True)
    if figure is not None:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=6)


def _draw_courses(axes: Axes, courses: Sequence[Course]) -> None:
    for i, course in enumerate(courses):
        label = "trajectory" if i == 0 else None
        axes.plot(
            *course.ends.T,
            color=PALETTE[0],
            linestyle="--",
            linewidth=1.2,
            alpha=max(0.15, min(1.0, course.weight)),
            label=label,
            zorder=2,
        )


def _draw_sensors(axes: Axes, site: Site) -> None:
    x, y = site.positions[:, 0], site.positions[:, 1]
    axes.plot(x, y, "^", color="black", markersize=8, label="sensor", zorder=4, linestyle="none")
    if len(site.sensor_ids) <= NAMED:
        for name, a, b in zip(site.sensor_ids, x, y, strict=True):
            axes.annotate(name, (a, b), (5, 5), textcoords="offset points", fontsize=9)


def _draw_ellipses(
    axes: Axes, tracks: Tracks, rows: NDArray[np.intp], *, colour: str, label: str | None
) -> None:
    """Draw the 95 % ellipses of rows at even times, the small ones where they would overlap."""
    if rows.size == 0:
        return
    t = tracks.t_s[rows]
    times: Vector = t[0] + (t[-1] - t[0]) * np.arange(ELLIPSES) / (ELLIPSES - 1)
    rows = rows[np.unique(np.minimum(np.searchsorted(t, times), rows.size - 1))]
    rows = rows[
        _apart(tracks.position[rows, :2], SIGMAS_95 * np.sqrt(_largest(tracks.covariance[rows])))
    ]
    xx, xy, yy = tracks.covariance[rows].T
    largest = _largest(tracks.covariance[rows])
    size = 2.0 * SIGMAS_95 * np.sqrt(np.maximum([largest, xx + yy - largest], 0.0))
    turn = np.degrees(0.5 * np.arctan2(2.0 * xy, xx - yy))
    ellipses = EllipseCollection(
        size[0],
        size[1],
        turn,
        units="xy",
        offsets=tracks.position[rows, :2],
        offset_transform=axes.transData,
        facecolors=f"{colour}30",
        edgecolors=colour,
        linewidths=0.7,
        zorder=2,
    )
    axes.add_collection(ellipses)
    # A legend knows no ellipses: a ring of their colours stands for them.
    axes.plot([], [], "o", color=f"{colour}30", markeredgecolor=colour, markersize=9, label=label)


def _apart(centres: Matrix, radius: Vector) -> NDArray[np.intp]:
    """Choose rows (m,) whose discs hold no other one's centre, the smaller discs first."""
    kept: list[int] = []
    for row in np.argsort(radius, kind="stable").tolist():
        gaps = np.hypot(*(centres[kept] - centres[row]).T)
        if np.all(gaps >= radius[row]):
            kept.append(row)
    return np.array(sorted(kept), np.intp)


def _draw_accuracy(
    axes: Axes, tracks: Tracks, shown: NDArray[np.bool_], *, errors: Errors | None
) -> None:
    """Draw the horizontal error over time under its bound, the long half axis of the ellipse."""
    bound = SIGMAS_95 * np.sqrt(_largest(tracks.covariance))
    names = list(_targets(tracks))
    for i, (name, own) in enumerate(names):
        colour, of = PALETTE[i % len(PALETTE)], f" of {name}" if len(names) > 1 else ""
        rows = np.flatnonzero(own & shown)
        t, b = broken(tracks.t_s[rows], np.column_stack([tracks.t_s, bound])[rows]).T
        style: dict[str, Any] = {"color": colour, "linewidth": 0.8}
        if errors is None:
            axes.plot(t, b, label=f"95 % bound{of}", **style)
            continue
        axes.fill_between(t, b, color=colour, alpha=0.2, linewidth=0, label=f"95 % bound{of}")
        mine = own[errors.rows]
        size = np.column_stack([tracks.t_s[errors.rows], np.hypot(*errors.error[:, :2].T)])[mine]
        marker = "o" if len(size) <= _FEW else ""
        line = broken(size[:, 0], size).T
        axes.plot(*line, label=f"error{of}", marker=marker, markersize=3, **style)
    top = [bound[shown]]
    if errors is not None and errors.rows.size:
        top.append(1.1 * np.hypot(*errors.error[:, :2].T))
    axes.set_ylim(0.0, max((float(np.percentile(v, 99.0)) for v in top if v.size), default=1.0))
    axes.set(ylabel="position error [m]", title="How far off, and how far it could be")
    axes.grid(color="0.92")
    axes.tick_params(labelbottom=False)
    axes.legend(loc="upper right", fontsize=9)


def _draw_nis(axes: Axes, tracks: Tracks, shown: NDArray[np.bool_]) -> None:
    """Draw normalised innovations, averaged over fiftieths of the time, beside their mean of 1."""
    known = shown & ~np.isnan(tracks.nis)
    axes.set(xlabel="time [s]", ylabel="NIS, clipped at 9", title="Innovations")
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--", label="expected")
    axes.grid(color="0.92")
    axes.set_ylim(0.0, 4.0)
    if known.any():
        t, nis = tracks.t_s[known], np.minimum(tracks.nis[known], 9.0)
        width = max(float(np.ptp(t)), 1e-9) / 50
        place = np.minimum((t - t.min()) / width, 49).astype(np.intp)
        count = np.bincount(place, minlength=50)
        total = np.bincount(place, nis, minlength=50)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        middle = t.min() + width * (np.arange(50) + 0.5)
        axes.plot(middle, mean, "o-", color=PALETTE[0], markersize=3, linewidth=0.8, label="mean")
        axes.set_ylim(0.0, max(2.0, 1.15 * float(np.nanmax(mean))))
    axes.legend(loc="upper right", fontsize=9, ncols=2)


def _targets(tracks: Tracks) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Names of the targets that have rows, and their rows (n,)."""
    for target in np.unique(tracks.target):
        name = tracks.target_ids[int(target)] if target >= 0 else "unnamed"
        yield name, tracks.target == target


def _largest(covariance: Matrix) -> Vector:
    """Find the larger eigenvalue (n,) [m^2] of covariances xx, xy, yy (n, 3)."""
    xx, xy, yy = covariance.T
    return 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
