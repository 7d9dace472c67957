"""How well learned models of signal strength foretell places that they did not see."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trackfield.calibration.rssi_site import CalibratedRssi
from trackfield.plotting.style import PALETTE, new_figure

_BINS = 40
_NAMED = 12  # receivers that a legend has room for


def plot_rssi_calibration(calibration: CalibratedRssi, *, title: str) -> Figure:
    """Draw errors of places left out: over the distance, and with and without the shadow's map."""
    figure = new_figure(12.0, 5.0)
    over, spread = figure.subplots(1, 2)
    _draw_cloud(over, calibration)
    _draw_histograms(spread, calibration)
    figure.suptitle(title)
    return figure


def _draw_cloud(axes: Axes, calibration: CalibratedRssi) -> None:
    for sensor in np.unique(calibration.sensor):
        own = calibration.sensor == sensor
        axes.plot(
            calibration.distance_m[own],
            calibration.off[own],
            ".",
            color=PALETTE[int(sensor) % len(PALETTE)],
            markersize=4,
            alpha=0.6,
            label=calibration.site.sensor_ids[int(sensor)],
        )
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_xscale("log")
    axes.set(xlabel="distance [m]", ylabel="error [dB]", title="Left out, by law and map")
    axes.grid(color="0.92")
    if len(calibration.site.sensor_ids) <= _NAMED:
        axes.legend(fontsize=8, ncols=2)


def _draw_histograms(axes: Axes, calibration: CalibratedRssi) -> None:
    both = np.concatenate([calibration.off, calibration.off_law])
    edges = np.linspace(float(both.min()) - 0.5, float(both.max()) + 0.5, _BINS).tolist()
    for values, rms, name, colour in (
        (calibration.off_law, calibration.law_error_db, "law alone", PALETTE[1]),
        (calibration.off, calibration.map_error_db, "law and map", PALETTE[0]),
    ):
        label = f"{name}, rms {rms:.2f} dB"
        axes.hist(values, edges, histtype="step", linewidth=1.8, color=colour, label=label)
    axes.set(xlabel="error [dB]", ylabel="places", title="What the map of the shadow buys")
    axes.grid(color="0.92")
    axes.legend(fontsize=9)
