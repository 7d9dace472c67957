"""The soft bound in two panels: energy against error by B and q/s, and how long nodes last."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.plotting.style import GREY, PALETTE, new_figure

if TYPE_CHECKING:
    from trackfield.experiments.pham_soft import Soft

_MARKS = ("o", "s", "^", "D")


def figures(found: Soft) -> dict[str, Figure]:
    """Draw the figure, by file name without its suffix."""
    figure = new_figure(10.0, 4.4)
    left, right = figure.subplots(1, 2)
    _trade(left, found)
    _lives(right, found)
    return {"soft_bound": figure}


def _trade(axes: Axes, found: Soft) -> None:
    agilities = sorted({p.agility for p in found.grid})
    for i, agility in enumerate(agilities):
        points = [p for p in found.grid if p.agility == agility]
        axes.plot(
            [p.soft.rmse for p in points],
            [p.soft.asked for p in points],
            marker=_MARKS[i % len(_MARKS)],
            color=PALETTE[i],
            label=f"q/s {agility:g}",
        )
        hard = points[0].hard
        axes.plot(hard.rmse, hard.asked, marker=_MARKS[i % len(_MARKS)], color=GREY)
    axes.set(
        xlabel="RMSE [sigma]",
        ylabel="sensors asked an interval",
        title="B 1, 2, 3, 5 along each line; grey: three of a snapshot",
    )
    axes.set_ylim(bottom=0.0)
    axes.grid(color="0.92")
    axes.legend()


def _lives(axes: Axes, found: Soft) -> None:
    known = [(bound, life) for bound, life in found.lives_by_bound if life > 0]
    if not known:
        said = "no node was empty at the end of so short a run"
        axes.text(0.5, 0.5, said, ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    bounds, lives = ([row[i] for row in known] for i in (0, 1))
    axes.plot(bounds, lives, "o-", color=PALETTE[0], label="soft")
    wandering = found.lives["wandering"]
    for values, name, style in (
        (wandering.hard, "hard, same weights", "--"),
        (wandering.geometry, "hard, geometry alone", ":"),
    ):
        axes.axhline(float(values[-1]), color=GREY, linestyle=style, label=name)
    axes.set(
        xlabel="B [sigma^2]",
        ylabel="intervals until the first node is empty",
        title="Wandering targets, one field, q/s .6",
    )
    axes.set_ylim(bottom=0.0)
    axes.grid(color="0.92")
    axes.legend()
