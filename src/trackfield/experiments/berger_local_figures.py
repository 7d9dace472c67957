"""Figures 5, 6, 9 and 10 of Berger's paper, and what encoding costs."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trackfield.experiments.berger_local_tables import (
    BITS,
    SNR_DB,
    BergerLocal,
    ExampleProfile,
    LocalErrors,
)
from trackfield.plotting.style import GREY, PALETTE, new_figure
from trackfield.sensing.profile import expected

_MARKS = ("o", "s", "^")
_LABELS = ("a_max", "t_max [s]", "width [s]")


def figures(found: BergerLocal) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    white, fading, fast = (found.errors[name] for name in ("fig6", "fig10", "fig10_10hz"))
    return {
        "fig5": _example(found.examples["fig6"], "Fig. 5: white noise, 1 Hz, 10 dB"),
        "fig6": _errors(white, "Fig. 6: white noise, 1 Hz"),
        "fig9": _example(found.examples["fig10"], "Fig. 9: Rayleigh fading, 2 Hz, 10 dB"),
        "fig10": _errors(fading, "Fig. 10: Rayleigh fading, 2 Hz"),
        "fig10_10hz": _errors(fast, "Rayleigh fading, 10 Hz"),
        "encoding": _encoding(found),
    }


def _example(example: ExampleProfile, title: str) -> Figure:
    figure = new_figure(11.5, 3.6)
    fine = np.linspace(float(example.t_s[0]), float(example.t_s[-1]), 241)
    lines = (
        ("truth", example.truth, GREY, "-"),
        ("coarse", example.coarse, PALETTE[1], ":"),
        ("maximum likelihood", example.fitted, PALETTE[0], "--"),
    )
    for k, axes in enumerate(figure.subplots(1, 3, sharey=True)):
        axes.plot(example.t_s, example.values[k], ".", color="0.3", label="samples")
        for label, profile, colour, style in lines:
            axes.plot(fine, expected(profile, fine)[k], style, color=colour, label=label)
        axes.set(xlabel="time [s]", title=f"sensor {k + 1}")
        axes.grid(color="0.92")
    figure.axes[0].set_ylabel("amplitude")
    figure.axes[0].legend(fontsize=8)
    figure.suptitle(title)
    return figure


def _errors(errors: LocalErrors, title: str) -> Figure:
    figure = new_figure(11.5, 3.8)
    for number, axes in enumerate(figure.subplots(1, 3)):
        for k, mark in enumerate(_MARKS):
            colour, name = PALETTE[k], f"sensor {k + 1}"
            axes.plot(SNR_DB, errors.rmse[:, k, number], mark + "-", color=colour, label=name)
            axes.plot(SNR_DB, errors.bound[:, k, number], "--", color=colour)
            axes.plot(SNR_DB, errors.coarse[:, k, number], mark + ":", color=colour, alpha=0.35)
        axes.set(xlabel="SNR at 1 km [dB]", ylabel=f"RMSE of {_LABELS[number]}", yscale="log")
        axes.grid(color="0.92")
    figure.axes[0].legend(fontsize=8, title="dashed: bound; dotted: coarse", title_fontsize=7)
    figure.suptitle(title)
    return figure


def _encoding(found: BergerLocal) -> Figure:
    figure = new_figure(6.4, 4.2)
    axes = figure.add_subplot()
    cost = found.encoding
    for j, snr in enumerate(cost.snr_db):
        axes.plot(BITS, cost.told[:, j] - 1.0, "-", color=PALETTE[j], label=f"{snr:g} dB")
    axes.axvline(12, color=GREY, ls=":")
    axes.set(xlabel="bits of each number", ylabel="growth of the worst bound", yscale="log")
    axes.set_title("What encoding costs")
    axes.grid(color="0.92")
    axes.legend(fontsize=8)
    return figure
