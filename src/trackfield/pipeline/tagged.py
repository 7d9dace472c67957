"""Tagged targets: ranges in, rows of tracks out.

One operator serves batch, replay and live runs; they differ only in where readings come from.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from dataclasses import astuple
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.filtering.range_tracker import Output, create
from trackfield.network.geometry import geometry
from trackfield.network.site import Site, range_models
from trackfield.pipeline.intake import require_finite
from trackfield.pipeline.lags import require_lags
from trackfield.pipeline.runs import Run, track_readings
from trackfield.pipeline.sealing import fingerprint, seal, unseal
from trackfield.pipeline.tagged_rows import ANONYMOUS, named
from trackfield.types import (
    Indices,
    Readings,
    Tracks,
    Vector,
)


class Fix(NamedTuple):
    """One shown row of one target, as numbers: SI units, covariance of the horizontal position.

    `track` counts the target's tracks from 1; a height that is unknown is NaN; `status` is a value
    of `Status`.
    """

    t_s: float
    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    cov_xx: float
    cov_xy: float
    cov_yy: float
    nis: float
    track: int
    status: int


class Tracker:
    """Tracks tagged targets from ranges: an operator with `process`, `snapshot`, `restore`.

    Readings may come one by one or in tables of any size, out of order within the site's
    `window_s`, from any number of targets. A target's scan (its readings of one time) is closed by
    its next reading, by the watermark, or by `finish`; so the rows do not depend on how the
    readings were cut into tables. A late reading rewinds its target and is replayed; rows once
    shown are not revised.

    `lag_s` (or `lag_steps`, in updates) asks for smoothed rows that much later, `every_s` thins
    the rows and, without a lag, adds coasting ones where a target is silent. `arrival_s` orders
    the readings of one table only: tables themselves are taken as they come.
    """

    def __init__(
        self, site: Site, *, lag_s: float = 0.0, lag_steps: int = 0, every_s: float = 0.0
    ) -> None:
        require_lags(lag_s, lag_steps, every_s=every_s)
        range_models(site)  # or refuse sensors of other kinds
        problems = geometry(site).problems
        if problems:
            raise ConfigurationError([f"site {site.name}: {problem}" for problem in problems])
        self._site = site
        self._output = Output(float(lag_s), int(lag_steps), float(every_s))
        self._bank = create(site, self._output)
        self._sensors = {name: i for i, name in enumerate(site.sensor_ids)}
        self._looked_up: tuple[tuple[str, ...], Indices] = ((), np.empty(0, np.int32))
        self._variants = {name: i + 1 for i, name in enumerate(site.target_models)}
        columns = [range_models(site), *(range_models(site, one) for one in site.target_models)]
        self._offsets = np.array([[m.clock_offset_s for m in models] for models in columns])
        self._targets: dict[str, int] = {}
        self._streams: dict[str, tuple[int, float]] = {}  # what `step` needs of each target
        self._tracks = 0  # numbers given so far
        self._numbers = np.zeros(
            (1, 1), np.int32
        )  # of a target's first, second, ... track; 0: none

    @property
    def counts(self) -> dict[str, int]:
        """How readings fared (accepted, duplicate, late, ...); tracks started, restarted, ended."""
        return self._bank.counts()

    @property
    def heard(self) -> tuple[str, ...]:
        """Sensors that have spoken."""
        return tuple(self._site.sensor_ids[i] for i in self._bank.heard())

    @property
    def wants(self) -> str:
        """What it takes to start a track, in words."""
        return "at least 6 readings of one target from 3 sensors within 4 s"

    def process(self, readings: Readings, *, watermark_s: float | None = None) -> Tracks:
        """Take readings, in order of arrival; return the rows that are settled now.

        No reading with a time up to `watermark_s` may follow, but for late ones.
        """
        if not isinstance(readings, Readings):  # pyright: ignore[reportUnnecessaryIsInstance] - callers are not all checked
            raise InputError(f"found {type(readings).__name__}, expected Readings")
        if len(readings):
            self._add(readings)
        if watermark_s is not None:
            self._bank.advance(watermark_s)
        return self._take()

    def step(
        self, t_s: float, sensor: Indices, *, value: Vector, target_id: str = ANONYMOUS
    ) -> Fix | None:
        """Take one complete scan of one target: `process` for loops in which microseconds count.

        `sensor` (n,) holds numbers of the site's sensors, int32, `value` (n,) ranges [m], float64;
        no further reading of time `t_s` may follow. None until a track is shown, and for a scan
        that is late. Rows of other targets that are pending are given up; with a lag use `process`.
        """
        stream = self._streams.get(target_id) or self._stream(target_id)
        try:
            row = self._bank.step(stream[0], t_s + stream[1], sensor, value)
        except ValueError as error:
            raise InputError(f"scan of {target_id!r} at {t_s} s: found {error}") from None
        return None if row is None else Fix._make(row)

    def finish(self) -> Tracks:
        """Close all scans and return the remaining rows, those that wait for their lag too."""
        self._bank.finish()
        return self._take()

    def snapshot(self) -> bytes:
        """State of the run as bytes: a versioned header and the kernel's own; not pickle."""
        head = json.dumps(
            {
                "targets": list(self._targets),
                "tracks": [*self._numbers.shape, *self._numbers.ravel().tolist()],
            }
        ).encode()
        body = struct.pack("<I", len(head)) + head + self._bank.snapshot()
        return seal(body, self._digest())

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit."""
        body = unseal(data, self._digest())
        (size,) = struct.unpack_from("<I", body)
        head = json.loads(body[4 : 4 + size])
        try:
            self._bank.restore(body[4 + size :])
        except RuntimeError as error:
            raise StateError(f"found a damaged snapshot: {error}") from error
        self._targets = {name: i for i, name in enumerate(head["targets"])}
        self._streams.clear()
        rows, columns, *numbers = head["tracks"]
        self._numbers = np.array(numbers, np.int32).reshape(rows, columns)
        self._tracks = int(self._numbers.max())

    def _digest(self) -> bytes:
        """Fingerprint of all that the kernel was made from."""
        site = self._site
        return fingerprint(
            site.sensor_ids,
            site.positions.tolist(),
            [astuple(m) for m in site.models],
            {name: [astuple(m) for m in models] for name, models in site.target_models.items()},
            astuple(site.target),
            astuple(site.tracker),
            self._output,
        )

    def _add(self, readings: Readings) -> None:
        require_finite(readings.t_s, "reading", "t_s")
        require_finite(readings.value, "reading", "value")
        sensor = self._sensor_numbers(readings)
        target = self._target_numbers(readings)
        t = readings.t_s
        if np.any(self._offsets):
            t = t + self._offsets[self._variant_numbers()[target], sensor]
        value, sigma = readings.value, readings.sigma
        told = ~np.isnan(readings.arrival_s)
        if np.any(told):
            arrival = np.where(told, readings.arrival_s, readings.t_s)
            order = np.argsort(arrival, kind="stable")
            target, t, sensor = target[order], t[order], sensor[order]
            value, sigma = value[order], sigma[order]
        self._bank.add(
            np.ascontiguousarray(target),
            np.ascontiguousarray(t),
            np.ascontiguousarray(sensor),
            np.ascontiguousarray(value),
            np.ascontiguousarray(sigma),
        )

    def _sensor_numbers(self, readings: Readings) -> Indices:
        if readings.sensor_ids is not self._looked_up[0]:
            numbers = np.array([self._sensors.get(name, -1) for name in readings.sensor_ids])
            self._looked_up = (readings.sensor_ids, numbers.astype(np.int32))
        sensor = self._looked_up[1][readings.sensor]
        if np.any(sensor < 0):
            row = int(np.argmax(sensor < 0))
            name = readings.sensor_ids[int(readings.sensor[row])]
            raise InputError(
                f"reading {row + 1}: found sensor {name!r}, which the site does not have"
            )
        kinds = np.array([kind == "range" for kind in readings.kinds], bool)
        if not np.all(kinds[readings.kind]):
            row = int(np.argmin(kinds[readings.kind]))
            kind = readings.kinds[int(readings.kind[row])]
            raise InputError(f"reading {row + 1}: found kind {kind!r}, expected 'range'")
        return sensor

    def _target_numbers(self, readings: Readings) -> Indices:
        names = (*readings.target_ids, ANONYMOUS)
        # Numbers go by first appearance, so that cutting a run does not change them.
        rows = len(readings)
        first = np.full(len(names), rows)
        first[readings.target[::-1]] = np.arange(rows - 1, -1, -1)  # the last to be written stays
        numbers = np.zeros(len(names), np.int32)
        for i in np.argsort(first, kind="stable"):
            if first[i] == rows:
                break
            numbers[i] = self._target_number(names[int(i)])
        return numbers[readings.target]

    def _stream(self, target_id: str) -> tuple[int, float]:
        """Find a target's number, and the clock offset that all its sensors share [s]."""
        offsets = self._offsets[self._variants.get(target_id, 0)]
        if np.ptp(offsets) != 0:
            raise InputError("found sensors of several clocks, for which only `process` is made")
        stream = (self._target_number(target_id), float(offsets[0]))
        self._streams[target_id] = stream
        return stream

    def _target_number(self, name: str) -> int:
        """Find a target's number; a new one's models are told to the kernel."""
        number = self._targets.get(name)
        if number is None:
            number = self._targets[name] = len(self._targets)
            if name in self._variants:
                self._bank.assign(number, self._variants[name])
        return number

    def _variant_numbers(self) -> NDArray[np.intp]:
        return np.array([self._variants.get(name, 0) for name in self._targets], np.intp)

    def _take(self) -> Tracks:
        numbers, names = self._bank.take()
        count, status, target = (np.ascontiguousarray(names[:, i]) for i in range(3))
        track = self._track_numbers(target, count)
        target, names_told = named(target, self._targets)
        return Tracks(
            t_s=np.ascontiguousarray(numbers[:, 0]),
            track=track,
            position=numbers[:, 1:4],
            velocity=numbers[:, 4:7],
            covariance=numbers[:, 7:10],
            status=status,
            target=target,
            nis=np.ascontiguousarray(numbers[:, 10]),
            target_ids=names_told,
        )

    def _track_numbers(self, target: Indices, count: Indices) -> Indices:
        """Give tracks numbers in order of appearance, whatever target they belong to."""
        if not target.size:
            return target
        shape = (int(target.max()) + 1, int(count.max()) + 1)
        known = self._numbers
        if shape[0] > known.shape[0] or shape[1] > known.shape[1]:
            room = (max(2 * known.shape[0], shape[0]), max(2 * known.shape[1], shape[1]))
            grown: NDArray[np.int32] = np.zeros(room, np.int32)
            grown[: known.shape[0], : known.shape[1]] = known
            self._numbers = known = grown
        numbers = known[target, count]
        for row in np.flatnonzero(numbers == 0):
            if known[target[row], count[row]] == 0:
                self._tracks += 1
                known[target[row], count[row]] = self._tracks
        return known[target, count]


def track(
    site: Site,
    readings: Readings | Iterable[Readings],
    *,
    lag_s: float = 0.0,
    lag_steps: int = 0,
    every_s: float = 0.0,
) -> Run:
    """Track all targets of a whole run by their ranges; rows in order of time.

    Raises `InputError` if no track could start because too little was heard.
    """
    tracker = Tracker(site, lag_s=lag_s, lag_steps=lag_steps, every_s=every_s)
    return track_readings(tracker, (readings,) if isinstance(readings, Readings) else readings)
