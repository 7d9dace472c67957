"""Tagged targets by any filter of scans: readings in, rows of tracks out."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping
from dataclasses import astuple
from itertools import pairwise
from typing import Any, Generic, cast

import numpy as np

from trackfield.errors import InputError, StateError
from trackfield.filtering.scans import ScanFilter, State
from trackfield.network.kinds import kind_of
from trackfield.network.site import Site
from trackfield.pipeline.intake import Rows, in_order, refuse, require_finite, site_sensors
from trackfield.pipeline.lags import require_lags
from trackfield.pipeline.scan_archive import pack_stream, unpack_into
from trackfield.pipeline.scan_stream import Said, ScanStream, StreamRules, ToldRow
from trackfield.pipeline.sealing import fingerprint, seal, unseal
from trackfield.pipeline.tagged_rows import ANONYMOUS, Numbering, TargetRow
from trackfield.types import Readings, Tracks

_FATES = ("accepted", "duplicate", "late", "rewound")  # of readings


class ScanTracker(Generic[State]):
    """Tracks tagged targets by a filter of scans: `process`, `snapshot`, `restore` as `Tracker`.

    Readings may come one by one or in tables of any size, out of order within the site's
    `window_s`, from any number of targets and of all kinds that the filter takes. A target's scan
    (its readings of one time) is closed by its next reading, by the watermark, or by `finish`; so
    the rows do not depend on how the readings were cut into tables. A late reading rewinds its
    target and is replayed; rows once shown are not revised. Readings that name no target are of
    one that has no name.

    `lag_s` (or `lag_steps`, in updates) asks for rows that much later and better, `every_s` thins
    the rows and, without a lag, adds coasting ones where a target is silent. `own` are filters of
    targets that have models of their own.
    """

    def __init__(
        self,
        site: Site,
        scan_filter: ScanFilter[State],
        *,
        lag_s: float = 0.0,
        lag_steps: int = 0,
        every_s: float = 0.0,
        own: Mapping[str, ScanFilter[State]] | None = None,
    ) -> None:
        require_lags(lag_s, lag_steps, every_s=every_s)
        self._site, self._filter, self._own = site, scan_filter, dict(own or {})
        self._rules = StreamRules(
            site.tracker.window_s, site.tracker.drop_s, float(lag_s), int(lag_steps), float(every_s)
        )
        self._places = {name: place for place, name in enumerate(site.sensor_ids)}
        self._kinds = [kind_of(model) for model in site.models]
        self._streams: list[ScanStream[State]] = []
        self._numbering = Numbering()
        self._spoken: set[int] = set()

    @property
    def counts(self) -> dict[str, int]:
        """How readings fared (accepted, duplicate, late, ...); tracks started and ended."""
        streams = self._streams
        return {
            **{name: sum(stream.counts[name] for stream in streams) for name in _FATES},
            "started": sum(stream.life.tracks for stream in streams),
            "ended": sum(stream.life.ended for stream in streams),
        }

    @property
    def heard(self) -> tuple[str, ...]:
        """Sensors that have spoken."""
        return tuple(self._site.sensor_ids[i] for i in sorted(self._spoken))

    @property
    def wants(self) -> str:
        """What it takes to start a track, in words."""
        return "more readings of one target from more sensors, nearer in time"

    def process(self, readings: Readings, *, watermark_s: float | None = None) -> Tracks:
        """Take readings, in order of arrival; return the rows that are settled now.

        No reading with a time up to `watermark_s` may follow, but for late ones. `InputError` for a
        sensor that the site does not have or that is of another kind, and for numbers that are not
        finite.
        """
        if not isinstance(readings, Readings):  # pyright: ignore[reportUnnecessaryIsInstance] - callers are not all checked
            raise InputError(f"found {type(readings).__name__}, expected Readings")
        names = (*readings.target_ids, ANONYMOUS)
        rows: list[TargetRow] = []
        for t_s, sensor, value, sigma, name in self._numbers(readings):
            target = self._target(names[int(name)])
            self._spoken.add(int(sensor))
            said = Said(value, sigma)
            rows += self._rows(target, self._streams[target].add(t_s, int(sensor), said=said))
        if watermark_s is not None:
            for target, stream in enumerate(self._streams):
                rows += self._rows(target, stream.advance(watermark_s))
        return self._numbering.table(rows)

    def finish(self) -> Tracks:
        """Close all scans and return the remaining rows, those that wait for their lag too."""
        rows: list[TargetRow] = []
        for target, stream in enumerate(self._streams):
            rows += self._rows(target, stream.finish())
        return self._numbering.table(rows)

    def snapshot(self) -> bytes:
        """State of the run as bytes: a versioned header and each target's own; not pickle."""
        parts = [
            pack_stream(stream, self._filter_of(name))
            for name, stream in zip(self._numbering.targets, self._streams, strict=True)
        ]
        head = {
            "targets": list(self._numbering.targets),
            "tracks": [[*key, number] for key, number in self._numbering.tracks.items()],
            "spoken": sorted(self._spoken),
            "sizes": [len(part) for part in parts],
        }
        text = json.dumps(head).encode()
        body = b"".join((struct.pack("<I", len(text)), text, *parts))
        return seal(body, self._digest())

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit."""
        body = unseal(data, self._digest())
        try:
            (size,) = struct.unpack_from("<I", body)
            head = cast("Mapping[str, Any]", json.loads(body[4 : 4 + size]))
        except (ValueError, struct.error) as error:
            raise StateError(f"found a damaged snapshot: {error}") from error
        ends = np.cumsum([4 + size, *head["sizes"]]).tolist()
        streams: list[ScanStream[State]] = []
        for name, (first, last) in zip(head["targets"], pairwise(ends), strict=True):
            streams.append(ScanStream(self._filter_of(name), self._rules))
            unpack_into(streams[-1], body[first:last], self._filter_of(name))
        self._streams, self._numbering = streams, Numbering()
        self._numbering.targets = {name: place for place, name in enumerate(head["targets"])}
        self._numbering.tracks = {(a, b): number for a, b, number in head["tracks"]}
        self._spoken = set(head["spoken"])

    def _digest(self) -> bytes:
        """Fingerprint of all that the states were made from."""
        site = self._site
        return fingerprint(
            type(self._filter).__qualname__,
            site.sensor_ids,
            site.positions.tolist(),
            [astuple(m) for m in site.models],
            {name: [astuple(m) for m in models] for name, models in site.target_models.items()},
            astuple(site.target),
            astuple(site.tracker),
            self._rules,
        )

    def _filter_of(self, name: str) -> ScanFilter[State]:
        return self._own.get(name, self._filter)

    def _target(self, name: str) -> int:
        """Find a target's number; a new one gets a stream."""
        target = self._numbering.target(name)
        if target == len(self._streams):
            self._streams.append(ScanStream(self._filter_of(name), self._rules))
        return target

    def _rows(self, target: int, told: list[ToldRow]) -> list[TargetRow]:
        return [
            TargetRow(target, self._numbering.track(target, one.track), one.shown) for one in told
        ]

    def _numbers(self, readings: Readings) -> Iterable[tuple[float, ...]]:
        """Time, sensor, value, sigma and place of the name of readings, in order of arrival."""
        require_finite(readings.t_s, "reading", "t_s")
        require_finite(readings.value, "reading", "value")
        sensor = site_sensors(readings, self._site.sensor_ids, self._places)
        said = [readings.kinds[int(kind)] for kind in readings.kind]
        own = [self._kinds[int(place)] for place in sensor]
        refuse(
            np.array([a != b for a, b in zip(said, own, strict=True)], bool),
            lambda row: f"kind {said[row]!r} from {self._site.sensor_ids[int(sensor[row])]!r}",
            f"the kind of its sensor's model in site {self._site.name}",
        )
        columns = readings.t_s, sensor, readings.value, readings.sigma, readings.target
        table = np.array(columns, np.float64).T
        rows = in_order(Rows(readings.t_s, readings.arrival_s, table), np.ones(len(table), bool))
        return cast("Iterable[tuple[float, ...]]", rows.rows.tolist())
