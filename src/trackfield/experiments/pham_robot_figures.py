"""Figs. 4.7-4.9 of Pham's dissertation, from closed-loop runs, and ways over the optimum."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from trackfield.experiments.pham_robot_loop import ERROR_M, Loop, Setting
from trackfield.experiments.pham_robot_paths import SENSING_M
from trackfield.plotting.robots import Chase, draw_chase
from trackfield.plotting.style import GREY, PALETTE, new_figure
from trackfield.robot.optimum import shortest_tour

if TYPE_CHECKING:
    from trackfield.experiments.pham_robot import PhamRobot


def figures(found: PhamRobot) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    by_setting = {one.setting: one for one in found.loops}
    return {
        "fig4_7": _fig47(
            by_setting[Setting(2.5, ahead=False)], by_setting[Setting(2.5, ahead=True)]
        ),
        "fig4_8": _fig48(by_setting),
        "fig4_9": _fig49(by_setting[Setting(2.5, ahead=True)]),
        "robot_ways": _ways(found),
    }


def _fig47(rule: Loop, ahead: Loop) -> Figure:
    """Draw the rule, looking ahead and the shortest way at a communication range of 2.5."""
    reach = 2.5 - SENSING_M - ERROR_M
    best = shortest_tour(rule.target[0], rule.target, radius_m=reach).path
    figure = new_figure(7.4, 6.6)
    others = {"rule (4.11)": rule.robot, "shortest there is": best}
    chase = Chase(rule.target, ahead.robot, reach, others, rule.nodes)
    draw_chase(figure.add_subplot(), chase, title="Fig. 4.7: communication range 2.5")
    return figure


def _fig48(loops: dict[Setting, Loop]) -> Figure:
    """Draw the rule and looking ahead side by side, at ranges of 2 and 4."""
    figure = new_figure(12.0, 4.2)
    for axes, comm in zip(figure.subplots(1, 2), (2.0, 4.0), strict=True):
        rule, ahead = loops[Setting(comm, ahead=False)], loops[Setting(comm, ahead=True)]
        chase = Chase(rule.target, ahead.robot, None, {"rule (4.11)": rule.robot})
        draw_chase(axes, chase, title=f"Fig. 4.8: communication range {comm:g}")
    return figure


def _fig49(loop: Loop) -> Figure:
    """Draw one coordinate over time: true, filtered, and from three ranges alone."""
    figure = new_figure(8.0, 4.2)
    axes = figure.add_subplot()
    step = np.arange(len(loop.target))
    rough = np.clip(loop.trilaterated[:, 1], *_shown(loop))
    axes.plot(step, rough, "-", color=PALETTE[2], linewidth=0.9, label="three ranges alone")
    axes.plot(step, loop.filtered[:, 1], "--", color=PALETTE[1], label="filtered")
    axes.plot(step, loop.target[:, 1], color="black", linewidth=1.2, label="true")
    axes.set(xlabel="step", ylabel="y [m]", title="Fig. 4.9: true and estimated")
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure


def _shown(loop: Loop) -> tuple[float, float]:
    """Y [m] between which estimates are shown: those of the target and 2 m more."""
    y = loop.target[:, 1]
    return float(y.min()) - 2.0, float(y.max()) + 2.0


def _ways(found: PhamRobot) -> Figure:
    """Draw mean ways over the shortest by range, a panel a noise."""
    noises = sorted({one.noise_m for one in found.ratios})
    figure = new_figure(11.0, 3.8)
    for axes, noise in zip(figure.subplots(1, len(noises), sharey=True), noises, strict=True):
        rows = [one for one in found.ratios if one.noise_m == noise]
        ranges = [one.range_m for one in rows]
        rule, ahead = [one.rule.mean() for one in rows], [one.ahead.mean() for one in rows]
        axes.plot(ranges, rule, "s--", color=GREY, label="rule (4.11)")
        axes.plot(ranges, ahead, "o-", color=PALETTE[0], label="looking ahead")
        axes.axhline(1.0, color="0.6", linewidth=0.8)
        axes.set(xlabel="communication range", title=f"noise {noise:g} m")
        axes.grid(color="0.92")
    figure.axes[0].set_ylabel("way over the shortest")
    figure.axes[0].legend(fontsize=8)
    return figure
