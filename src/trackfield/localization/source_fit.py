"""Positions of unknown sources from the signal strengths of one scan: maximum likelihood."""

from __future__ import annotations

from dataclasses import asdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _sources
from trackfield.errors import InputError
from trackfield.localization.source_settings import SourceSettings, settings_for
from trackfield.sensing.signal import SignalColumns, SignalModels
from trackfield.types import Indices, Matrix, Vector

_SHAPE = ("amplitude", "falloff", "exponent", "max_range_m", "sigma", "saturation")
_COLUMNS = SignalColumns._fields[:-2]


class Sources(NamedTuple):
    """Sources of one scan, one row each (k); in the order in which they were found.

    `position` (k, 2) [m]; `covariance` (k, 3) xx, xy, yy [m^2]; `amplitude` (k,), in units of the
    reading; `gain` (k,), by how much the source raises the log-likelihood; `leader` (k,), the
    sensor that found it, from which the report sets out; `misfit` (k,), chi^2 over the number of
    readings about it, near 1 where the model is right. What a method does not say is NaN.

    `suspects` are sensors whose readings no source explains: stuck, dead, broken otherwise, or in a
    crowd that cannot be resolved. `complete` is false where a scan would have cost too much.
    """

    position: Matrix
    covariance: Matrix
    amplitude: Vector
    gain: Vector
    leader: Indices
    misfit: Vector
    suspects: Indices
    complete: bool


def locate(
    models: SignalModels, sensors: Matrix, *, values: Vector, settings: SourceSettings | None = None
) -> Sources:
    """Find the sources that make the readings of one scan likely, Oh (1), with honest covariances.

    `values` (n,) of `sensors` (n, 2) [m]; a sensor that did not speak says NaN. Leaders (sensors
    with the largest unexplained reading about them) propose sources in turn; each is fitted jointly
    with its neighbours by damped Gauss-Newton steps, its weights 1 / `signal.variance` following
    the fit, and kept if the log-likelihood gains enough. Covariances are blocks of the inverse
    Fisher matrix. In place of the centroid (12) of Oh, which merges neighbours (`centroid`).

    Raises `InputError` for values that are infinite, sensors that stand nowhere, parameters outside
    their domain. Without `settings` those of `settings_for` are used.
    """
    places, z = checked(sensors, values)
    columns = _checked_columns(models, len(z))
    if not len(z):
        return nothing()
    chosen = settings_for(models, places) if settings is None else settings
    table, leaders, suspects, complete = _sources.locate(
        places,
        z,
        columns,
        models.sigma_factor,
        models.combination == "max",
        asdict(chosen),
    )
    leader = leaders[:, 0]
    loudness = np.broadcast_to(columns[0], z.shape)[leader]
    return Sources(
        position=table[:, :2],
        covariance=table[:, 2:5],
        amplitude=loudness * table[:, 5],
        gain=table[:, 6],
        leader=leader,
        misfit=table[:, 7],
        suspects=suspects[:, 0],
        complete=complete,
    )


def nothing() -> Sources:
    """Return the sources of a scan in which there are none."""
    none, no_one = np.empty(0), np.empty(0, np.int32)
    return Sources(
        position=np.empty((0, 2)),
        covariance=np.empty((0, 3)),
        amplitude=none,
        gain=none,
        leader=no_one,
        misfit=none,
        suspects=no_one,
        complete=True,
    )


def checked(sensors: Matrix, values: Vector) -> tuple[Matrix, Vector]:
    """Sensors (n, 2) and values (n,) as contiguous arrays; `InputError` if they are none."""
    places = np.ascontiguousarray(sensors, float)
    z = np.ascontiguousarray(values, float)
    if places.ndim != 2 or places.shape[1] != 2 or z.shape != places.shape[:1]:
        raise InputError(
            f"sensors of shape {places.shape} and values of shape {z.shape}: "
            "expected (n, 2) and (n,)"
        )
    stands = np.isfinite(places[:, 0]) & np.isfinite(places[:, 1])
    if not stands.all():
        raise InputError(f"sensor {_first(~stands)}: its place is not finite")
    if np.isinf(z).any():
        i = _first(np.isinf(z))
        raise InputError(f"sensor {i}: found {z[i]}, expected a number, or NaN if it did not speak")
    return places, z


def _checked_columns(models: SignalModels, n: int) -> list[Vector]:
    """Columns as the kernel takes them: one entry, or one a sensor."""
    found: list[Vector] = []
    for name in _COLUMNS:
        column = np.atleast_1d(np.ascontiguousarray(getattr(models, name), float))
        if column.shape not in ((1,), (n,)):
            raise InputError(f"{name} of shape {column.shape}: expected a number or ({n},)")
        fine = column > 0.0 if name in _SHAPE else column >= 0.0
        if not fine.all():
            bound = "> 0" if name in _SHAPE else ">= 0"
            raise InputError(f"{name}: found {column[_first(~fine)]}, expected {bound}")
        found.append(column)
    if not 0.0 <= models.sigma_factor < np.inf:
        raise InputError(f"sigma_factor: found {models.sigma_factor}, expected a number >= 0")
    if models.combination not in ("sum", "max"):
        raise InputError(f"combination: found {models.combination!r}, expected 'sum' or 'max'")
    return found


def _first(mask: NDArray[np.bool_]) -> int:
    return int(np.flatnonzero(mask)[0])
