"""From tables to scans: reports and detections as they are, positions fitted to signals."""

from __future__ import annotations

from collections import Counter
from typing import Literal, NamedTuple, Protocol

import numpy as np

from trackfield.association.contract import ReportScan
from trackfield.association.detect import ReadingScan
from trackfield.errors import ConfigurationError, InputError
from trackfield.localization.source_fit import locate
from trackfield.localization.source_settings import settings_for
from trackfield.network.kinds import SensorModel, kind_of
from trackfield.network.site import Site
from trackfield.pipeline.intake import (
    READING_KEYS,
    REPORT_KEYS,
    Rows,
    Speakers,
    reading_rows,
    report_rows,
    speakers,
)
from trackfield.pipeline.slots import Late
from trackfield.raster import Region
from trackfield.sensing import signal
from trackfield.sensing.signal import SignalModel
from trackfield.types import Indices, Matrix, Readings, Reports, Vector

Source = Literal["reports", "signal", "detection"]
Table = Reports | Readings
Scan = ReportScan | ReadingScan

_MOST = 5000  # rows that a step takes, or four a sensor: more are a flood
_NEW_D2 = 16.0  # squared distance, in sigmas, from which on a refit's report is another one


class Front(Protocol):
    """What a tracker sees of a kind of data: rows of a table, and the scan of a step's rows."""

    @property
    def width(self) -> int:
        """Columns of a row."""
        ...

    @property
    def keys(self) -> int:
        """Columns, the first ones, in which two rows differ if they are not copies."""
        ...

    @property
    def most(self) -> int:
        """Rows that a step takes; more are a flood."""
        ...

    def rows(self, table: Table, counts: Counter[str]) -> Rows:
        """Rows of a table; counts what is left out. `InputError` for what cannot be used."""
        ...

    def scan(self, t_s: float, rows: Matrix, number: int) -> Scan:
        """Scan of the rows of a step; its reports are numbered from `number` on."""
        ...

    def late(self, t_s: float, late: Late, number: int) -> Scan:
        """Make the scan that late rows add to that of their step, or that takes its place."""
        ...


class ReportFront:
    """Reports as they are."""

    width, keys, most = 6, REPORT_KEYS, _MOST

    def __init__(self, site: Site, region: Region) -> None:
        self._sigma_m, self._region = site.reports.sigma_m, region

    def rows(self, table: Table, counts: Counter[str]) -> Rows:
        """Rows t, x, y, xx, xy, yy of the reports in the region."""
        if not isinstance(table, Reports):
            raise InputError(f"found {type(table).__name__}, expected Reports")
        return report_rows(table, self._region, sigma_m=self._sigma_m, counts=counts)

    def scan(self, t_s: float, rows: Matrix, number: int) -> ReportScan:
        """Put the reports of a step from west to east: in which order they came plays no part."""
        ordered = rows[np.lexsort(rows[:, :0:-1].T)]
        numbers = np.arange(number, number + len(rows), dtype=np.int32)
        return ReportScan(t_s, ordered[:, 1:3].copy(), ordered[:, 3:].copy(), numbers)

    def late(self, t_s: float, late: Late, number: int) -> ReportScan:
        """Make a scan of the late reports."""
        return self.scan(t_s, late.rows[late.given :], number)


class Sensors(NamedTuple):
    """Sensors of one kind: which of the site's (n,), where (n, 2) [m], and their models."""

    places: Indices  # of each of the site's sensors among these, -1 for one of another kind
    positions: Matrix
    models: tuple[SensorModel, ...]


def sensors_of(site: Site, kind: str) -> Sensors:
    """Find the site's sensors of a kind; `ConfigurationError` if there are none."""
    own = [i for i, model in enumerate(site.models) if kind_of(model) == kind]
    if not own:
        raise ConfigurationError(
            [f"site {site.name}: found no sensors of kind {kind!r}, expected some"]
        )
    places = np.full(len(site.models), -1, np.int32)
    places[own] = np.arange(len(own))
    return Sensors(places, site.positions[own, :2], tuple(site.models[i] for i in own))


class SignalFront:
    """Positions fitted to the signals of each step."""

    width, keys = 3, READING_KEYS

    def __init__(self, site: Site) -> None:
        self._sensors, self._speakers = sensors_of(site, "signal"), speakers(site, "signal")
        models = [model for model in self._sensors.models if isinstance(model, SignalModel)]
        self._models = signal.columns(models)
        self._settings = settings_for(self._models, self._sensors.positions)
        self.most = max(_MOST, 4 * len(models))

    def rows(self, table: Table, counts: Counter[str]) -> Rows:
        """Rows t, sensor, value of the readings."""
        return _reading_rows(table, self._speakers)

    def scan(self, t_s: float, rows: Matrix, number: int) -> ReportScan:
        """Fit sources to what the sensors said; a sensor that spoke twice said the mean."""
        found = locate(
            self._models,
            self._sensors.positions,
            values=self._values(rows),
            settings=self._settings,
        )
        numbers = np.arange(number, number + len(found.position), dtype=np.int32)
        return ReportScan(t_s, found.position, found.covariance, numbers)

    def late(self, t_s: float, late: Late, number: int) -> ReportScan:
        """Fit again with the late readings, and keep the sources that were not found before."""
        before = self.scan(t_s, late.rows[: late.given], number)
        after = self.scan(t_s, late.rows, number)
        new = np.ones(len(after.number), bool)
        for place, (xx, xy, yy) in zip(before.position, before.covariance, strict=True):
            dx, dy = (after.position - place).T
            sx, sxy, sy = (after.covariance + np.array([xx, xy, yy])).T
            d2 = (sy * dx * dx - 2.0 * sxy * dx * dy + sx * dy * dy) / (sx * sy - sxy * sxy)
            new &= d2 > _NEW_D2
        numbers = np.arange(number, number + int(new.sum()), dtype=np.int32)
        return ReportScan(t_s, after.position[new], after.covariance[new], numbers)

    def _values(self, rows: Matrix) -> Vector:
        """Mean value of each sensor (n,); NaN of one that did not speak."""
        n = len(self._sensors.models)
        place = self._sensors.places[rows[:, 1].astype(np.intp)]
        count = np.bincount(place, minlength=n)
        total = np.bincount(place, weights=rows[:, 2], minlength=n)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


class DetectionFront:
    """What binary sensors say in each step: 1 where one of them said it, else 0 if it spoke."""

    width, keys = 3, READING_KEYS

    def __init__(self, site: Site) -> None:
        self._sensors = sensors_of(site, "detection")
        self._speakers = speakers(site, "detection")
        self.most = max(_MOST, 4 * len(self._sensors.models))

    def rows(self, table: Table, counts: Counter[str]) -> Rows:
        """Rows t, sensor, value of the readings."""
        return _reading_rows(table, self._speakers)

    def scan(self, t_s: float, rows: Matrix, number: int) -> ReadingScan:
        """Gather what sensors said; -1 of one that was not heard."""
        value = np.full(len(self._sensors.models), -1, np.int8)
        place = self._sensors.places[rows[:, 1].astype(np.intp)]
        np.maximum.at(value, place, rows[:, 2].astype(np.int8))
        return ReadingScan(t_s, value)

    def late(self, t_s: float, late: Late, number: int) -> ReadingScan:
        """Gather what sensors said in that step, late or not."""
        return self.scan(t_s, late.rows, number)


def _reading_rows(table: Table, known: Speakers) -> Rows:
    if not isinstance(table, Readings):
        raise InputError(f"found {type(table).__name__}, expected Readings of kind {known.kind!r}")
    return reading_rows(table, known)
