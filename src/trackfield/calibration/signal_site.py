"""Signal sensors of a site learned from a run: tables to steps, and the models into the site."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfield.calibration.signals import SignalCalibration, SignalRun, calibrate_signals
from trackfield.calibration.truth_paths import paths_at
from trackfield.errors import InputError
from trackfield.network.site import Site
from trackfield.sensing.signal import SignalModel
from trackfield.types import Readings, Truth

KIND = "signal"
_MOST = 50_000_000  # steps times sensors


class CalibratedSignals(NamedTuple):
    """A site with learned models of its signal sensors, and what the run told.

    Rows of `calibration` are those of the site's sensors that `sensor_ids` names, in this order.
    """

    site: Site
    sensor_ids: tuple[str, ...]
    calibration: SignalCalibration


def calibrate_signal_site(site: Site, readings: Readings, truth: Truth) -> CalibratedSignals:
    """Learn the signal models of `site` from a run with truth, see `calibrate_signals`.

    The first signal sensor's model is the start. Sensors of other kinds stay as they are.
    `InputError` where nothing can be learned.
    """
    places = _places(site)
    run = signal_run(site, readings, truth)
    start = next(model for model in site.models if isinstance(model, SignalModel))
    found = calibrate_signals(run, start)
    learned = list(site.models)
    for place, model in zip(places, found.models, strict=True):
        learned[place] = model
    ids = tuple(site.sensor_ids[place] for place in places)
    return CalibratedSignals(replace(site, models=tuple(learned)), ids, found)


def signal_run(site: Site, readings: Readings, truth: Truth) -> SignalRun:
    """Sort the site's signals by time, beside the truth at those times; unknown times are left out.

    Of two readings of a sensor at one time the last counts.
    """
    places = _places(site)
    told = np.array([kind == KIND for kind in readings.kinds], bool)
    rows = np.flatnonzero(told[readings.kind]) if told.size else np.empty(0, np.intp)
    if not rows.size:
        raise InputError("found no reading of kind 'signal'")
    column = {site.sensor_ids[place]: i for i, place in enumerate(places)}
    columns = np.array([column.get(name, -1) for name in readings.sensor_ids], int)
    sensor = columns[readings.sensor[rows]]
    if (sensor < 0).any():
        name = readings.sensor_ids[int(readings.sensor[rows][sensor < 0][0])]
        raise InputError(f"found a signal of {name!r}, which is no signal sensor of the site")
    times, step = np.unique(readings.t_s[rows], return_inverse=True)
    if times.size * len(places) > _MOST:
        raise InputError(
            f"found {times.size} times of {len(places)} sensors, expected {_MOST} in all at most"
        )
    values = np.full((times.size, len(places)), np.nan)
    values[step.reshape(-1), sensor] = readings.value[rows]
    paths = paths_at(truth.t_s, truth.target, position=truth.position[:, :2], t_s=times)
    return SignalRun(
        values=values[paths.known],
        sensors=site.positions[places, :2],
        targets=paths.position[paths.known],
    )


def _places(site: Site) -> list[int]:
    places = [i for i, model in enumerate(site.models) if isinstance(model, SignalModel)]
    if not places:
        raise InputError(f"site {site.name}: found no sensor of kind 'signal'")
    return places
