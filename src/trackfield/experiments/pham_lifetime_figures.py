"""Figs. 5.2-5.5 of Pham's dissertation, and lifetimes by policy."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from trackfield.experiments.pham_start import ALONE, OURS, PAPER_SETTLE_S, SURE
from trackfield.plotting.style import GREY, PALETTE, frame_map, new_figure

if TYPE_CHECKING:
    from trackfield.experiments.pham_lifetime import LifetimeResult


def figures(found: LifetimeResult) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    return {
        "fig5_2": _fig52(found),
        "fig5_3": _fig53(found),
        "fig5_4": _fig54(found),
        "fig5_5": _fig55(found),
        "lifetimes": _lifetimes(found),
    }


def _fig52(found: LifetimeResult) -> Figure:
    figure = new_figure(5.6, 5.4)
    axes = figure.add_subplot()
    axes.plot(*found.sensors.T, ".", color=GREY, markersize=3)
    axes.plot(*found.elimination.path.T, color=PALETTE[0])
    frame_map(axes, "Fig. 5.2: target and 441 nodes")
    return figure


def _fig53(found: LifetimeResult) -> Figure:
    c = found.choice
    figure = new_figure(5.6, 5.4)
    axes = figure.add_subplot()
    axes.add_patch(Circle((float(c.target[0]), float(c.target[1])), 2.0, fill=False, color=GREY))
    axes.scatter(*c.nodes.T, s=6.0 * c.residual, color=PALETTE[0], alpha=0.5, label="energy left")
    axes.plot(*c.nodes[c.kept].T, "s", color="k", markersize=9, fillstyle="none", label="kept")
    axes.plot(*c.nodes[c.bounded.chosen].T, "o", color=PALETTE[1], label="within 3 sigma^2")
    axes.plot(*c.nodes[c.cheapest.chosen].T, "x", color=PALETTE[2], markersize=10, label="cheapest")
    axes.plot(*c.target[:, None], "*", color="k", markersize=12)
    axes.legend(fontsize=8)
    frame_map(axes, "Fig. 5.3: who senses")
    return figure


def _fig54(found: LifetimeResult) -> Figure:
    s = found.started
    figure = new_figure(10.0, 4.2)
    whole, begin = figure.subplots(1, 2)
    lines = (
        (s.sharpest.errors[ALONE], PALETTE[2], ":", "trilateration alone"),
        (s.cheapest.errors[SURE], PALETTE[1], "--", "Pham's filter, least cost"),
        (s.sharpest.errors[SURE], "black", "-", "Pham's filter, least trace"),
        (s.sharpest.errors[OURS], PALETTE[0], "-.", "ours, least trace"),
    )
    for errors, colour, style, name in lines:
        whole.plot(s.t_s, s.x + errors[0], style, color=colour, linewidth=1.2, label=name)
        rms = np.sqrt(np.mean(errors**2, axis=0))
        begin.plot(s.t_s, rms, style, color=colour, linewidth=1.2)
    begin.axvline(PAPER_SETTLE_S, color=GREY, linewidth=1)
    begin.annotate("paper", (PAPER_SETTLE_S, 1.0), textcoords="offset points", xytext=(4, 0))
    whole.set(xlabel="t [s]", ylabel="x [m]", title="Fig. 5.4: one run", ylim=(-1.0, 11.0))
    whole.legend(fontsize=8)
    begin.set(xlabel="t [s]", ylabel="RMS error along x [m]", yscale="log", xlim=(0.0, 1.0))
    begin.set(title=f"the first second, {len(lines[0][0])} runs", ylim=(0.005, 5.0))
    for axes in (whole, begin):
        axes.grid(color="0.92")
    return figure


def _fig55(found: LifetimeResult) -> Figure:
    e = found.elimination
    figure = new_figure(6.4, 3.8)
    axes = figure.add_subplot()
    t = np.linspace(0.0, 10.0, e.before.size)
    axes.plot(t, e.before, color=PALETTE[0], label="in reach")
    axes.plot(t, e.after, "--", color=PALETTE[1], label="without collinear ones")
    axes.set(xlabel="t [s]", ylabel="nodes", title="Fig. 5.5: collinear elimination")
    axes.set_ylim(bottom=0.0)
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure


def _lifetimes(found: LifetimeResult) -> Figure:
    lives = found.lives
    figure = new_figure(6.4, 3.8)
    axes = figure.add_subplot()
    names = list(lives.death)
    axes.barh(names, [float(lives.death[name].mean()) for name in names], color=PALETTE[0])
    axes.axvline(float(lives.death_bound.mean()), color=PALETTE[1], label="nobody beyond")
    axes.set(xlabel="first node death [intervals]")
    axes.invert_yaxis()
    axes.legend(fontsize=8)
    return figure
