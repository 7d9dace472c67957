"""Fig. 3.4 of Pham's dissertation, the choice of a third sensor, and a map of the six nodes."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.network.site import Site
from trackfield.plotting.plans import draw_map
from trackfield.plotting.style import GREY, PALETTE, new_figure
from trackfield.raster import Region
from trackfield.scheduling.accuracy import accuracy_map
from trackfield.scheduling.uncertainty import best_third, printed_trace, three_sensor_trace
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix

if TYPE_CHECKING:
    from trackfield.experiments.pham_uncertainty import PhamUncertainty

_STYLES = ("-", "--", ":")  # of OLS, BLUE and the bound
_FIELD = Region(-0.5, -0.5, 3.0, 3.0)
_CELL_M = 0.05
_THIRD_DEG = 30.0  # between the two first sensors


def figures(found: PhamUncertainty, nodes: Matrix) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix; `nodes` (6, 2) are those of Table 3.1."""
    return {
        "fig3_4": _fig34(found, nodes),
        "fig3_4_map": _map(nodes),
        "third_sensor": _third(),
    }


def _fig34(found: PhamUncertainty, nodes: Matrix) -> Figure:
    figure = new_figure(12.0, 3.8)
    field, usual, line = figure.subplots(1, 3)
    field.plot(*nodes.T, "^", color=PALETTE[0], label="nodes")
    for number, (x, y) in enumerate(nodes, 1):
        field.annotate(f"#{number}", (x, y), (4, 4), textcoords="offset points", fontsize=8)
    field.plot(found.x, np.full(found.x.size, found.y), color=GREY, label="path, ours")
    field.set(xlabel="x", ylabel="y", title="(a) nodes and path", aspect="equal")
    field.legend(fontsize=8)
    three, six, five = found.traces
    _draw_traces(usual, found, (three, six))
    usual.set(title="(b) three nodes and all six", ylim=(0.0, 3.5))
    _draw_traces(line, found, (three, five))
    line.set(title="(c) five nodes nearly on a line", yscale="log")
    return figure


def _draw_traces(axes: Axes, found: PhamUncertainty, names: tuple[str, str]) -> None:
    for name, colour in zip(names, PALETTE, strict=False):
        for k, (method, style) in enumerate(zip(("OLS", "BLUE", "bound"), _STYLES, strict=True)):
            label = f"{name}, {method}"
            axes.plot(found.x, found.traces[name][:, k], style, color=colour, label=label)
    axes.set(xlabel="x of the target", ylabel="trace / sigma$^2$")
    axes.grid(color="0.92")
    axes.legend(fontsize=7)


def _map(nodes: Matrix) -> Figure:
    """Map the bound of the five nodes on a line beside that of all six."""
    figure = new_figure(11.5, 5.2)
    for axes, (title, chosen) in zip(
        figure.subplots(1, 2),
        (("#1, 2, 4-6, nearly on a line", [0, 1, 3, 4, 5]), ("all six", list(range(6)))),
        strict=True,
    ):
        some = nodes[chosen]
        names = tuple(f"#{i + 1}" for i in chosen)
        places = np.column_stack([some, np.full(len(some), np.nan)])
        site = Site("Table 3.1", names, places, (RangeModel(sigma_m=0.1),) * len(some))
        mapped = accuracy_map(site, _FIELD, cell_m=_CELL_M)
        draw_map(axes, mapped, some, names=names, title=f"{title}: the bound, sigma 0.1")
    return figure


def _third() -> Figure:
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    alpha, beta = np.radians(_THIRD_DEG), np.radians(np.linspace(0.0, 180.0, 361))
    degrees = np.degrees(beta)
    axes.plot(degrees, three_sensor_trace(alpha, beta), color=PALETTE[0], label="corrected")
    printed = printed_trace(alpha, beta)
    axes.plot(degrees, printed, "--", color=PALETTE[1], label="(3.10) as printed")
    axes.axhline(2.0 / np.sin(alpha) ** 2, color=GREY, ls=":", label="the first two alone")
    best = best_third(alpha)
    axes.plot(np.degrees(best.beta), best.trace, "o", color=PALETTE[0], label="best third sensor")
    axes.plot(_THIRD_DEG / 2.0, three_sensor_trace(alpha, alpha / 2.0), "s", color=PALETTE[1],
              label="what (3.11) picks")  # fmt: skip
    axes.set(xlabel="beta, direction of the third sensor [deg]", ylabel="trace / sigma$^2$")
    axes.set_title(f"Two sensors {_THIRD_DEG:g} degrees apart, and a third")
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure
