"""Figs. 3.5 to 3.8 of Pham's dissertation, and the contest of rules, from the experiment's runs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.experiments import pham_selection
from trackfield.plotting.style import GREY, PALETTE, new_figure

if TYPE_CHECKING:
    from trackfield.experiments.pham_selection import PhamSelection

_SHOWN = (  # ways of Figs. 3.7 and 3.8
    "Function-3D, trilateration",
    "best four for the filter, ranges",
    "all in reach, ranges",
)
_MARKS = ("s", "o", "D", "^")


def figures(found: PhamSelection) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    return {
        "fig3_5": _fig35(found),
        "selection_rules": _rules(found),
        "fig3_6": _fig36(found),
        "fig3_7": _over_time(found),
        "fig3_8": _power(found),
    }


def _fig35(found: PhamSelection) -> Figure:
    figure = new_figure(6.4, 6.0)
    axes = figure.add_subplot()
    axes.plot(*found.nodes.T, "^", color=GREY, label="nodes")
    for number, (x, y) in enumerate(found.nodes, 1):
        axes.annotate(f"#{number}", (x, y), (4, 4), textcoords="offset points", fontsize=8)
    for k, (name, target) in enumerate(zip("AB", pham_selection.TARGETS, strict=True)):
        colour = PALETTE[k]
        angles = np.linspace(0.0, 2.0 * np.pi, 200)
        reach = target + pham_selection.REACH_M * np.column_stack([np.cos(angles), np.sin(angles)])
        axes.plot(*reach.T, ":", color=colour, linewidth=0.8)
        axes.plot(*target, "*", color=colour, markersize=14, label=f"target at {name}")
        for rule, style in (("best three", "-"), ("as printed", "--")):
            for node in found.nodes[found.chosen[rule][k]]:
                axes.plot(*np.stack([target, node]).T, style, color=colour, linewidth=1.2)
    axes.set(xlabel="x", ylabel="y", aspect="equal", title="Fig. 3.5: best three (dashed: printed)")
    axes.legend(fontsize=8)
    return figure


def _rules(found: PhamSelection) -> Figure:
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    rules = pham_selection.RULES[:-1]
    for k, rule in enumerate(rules):
        axes.plot(
            pham_selection.COUNTS,
            found.ratios.mean[:, k],
            "--" if k == len(rules) - 1 else "-",
            marker=_MARKS[k],
            color=PALETTE[k],
            label=f"Function-2D, {rule}" if k < len(rules) - 1 else rule,
        )
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.set(
        xlabel="sensors to choose from",
        ylabel="trace over the best",
        title=f"Three sensors, {found.ratios.fields} random fields",
    )
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure


def _fig36(found: PhamSelection) -> Figure:
    figure = new_figure(6.8, 5.4)
    axes = cast("Any", figure.add_subplot(projection="3d"))  # has a third axis, which has no types
    axes.scatter(*found.flight.nodes.T, s=4, color=GREY, label="nodes")
    axes.plot(*found.flight.position.T, color="black", label="target")
    axes.plot(*found.tracked[_SHOWN[1]].path.T, color=PALETTE[1], linewidth=0.8, label=_SHOWN[1])
    axes.set(xlabel="x", ylabel="y", zlabel="z", title="Fig. 3.6: the way above the surface")
    axes.legend(fontsize=8)
    return figure


def _over_time(found: PhamSelection) -> Figure:
    figure = new_figure(7.2, 4.4)
    axes = figure.add_subplot()
    _curves(axes, found, [np.sqrt(found.tracked[name].squared) for name in _SHOWN])
    axes.set(ylabel="RMSE [m]", yscale="log", title="Fig. 3.7: error of the filter")
    return figure


def _power(found: PhamSelection) -> Figure:
    figure = new_figure(7.2, 4.4)
    axes = figure.add_subplot()
    powers = [found.tracked[name].power_mw / 1e3 for name in _SHOWN[1:]]
    _curves(axes, found, [powers[0], *powers], first=1)
    axes.set(ylabel="power of the network [W]", title="Fig. 3.8: four nodes, and all in reach")
    return figure


def _curves(axes: Axes, found: PhamSelection, values: list[Any], *, first: int = 0) -> None:
    for k in range(first, len(_SHOWN)):
        axes.plot(found.flight.t_s, values[k], color=PALETTE[k], label=_SHOWN[k])
    axes.set(xlabel="time [s]")
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
