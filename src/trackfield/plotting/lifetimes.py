"""How a network ages: what was served, who lives, and what is left of the batteries."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trackfield.plotting.style import GREY, PALETTE, new_figure
from trackfield.types import Matrix


def plot_lifetime(history: Matrix, *, intervals: int, title: str = "") -> Figure:
    """Draw `history` (passes, 4): intervals served of `intervals`, nodes alive, sensings left.

    The last two columns are the least and the mean of what is left, as `lifetime.Lifetime` has it.
    """
    served, alive, least, mean = history.T
    passes = np.arange(1, len(history) + 1)
    figure = new_figure(9.0, 6.0)
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(passes, 100.0 * served / intervals, ".", ms=3, color=GREY, label="intervals served")
    above.plot(passes, 100.0 * alive / max(alive.max(), 1.0), color=PALETTE[0], label="nodes alive")
    above.set(ylabel="[%]", ylim=(0.0, 105.0), title=title)
    above.legend(loc="lower left", fontsize=8)
    below.plot(passes, mean, color=PALETTE[2], label="mean")
    below.plot(passes, least, "--", color=PALETTE[1], label="least")
    below.set(xlabel="pass", ylabel="sensings left of a node")
    below.set_ylim(bottom=0.0)
    below.legend(loc="upper right", fontsize=8)
    for axes in (above, below):
        axes.grid(color="0.92")
    return figure
