"""Errors over time of passes, of sensors switched by rules, and with and without silence."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.experiments.cheng_pass import METHODS, Pass
from trackfield.experiments.cheng_switching import RULES, Silent, Switched
from trackfield.plotting.style import GREY, PALETTE, new_figure

if TYPE_CHECKING:
    from trackfield.experiments.cheng_tracking import ChengTracking


def figures(found: ChengTracking) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    return {
        "passes": _passes(found.field, found.table),
        "switching": _switching(found.switched, found.silent),
    }


def _passes(*both: Pass) -> Figure:
    figure = new_figure(11.0, 4.6)
    panels = figure.subplots(1, 2)
    for axes, found in zip(panels, both, strict=True):
        for i, method in enumerate(METHODS):
            axes.plot(found.t_s, found.over_time(method), color=PALETTE[i], label=method)
        axes.plot(found.t_s, found.bound_m, "--", color=GREY, label="posterior Cramer-Rao bound")
        _frame(axes, f"Straight pass, {found.passing.name}")
        axes.set_ylim(0.3 * float(found.bound_m.min()), 2.0 * found.passing.size_m)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _switching(switched: Switched, silent: Silent) -> Figure:
    figure = new_figure(11.0, 4.6)
    left, right = figure.subplots(1, 2)
    for i, rule in enumerate(RULES):
        error = np.sqrt(np.mean(switched.error_m[i] ** 2, axis=0))
        left.plot(switched.t_s, error, color=PALETTE[i], label=rule)
    _frame(left, "Four of twelve sensors")
    for k, name in enumerate(("silence ignored", "silence believed")):
        squares = silent.error_m[k] ** 2
        some = np.isfinite(squares).any(axis=0)
        error = np.sqrt(np.nanmean(squares[:, some], axis=0))
        right.plot(silent.t_s[some], error, color=PALETTE[k], label=name)
    _frame(right, "Sensors with a threshold")
    for axes in (left, right):
        axes.legend(fontsize=8)
    return figure


def _frame(axes: Axes, title: str) -> None:
    axes.set(xlabel="time [s]", ylabel="RMSE [m]", yscale="log", title=title)
    axes.grid(color="0.92")
