"""Pham, Figs. 2.4-2.11, from the reproduction's own runs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from trackfield.experiments.pham_sweeps import Sweep, Traces
from trackfield.experiments.pham_table21 import PRINTED, SCATTERED
from trackfield.plotting.style import GREY, PALETTE, frame_map, new_figure
from trackfield.types import Matrix, Vector

if TYPE_CHECKING:
    from trackfield.experiments.pham_tracking import PhamTracking


def figures(found: PhamTracking) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    t_s = found.way.t_s
    uniform = np.array([row.cycle_mw for row in found.rows])
    return {
        "fig2_4": _field(found),
        "fig2_5": _power(t_s, uniform, [p.measured for p in PRINTED], "Fig. 2.5: square grid"),
        "fig2_6": _sweep(found.speeds, "mean speed [m/s]", "Fig. 2.6: ranges with sigma .2 m"),
        "fig2_7": _sweep(found.noises, "sigma of a range [m]", "Fig. 2.7: mean speed 3 m/s"),
        "fig2_8": _pair(found.noisy, ("sigma .5 m", "sigma .04 m"), "Fig. 2.8"),
        "fig2_9": _pair((found.alone,), ("masters told nothing",), "Fig. 2.9"),
        "fig2_10": _pair((found.smooth,), ("4.5 nodes measure",), "Fig. 2.10"),
        "fig2_11": _power(t_s, found.scattered.cycle_mw, SCATTERED, "Fig. 2.11: nodes anywhere"),
    }


def _field(found: PhamTracking) -> Figure:
    figure = new_figure(5.6, 5.2)
    axes = figure.add_subplot()
    axes.plot(*found.nodes.T, ".", color=GREY, markersize=3, label="nodes")
    axes.plot(*found.way.position.T, color=PALETTE[1], linewidth=2, label="target")
    axes.plot(*found.way.position[::200].T, "o", color=PALETTE[1], label="every second")
    frame_map(axes, "Fig. 2.4: the field and the passage")
    axes.legend(loc="upper right", fontsize=8)
    return figure


def _power(t_s: Vector, cycle_mw: Matrix, counts: object, title: str) -> Figure:
    figure = new_figure(6.4, 4.4)
    axes = figure.add_subplot()
    for i, (power, count) in enumerate(zip(cycle_mw, np.asarray(counts), strict=True)):
        axes.plot(t_s, 1e-3 * power, color=PALETTE[i], label=f"{count:g} measure on average")
    axes.set(xlabel="time [s]", ylabel="power of a cycle [W]", title=title)
    axes.set_ylim(bottom=0.0)
    axes.grid(color="0.92")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=3, fontsize=8)
    return figure


def _sweep(found: Sweep, label: str, title: str) -> Figure:
    figure = new_figure(6.4, 4.4)
    axes = figure.add_subplot()
    lines = (found.plain_m, found.kalman_m, found.ranges_m)
    names = ("trilateration", "Pham's filter", "ours, on ranges")
    for i, (values, name, mark) in enumerate(zip(lines, names, "s^o", strict=True)):
        axes.plot(found.setting, values, f"{mark}-", color=PALETTE[i], label=name)
    axes.set(xlabel=label, ylabel="deviation of the error along x [m]", yscale="log", title=title)
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure


def _pair(runs: tuple[Traces, ...], names: tuple[str, ...], title: str) -> Figure:
    """Positions over time, and the errors of the same runs below."""
    figure = new_figure(5.4 * len(runs) + 1.0, 5.6)
    panels = figure.subplots(2, len(runs), sharex="col", squeeze=False)
    for column, (run, name) in enumerate(zip(runs, names, strict=True)):
        above, below = panels[:, column]
        t_s, x = run.way.t_s, run.way.position[:, 0]
        above.plot(t_s, run.plain, ".", color="0.75", markersize=2, label="trilateration")
        above.plot(t_s, run.kalman, color=PALETTE[0], label="Pham's filter")
        above.plot(t_s, x, "--", color="black", linewidth=1, label="truth")
        above.set(ylabel="x [m]", title=f"{title}: {name}", ylim=(-2.0, 12.0))
        above.legend(fontsize=8)
        below.plot(t_s, run.kalman - x, color=PALETTE[0])
        below.plot(t_s[run.begins], (run.kalman - x)[run.begins], "v", color=PALETTE[1])
        below.set(xlabel="time [s]", ylabel="error of the filter [m]")
        for axes in (above, below):
            axes.grid(color="0.92")
    return figure
