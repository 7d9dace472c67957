"""Figures 7, 8, 11 and 12 of Berger's paper: errors of the fusion center, and lost runs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.experiments.berger_fusion_tables import (
    COUNTS,
    METHODS,
    OURS,
    PAPER,
    PARTS,
    QUANTITIES,
    RAW,
    RAW_PAPER,
    BergerFusion,
)
from trackfield.plotting.style import GREY, PALETTE, new_figure
from trackfield.types import Matrix

_UNITS = ("P [at 1 km]", "x0 [km]", "v [km/s]")


def figures(found: BergerFusion) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    return {
        "fig7": _three(found),
        "fig8": _counts(found, "white"),
        "fig11": _fading(found, "fading"),
        "fig12": _fading(found, "fading_10hz"),
    }


def _three(found: BergerFusion) -> Figure:
    """Fig. 7: RMSE of three sensors, with and without the lost runs."""
    figure = new_figure(12.0, 4.2)
    errors, part = found.errors["white"], PARTS["white"]
    ways = ((PAPER, PALETTE[1], "s"), (OURS, PALETTE[0], "o"), (RAW_PAPER, PALETTE[2], "^"))
    for q, axes in enumerate(figure.subplots(1, 3)):
        for method, colour, mark in ways:
            every = (errors.ratio(method, q, all_runs=True) * errors.bound[..., q])[0]
            rest = (errors.ratio(method, q) * errors.bound[..., q])[0]
            axes.plot(part.snr_db, every, mark + "-", color=colour, label=METHODS[method])
            axes.plot(part.snr_db, rest, mark + ":", color=colour, markersize=4)
        axes.plot(part.snr_db, errors.bound[0, :, q], "--", color=GREY, label="bound")
        _decorate(axes, f"RMSE of {_UNITS[q]}")
    figure.axes[0].legend(fontsize=8, title="dotted: without lost runs", title_fontsize=7)
    figure.suptitle("Fig. 7: three sensors, white noise")
    return figure


def _counts(found: BergerFusion, name: str) -> Figure:
    """Fig. 8: runs that are not lost, and RMSE, by number of sensors."""
    figure = new_figure(12.0, 8.0)
    errors, part = found.errors[name], PARTS[name]
    first, *panels = figure.subplots(2, 2).ravel()
    _kept(first, found, name)
    for q, axes in enumerate(panels):
        for c, count in enumerate(COUNTS):
            for method, style in ((OURS, "o-"), (PAPER, "s:")):
                rmse = (errors.ratio(method, q, all_runs=True) * errors.bound[..., q])[c]
                label = f"{count} sensors" if method == OURS else None
                axes.plot(part.snr_db, rmse, style, color=PALETTE[c], markersize=4, label=label)
            axes.plot(part.snr_db, errors.bound[c, :, q], "--", color=PALETTE[c], alpha=0.5)
        _decorate(axes, f"RMSE of {QUANTITIES[q]}")
    panels[0].legend(fontsize=8, title="solid: ours, dotted: paper, dashed: bound")
    figure.suptitle("Fig. 8: numbers of sensors, white noise")
    return figure


def _fading(found: BergerFusion, name: str) -> Figure:
    """Figs. 11, 12: RMSE of x0 by messages and by all samples, and runs that are not lost."""
    figure = new_figure(11.5, 4.4)
    errors, part = found.errors[name], PARTS[name]
    left, right = figure.subplots(1, 2)
    for c, count in enumerate(COUNTS):
        for method, style in ((OURS, "o-"), (RAW, "-"), (PAPER, "s:")):
            rmse = (errors.ratio(method, 1, all_runs=True) * errors.bound[..., 1])[c]
            label = f"{count} sensors" if method == OURS else None
            width = 0.7 if method == RAW else 1.5
            left.plot(part.snr_db, rmse, style, color=PALETTE[c], lw=width, ms=4, label=label)
        left.plot(part.snr_db, errors.bound[c, :, 1], "--", color=PALETTE[c], alpha=0.5)
    _decorate(left, "RMSE of x0 [km]")
    figure.legend(
        *left.get_legend_handles_labels(),
        loc="outside lower left",
        ncols=5,
        fontsize=8,
        title="solid: ours, thin: all samples, dotted: paper, dashed: bound",
        title_fontsize=8,
    )
    _kept(right, found, name)
    figure.suptitle(part.title)
    return figure


def _kept(axes: Axes, found: BergerFusion, name: str) -> None:
    """Share of runs that are not lost."""
    errors, part = found.errors[name], PARTS[name]
    for method, style in ((OURS, "o-"), (PAPER, "s:")):
        kept: Matrix = 1.0 - errors.lost(method)
        for c, count in enumerate(COUNTS):
            label = f"{count}" if method == OURS else None
            axes.plot(part.snr_db, kept[c], style, color=PALETTE[c], ms=4, label=label)
    axes.set(xlabel="SNR at 1 km [dB]", ylabel="runs not lost", ylim=(0.0, 1.03))
    axes.grid(color="0.92")


def _decorate(axes: Axes, label: str) -> None:
    axes.set(xlabel="SNR at 1 km [dB]", ylabel=label, yscale="log")
    axes.grid(color="0.92")
