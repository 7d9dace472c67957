"""How well calibrated models fit the readings that they were learned from."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.calibration.ranges import Calibration
from trackfield.network.site import range_models
from trackfield.plotting.style import PALETTE, new_figure
from trackfield.sensing.range import RangeColumns, columns, expected, variance
from trackfield.types import Indices, Vector

POINTS = 4000  # drawn of a cloud, at most


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


def plot_calibration(calibration: Calibration, *, target_ids: Sequence[str], title: str) -> Figure:
    """Draw how well calibrated models fit: errors before and after, normality, spread a sensor.

    `target_ids` are those of the readings that were calibrated on.
    """
    sensor_ids = calibration.site.sensor_ids
    points = _points(calibration, target_ids)
    figure = new_figure(12.0, 8.0)
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


def _points(calibration: Calibration, target_ids: Sequence[str]) -> _Points:
    site, residuals = calibration.site, calibration.residuals
    r = residuals.distance_m
    fitted, sigma = np.zeros(r.size), np.ones(r.size)
    for target in np.unique(residuals.target):
        own = residuals.target == target
        name = target_ids[int(target)] if target_ids else ""
        every = columns(range_models(site, name))
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
