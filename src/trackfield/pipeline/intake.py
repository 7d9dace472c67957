"""What comes in, as rows: of reports, or of readings that name no target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.kinds import kind_of
from trackfield.network.site import Site
from trackfield.raster import Region
from trackfield.types import Indices, Matrix, Readings, Reports, Vector

REPORT_KEYS = 3  # t, x, y: then xx, xy, yy
READING_KEYS = 2  # t, sensor: then value
_BEYOND = 4.0  # standard deviations of a report outside the region that may still be of it


class Rows(NamedTuple):
    """Rows (n, w) to be put into steps, in order of arrival, with their times (n,)."""

    t_s: Vector
    arrival_s: Vector
    rows: Matrix


def report_rows(
    reports: Reports, region: Region, *, sigma_m: float | None, counts: Counter[str]
) -> Rows:
    """Rows t, x, y, xx, xy, yy of the reports in the region; others are counted as `outside`.

    A report may lie outside by four of its own standard deviations, or of `sigma_m` if it brings
    none. `InputError` for numbers that are not finite, or a covariance that is none.
    """
    require_finite(reports.t_s, "report", "t_s")
    for name, column in (("x_m", reports.position[:, 0]), ("y_m", reports.position[:, 1])):
        require_finite(column, "report", name)
    covariance = reports.covariance
    told = np.logical_not(np.isnan(covariance).any(axis=1))
    xx, xy, yy = covariance.T
    broken = told & ~((xx > 0.0) & (yy > 0.0) & (xy * xy < xx * yy) & np.isfinite(xx * yy))
    if broken.any():
        row = int(broken.argmax())
        raise InputError(
            f"report {row + 1}: found covariance {covariance[row].tolist()}, "
            "expected xx, xy, yy of a positive definite one"
        )
    sigma = np.sqrt(np.where(told, np.fmax(xx, yy), (sigma_m or 0.0) ** 2))
    x, y = reports.position[:, 0], reports.position[:, 1]
    margin = _BEYOND * sigma
    inside = (x >= region.x_min - margin) & (x <= region.x_max + margin)
    inside &= (y >= region.y_min - margin) & (y <= region.y_max + margin)
    counts["outside"] += int(np.count_nonzero(~inside))
    rows = np.column_stack([reports.t_s, x, y, np.where(told[:, None], covariance, np.nan)])
    return in_order(Rows(reports.t_s, reports.arrival_s, rows), inside)


class Speakers(NamedTuple):
    """Sensors of a site that may speak: all its names, and which of them measure the kind (n,)."""

    site_name: str
    sensor_ids: tuple[str, ...]
    numbers: Mapping[str, int]
    of_kind: NDArray[np.bool_]
    kind: str


def speakers(site: Site, kind: str) -> Speakers:
    """Tell which sensors of a site may say readings of a kind."""
    return Speakers(
        site.name,
        site.sensor_ids,
        {name: i for i, name in enumerate(site.sensor_ids)},
        np.array([kind_of(model) == kind for model in site.models], bool),
        kind,
    )


def reading_rows(readings: Readings, known: Speakers) -> Rows:
    """Rows t, sensor, value of readings of one kind; `sensor` counts in the site.

    `InputError` for another kind, a sensor that the site does not have or that measures something
    else, values that such a sensor cannot say, and readings that name a target.
    """
    kind = known.kind
    require_finite(readings.t_s, "reading", "t_s")
    require_finite(readings.value, "reading", "value")
    sensor = site_sensors(readings, known.sensor_ids, known.numbers)
    kinds = np.array([name == kind for name in readings.kinds], bool)
    refuse(
        ~kinds[readings.kind],
        lambda row: f"kind {readings.kinds[int(readings.kind[row])]!r}",
        f"{kind!r} as before: readings of several kinds are tracked one kind at a time",
    )
    refuse(
        ~known.of_kind[sensor],
        lambda row: f"a reading of {kind!r} from {known.sensor_ids[int(sensor[row])]!r}",
        f"one from a sensor whose model is of that kind in site {known.site_name}",
    )
    refuse(
        readings.target >= 0,
        lambda row: f"target {readings.target_ids[int(readings.target[row])]!r}",
        f"none: {kind}s are tracked as of unknown targets",
    )
    if kind == "detection":
        refuse(
            (readings.value != 0.0) & (readings.value != 1.0),
            lambda row: f"value {readings.value[row]:g}",
            "0 or 1",
        )
    rows = np.column_stack([readings.t_s, sensor.astype(float), readings.value])
    return in_order(Rows(readings.t_s, readings.arrival_s, rows), np.ones(len(readings), bool))


def site_sensors(
    readings: Readings, sensor_ids: tuple[str, ...], places: Mapping[str, int]
) -> Indices:
    """Find each reading's sensor (n,) in a site; `InputError` for one it does not have."""
    if readings.sensor_ids == sensor_ids or not len(readings):
        return readings.sensor
    numbers = np.array([places.get(name, -1) for name in readings.sensor_ids], np.int32)
    sensor = numbers[readings.sensor]
    refuse(
        sensor < 0,
        lambda row: f"sensor {readings.sensor_ids[int(readings.sensor[row])]!r}",
        "one of the site",
    )
    return sensor


def in_order(rows: Rows, keep: NDArray[np.bool_]) -> Rows:
    """Keep some rows, in order of arrival where that is told."""
    t_s, arrival_s, table = rows.t_s[keep], rows.arrival_s[keep], rows.rows[keep]
    told = ~np.isnan(arrival_s)
    if not told.any():
        return Rows(t_s, arrival_s, table)
    order = np.argsort(np.where(told, arrival_s, t_s), kind="stable")
    return Rows(t_s[order], arrival_s[order], table[order])


def require_finite(column: Vector, what: str, name: str) -> None:
    """Raise `InputError` for the first number that is not finite, if there is one."""
    finite = np.isfinite(column)
    if not np.all(finite):
        row = int(np.argmin(finite))
        raise InputError(
            f"{what} {row + 1}: found {name} {column[row]:g}, expected a finite number"
        )


def refuse(wrong: NDArray[np.bool_], found: Callable[[int], str], expected: str) -> None:
    """Raise `InputError` for the first of the `wrong` readings, if there is one."""
    if np.any(wrong):
        row = int(np.argmax(wrong))
        raise InputError(f"reading {row + 1}: found {found(row)}, expected {expected}")
