"""Figures of tracks and of calibrations, as files; drawn with Matplotlib (extra `plot`).

Colours are those of Okabe and Ito, which colour-blind readers can tell apart; shape and line style
say the same again.
"""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from trackfield.calibration.ranges import Calibration
from trackfield.errors import InputError
from trackfield.network.site import Site
from trackfield.sensing.range import RangeColumns, columns, expected, variance
from trackfield.types import Indices, Matrix, Status, Tracks, Truth, Vector

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
GREY = "#8C8C8C"
SIGMAS_95 = 2.447746830680816  # half an axis of the 95 % ellipse in standard deviations
ELLIPSES = 40  # drawn along a track
POINTS = 4000  # drawn of a cloud, at most
NAMED = 40  # sensors that are named, at most
GAP_S = 3.0  # a line is broken where nothing was known for longer


class Errors(NamedTuple):
    """Errors (m, >= 2) [m] of those `rows` (m,) of tracks that have a truth."""

    rows: NDArray[np.intp]
    error: Matrix


class _Points(NamedTuple):
    """Readings of a calibration, (n,) each: what was wrong with them before and after.

    `left_m` is reading minus what the calibrated model expects, `fitted_m` the error that it
    expects, `sigma_m` the standard deviation that it gives the reading.
    """

    sensor: Indices
    target: Indices
    distance_m: Vector
    left_m: Vector
    fitted_m: Vector
    sigma_m: Vector


def plot_tracks(
    site: Site, tracks: Tracks, *, truth: Truth | None = None, errors: Errors | None = None
) -> Figure:
    """Draw sensors, truth and tracks with 95 % ellipses, and beside it accuracy over time.

    `errors` are those of the tracks against the truth; without them the ellipses' size is shown.
    """
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0), height_ratios=(2.0, 1.0))
    shown = (tracks.status == Status.CONFIRMED) | (tracks.status == Status.COASTING)
    _draw_map(figure.add_subplot(grid[:, 0]), site, tracks, shown=shown, truth=truth)
    top = figure.add_subplot(grid[0, 1])
    _draw_accuracy(top, tracks, shown, errors=errors)
    _draw_nis(figure.add_subplot(grid[1, 1], sharex=top), tracks, shown)
    figure.suptitle(site.name)
    return figure


def plot_calibration(calibration: Calibration, *, target_ids: Sequence[str], title: str) -> Figure:
    """Draw how well calibrated models fit: errors before and after, normality, spread a sensor.

    `target_ids` are those of the readings that were calibrated on.
    """
    sensor_ids = calibration.site.sensor_ids
    points = _points(calibration, target_ids)
    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    before, after, normal, spread = figure.subplots(2, 2).ravel()
    few = _thinned(points)
    _draw_clouds(before, few, few.left_m + few.fitted_m, names=sensor_ids)
    _draw_lines(before, few)
    before.set(title="Before: error of the readings, and the fitted model", ylabel="error [m]")
    _draw_clouds(after, few, few.left_m, names=sensor_ids)
    after.axhline(0.0, color="black", linewidth=0.8)
    after.set(title="After: what the model leaves", ylabel="residual [m]")
    for axes, values in ((before, few.left_m + few.fitted_m), (after, few.left_m)):
        axes.set_xlabel("true distance [m]")
        _limit(axes, values)
    _draw_quantiles(normal, points.left_m / points.sigma_m)
    _draw_spread(spread, points, sensor_ids)
    figure.suptitle(title)
    return figure


def kind_of(path: Path) -> str:
    """Kind of picture that the suffix of `path` says; `InputError` if there is none such."""
    kinds = FigureCanvasAgg.get_supported_filetypes()
    kind = path.suffix.removeprefix(".").lower()
    if kind not in kinds:
        expected = ", ".join(f".{kind}" for kind in sorted(kinds))
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected one of {expected}")
    return kind


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure, whole or not at all; the kind of file follows from its suffix."""
    path = Path(path)
    kind = kind_of(path)
    part = path.with_name(f".{path.name}.part")
    try:
        figure.savefig(part, dpi=150, format=kind)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _draw_map(
    axes: Axes, site: Site, tracks: Tracks, *, shown: NDArray[np.bool_], truth: Truth | None
) -> None:
    _draw_sensors(axes, site)
    if truth is not None:
        for i in range(len(truth.target_ids)):
            own = truth.target == i
            x, y, _ = _broken(truth.t_s[own], truth.position[own]).T
            label = "truth" if i == 0 else None
            axes.plot(x, y, color=GREY, linewidth=2.6, alpha=0.7, label=label, zorder=1)
    names = list(_targets(tracks))
    for i, (name, own) in enumerate(names):
        colour = PALETTE[i % len(PALETTE)]
        rows = np.flatnonzero(own & shown)
        x, y, _ = _broken(tracks.t_s[rows], tracks.position[rows]).T
        label = "track" if len(names) == 1 else f"track of {name}"
        axes.plot(x, y, color=colour, linewidth=1.0, label=label, zorder=3)
        label = "95 % ellipse" if i == 0 else None
        _draw_ellipses(axes, tracks, rows, colour=colour, label=label)
    axes.set(xlabel="x, east [m]", ylabel="y, north [m]", aspect="equal")
    axes.set_title("Where it was")
    axes.margins(0.06)
    axes.grid(color="0.92")
    axes.set_axisbelow(True)
    # Below the map, in the figure: the layout keeps room for it, however many rows it has.
    figure = axes.get_figure(root=True)
    if figure is not None:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=6)


def _draw_sensors(axes: Axes, site: Site) -> None:
    x, y = site.positions[:, 0], site.positions[:, 1]
    axes.plot(x, y, "^", color="black", markersize=8, label="sensor", zorder=4, linestyle="none")
    if len(site.sensor_ids) <= NAMED:
        for name, a, b in zip(site.sensor_ids, x, y, strict=True):
            axes.annotate(name, (a, b), (5, 5), textcoords="offset points", fontsize=9)


def _draw_ellipses(
    axes: Axes, tracks: Tracks, rows: NDArray[np.intp], *, colour: str, label: str | None
) -> None:
    """Draw the 95 % ellipses of rows at even times."""
    if rows.size == 0:
        return
    t = tracks.t_s[rows]
    times: Vector = t[0] + (t[-1] - t[0]) * np.arange(ELLIPSES) / (ELLIPSES - 1)
    rows = rows[np.unique(np.minimum(np.searchsorted(t, times), rows.size - 1))]
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


def _draw_accuracy(
    axes: Axes, tracks: Tracks, shown: NDArray[np.bool_], *, errors: Errors | None
) -> None:
    """Draw the horizontal error over time under its bound, the long half axis of the ellipse."""
    bound = SIGMAS_95 * np.sqrt(_largest(tracks.covariance))
    names = list(_targets(tracks))
    for i, (name, own) in enumerate(names):
        colour, of = PALETTE[i % len(PALETTE)], f" of {name}" if len(names) > 1 else ""
        rows = np.flatnonzero(own & shown)
        t, b = _broken(tracks.t_s[rows], np.column_stack([tracks.t_s, bound])[rows]).T
        style: dict[str, Any] = {"color": colour, "linewidth": 0.8}
        if errors is None:
            axes.plot(t, b, label=f"95 % bound{of}", **style)
            continue
        axes.fill_between(t, b, color=colour, alpha=0.2, linewidth=0, label=f"95 % bound{of}")
        mine = own[errors.rows]
        size = np.column_stack([tracks.t_s[errors.rows], np.hypot(*errors.error[:, :2].T)])[mine]
        axes.plot(*_broken(size[:, 0], size).T, label=f"error{of}", **style)
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


def _draw_clouds(axes: Axes, few: _Points, values: Vector, *, names: Sequence[str]) -> None:
    for sensor in np.unique(few.sensor):
        own = few.sensor == sensor
        colour = PALETTE[int(sensor) % len(PALETTE)]
        style: dict[str, Any] = {
            "color": colour,
            "markersize": 2.5,
            "alpha": 0.5,
            "linestyle": "none",
        }
        axes.plot(few.distance_m[own], values[own], ".", label=names[int(sensor)], **style)
    axes.grid(color="0.92")
    if len(names) <= 2 * len(PALETTE):
        axes.legend(fontsize=8, ncols=2, markerscale=3, loc="upper left")


def _draw_lines(axes: Axes, few: _Points) -> None:
    for sensor, target in np.unique(np.column_stack([few.sensor, few.target]), axis=0):
        own = np.flatnonzero((few.sensor == sensor) & (few.target == target))
        ends = own[[np.argmin(few.distance_m[own]), np.argmax(few.distance_m[own])]]
        colour = PALETTE[int(sensor) % len(PALETTE)]
        axes.plot(few.distance_m[ends], few.fitted_m[ends], color="white", linewidth=3.5)
        axes.plot(few.distance_m[ends], few.fitted_m[ends], color=colour, linewidth=1.8)


def _draw_quantiles(axes: Axes, scaled: Vector) -> None:
    """Draw quantiles of residuals in standard deviations against those of the normal law."""
    from scipy.special import ndtri

    share = (np.arange(min(scaled.size, POINTS)) + 0.5) / min(scaled.size, POINTS)
    expected, found = ndtri(share), np.quantile(scaled, share)
    axes.axline((0, 0), slope=1, color="black", linewidth=0.8, linestyle="--", label="normal")
    axes.plot(expected, found, ".", color=PALETTE[0], markersize=3, label="residuals")
    axes.set(xlabel="normal quantile", ylabel="residual / sigma", title="Are residuals normal?")
    axes.set(xlim=(-4, 4), ylim=(-8, 8))
    axes.grid(color="0.92")
    axes.legend(loc="upper left", fontsize=9)


def _draw_spread(axes: Axes, points: _Points, names: Sequence[str]) -> None:
    """Draw 5, 25, 50, 75, 95 % of the residuals of every sensor."""
    sensors = [int(sensor) for sensor in np.unique(points.sensor)]
    groups = [points.left_m[points.sensor == sensor] for sensor in sensors]
    axes.boxplot(
        groups,
        whis=(5, 95),
        showfliers=False,
        patch_artist=True,
        boxprops={"facecolor": f"{PALETTE[0]}40"},
        medianprops={"color": PALETTE[1]},
    )
    labels = [f"{names[s]}\n{group.size}" for s, group in zip(sensors, groups, strict=True)]
    axes.set_xticks(range(1, len(labels) + 1), labels, fontsize=8 if len(labels) <= 12 else 5)
    axes.axhline(0.0, color="black", linewidth=0.8, zorder=0)
    axes.set(xlabel="sensor, readings", ylabel="residual [m]", title="Spread: 5, 25, 50, 75, 95 %")
    axes.grid(axis="y", color="0.92")


def _limit(axes: Axes, values: Vector) -> None:
    """Show the middle 99 % of the values and half as much again: gross errors must not rule."""
    low, high = np.percentile(values, [0.5, 99.5])
    margin = 0.25 * max(float(high - low), 1e-6)
    axes.set_ylim(float(low) - margin, float(high) + margin)


def _targets(tracks: Tracks) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Names of the targets that have rows, and their rows (n,)."""
    for target in np.unique(tracks.target):
        name = tracks.target_ids[int(target)] if target >= 0 else "unnamed"
        yield name, tracks.target == target


def _broken(t_s: Vector, values: Matrix) -> Matrix:
    """Put a row of NaN into `values` (n, d) wherever more than `GAP_S` passed: a broken line."""
    gaps = np.flatnonzero(np.diff(t_s) > GAP_S) + 1
    return np.insert(values, gaps, np.nan, axis=0)


def _largest(covariance: Matrix) -> Vector:
    """Find the larger eigenvalue (n,) [m^2] of covariances xx, xy, yy (n, 3)."""
    xx, xy, yy = covariance.T
    return 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)


def _points(calibration: Calibration, target_ids: Sequence[str]) -> _Points:
    site, residuals = calibration.site, calibration.residuals
    r = residuals.distance_m
    fitted, sigma = np.zeros(r.size), np.ones(r.size)
    for target in np.unique(residuals.target):
        own = residuals.target == target
        name = target_ids[int(target)] if target_ids else ""
        every = columns(site.target_models.get(name, site.models))
        models = RangeColumns(*(column[residuals.sensor[own]] for column in every))
        fitted[own] = expected(models, r[own]) - r[own]
        sigma[own] = np.sqrt(variance(models, r[own]))
    return _Points(residuals.sensor, residuals.target, r, residuals.residual_m, fitted, sigma)


def _thinned(points: _Points) -> _Points:
    """Keep at most `POINTS` readings, evenly spread over the run."""
    step = -(-points.sensor.size // POINTS)
    return _Points(
        points.sensor[::step],
        points.target[::step],
        points.distance_m[::step],
        points.left_m[::step],
        points.fitted_m[::step],
        points.sigma_m[::step],
    )
