"""Figures 4, 6-8, 10-12, 17-19 of Oh's paper, and the sweeps, from the reproduction's own runs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.experiments.oh_network import CONTEST, OURS
from trackfield.experiments.oh_pursuit_figures import pursuit_figures
from trackfield.experiments.oh_sweeps import Sweep
from trackfield.metrics.many import followed
from trackfield.plotting.fields import plot_detections
from trackfield.plotting.many import Scenery, plot_many
from trackfield.plotting.style import GREY, PALETTE, new_figure
from trackfield.raster import Region

if TYPE_CHECKING:
    from trackfield.experiments import oh

FIELD = Region(0.0, 0.0, 100.0, 100.0)


def figures(found: oh.Reproduction) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    walk = found.walkers.picture
    tracks = walk.tracks["track-before-detect"]
    truth = walk.world.truth
    readings = walk.readings
    seen = readings.value > 0.0
    sensors = walk.world.deployment.told
    region = walk.world.scenario.area
    walked = Scenery(region, sensors, None, truth, followed(truth, tracks, match_m=6.0))
    return {
        "fig4": _fig4(found),
        **found.scans.figures(),
        "fig10_tracks": _tracks(found),
        "fig10_contest": _contest(found),
        "sweeps": _sweeps(found),
        "fig17_walkers": plot_many(tracks, walked, title="Three walkers, track-before-detect"),
        "fig18_raster": plot_detections(
            readings.t_s[seen], readings.sensor[seen], sensors=len(sensors), title="Detections"
        ),
        **pursuit_figures(found.pursued),
    }


def _fig4(found: oh.Reproduction) -> Figure:
    figure = new_figure(6.4, 4.4)
    axes = figure.add_subplot()
    r = found.fig4.range_m
    axes.plot(r, found.fig4.paper_m, "s", color=GREY, markersize=8, label="paper, read off")
    axes.errorbar(
        r,
        found.fig4.centroid_m,
        2 * found.fig4.centroid_error_m,
        fmt="o-",
        color=PALETTE[0],
        markersize=4,
        label="its rule, here",
    )
    axes.errorbar(
        r,
        found.fig4.fit_m,
        2 * found.fig4.fit_error_m,
        fmt="^-",
        color=PALETTE[1],
        markersize=4,
        label="source fit",
    )
    axes.set(
        xlabel="sensing range [sensor spacings]",
        ylabel="mean error [sensor spacings]",
        yscale="log",
        title="Fig. 4: one target",
    )
    axes.grid(color="0.92")
    axes.legend()
    return figure


def _contest(found: oh.Reproduction) -> Figure:
    """Live GOSPA over time of every tracker, mean over the worlds."""
    figure = new_figure(9.0, 4.6)
    axes = figure.add_subplot()
    for i, tracker in enumerate(CONTEST):
        runs = [run.live for run in found.network[tracker.name]]
        shortest = min(len(run.t_s) for run in runs)
        error = np.mean([run.over_time.gospa_m[:shortest] for run in runs], axis=0)
        style = "--" if tracker.grouped else "-"
        axes.plot(runs[0].t_s[:shortest], error, style, color=PALETTE[i], label=tracker.name)
    runs = [run.lagged for run in found.network[OURS.name] if run.lagged is not None]
    shortest = min(len(run.t_s) for run in runs)
    error = np.mean([run.over_time.gospa_m[:shortest] for run in runs], axis=0)
    axes.plot(runs[0].t_s[:shortest], error, ":", color="black", label="the mixture, 5 steps later")
    axes.set(xlabel="time [s]", ylabel="GOSPA [m]", title="Fig. 10: over a lossy network")
    axes.set_ylim(bottom=0.0)
    axes.grid(color="0.92")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", ncols=3, fontsize=8)
    return figure


def _tracks(found: oh.Reproduction) -> Figure:
    """Draw what arrived of one world's reports, and our live tracks of it."""
    run = found.network[OURS.name][0]
    whose = followed(run.truth, run.tracks)
    scenery = Scenery(FIELD, None, run.heard, run.truth, whose)
    return plot_many(run.tracks, scenery, title="Fig. 10: one world, live tracks of the mixture")


def _sweeps(found: oh.Reproduction) -> Figure:
    figure = new_figure(11.0, 7.2)
    panels = figure.subplots(2, 2, sharey=True).ravel()
    sweeps = found.sweeps
    _sweep(panels[0], sweeps.loss, [100 * p.lost for p in sweeps.loss], label="lost [%]")
    _sweep(panels[1], sweeps.delay, [100 * p.delayed for p in sweeps.delay], label="delayed [%]")
    errors = [p.setting for p in sweeps.misplaced]
    _sweep(panels[2], sweeps.misplaced, errors, label="sensors misplaced [spacings per axis]")
    _sweep(panels[3], sweeps.moves, [p.setting for p in sweeps.moves], label="moves a step")
    panels[3].set_xscale("log")
    for axes in (panels[0], panels[2]):
        axes.set_ylabel("GOSPA live [m]")
    return figure


def _sweep(axes: Axes, sweep: Sweep, at: list[float], *, label: str) -> None:
    for i, name in enumerate(sweep[0].gospa_m):
        values = np.array([point.gospa_m[name] for point in sweep])
        spread = np.abs(values[:, 1:] - values[:, :1]).T
        axes.errorbar(
            at, values[:, 0], spread, fmt="o-", color=PALETTE[i], markersize=4, label=name
        )
    axes.set_xlabel(label)
    axes.set_ylim(bottom=0.0)
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
