"""Unknown targets: reports, or readings that name no target, in; rows of tracks out."""

from __future__ import annotations

import json
import math
import struct
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import astuple, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from trackfield.association.contract import AnyAssociator, Explanation, ReportScan
from trackfield.association.detect import FieldExplanation
from trackfield.association.model import Scene
from trackfield.errors import InputError, StateError
from trackfield.network.kinds import SensorModel
from trackfield.network.site import Site
from trackfield.pipeline import slots_archive
from trackfield.pipeline.detections import detector
from trackfield.pipeline.fronts import Front, Scan, Source, Table
from trackfield.pipeline.lags import lag_in_steps
from trackfield.pipeline.methods import associator_of, front_of
from trackfield.pipeline.rows import Row, Shown, tell, tracks_of
from trackfield.pipeline.runs import Run
from trackfield.pipeline.scene import scene
from trackfield.pipeline.sealing import fingerprint, seal, unseal
from trackfield.pipeline.slots import Closing, Rules, Slots
from trackfield.types import Report, Tracks, join_rows

_REMEMBERED = 16  # scans whose reports can be looked up
_COUNTS = ("accepted", "delayed", "duplicate", "late", "ahead", "outside", "flooded")
_SLACK = 1e-9  # of a time that is compared


class Feed(NamedTuple):
    """What comes in, and how it is tracked.

    `source` says what tables `process` takes: `Reports`, or `Readings` of kind `signal` or
    `detection`; detections are tracked as they are, the others by the site's `tracker.method`, or
    by `associator` in its place. `seed` is for methods in which there is chance. With `says_zero`
    binary sensors say 0 where they see nothing: then one that is not heard was not silent.
    """

    source: Source = "reports"
    seed: int = 0
    says_zero: bool = False
    associator: AnyAssociator | None = None


class UntaggedTracker:
    """Tracks an unknown number of targets: an operator with `process`, `snapshot`, `restore`.

    Time goes in steps of the site's `reports.step_s`. A step closes when something of a later one
    arrives, when the watermark passes it, or at the end; over a network whose delays the site tells
    also when something arrives in a later step. Then the tracker takes its scan, empty or not,
    and a row is told for every track that is shown. So rows do not depend on how the data were cut
    into tables. What is late by up to `tracker.window_steps` closed steps is put into its scan, and
    the steps since are reconsidered; rows once told are not revised.

    `lag_s` (or `lag_steps`) asks for positions in hindsight, that much later, `every_s` thins the
    rows. `ConfigurationError` for a site that lacks region or step.
    """

    def __init__(
        self,
        site: Site,
        feed: Feed = Feed(),  # noqa: B008 - an immutable value
        *,
        lag_s: float = 0.0,
        lag_steps: int = 0,
        every_s: float = 0.0,
    ) -> None:
        told = scene(site, of_signals=feed.source == "signal")
        step_s = told.reporting.step_s
        self._lag = lag_in_steps(lag_s, lag_steps, every_s=every_s, step_s=step_s)
        self._every_s = float(every_s)
        # What is told in hindsight must still be in the window.
        window = max(site.tracker.window_steps, self._lag + 1)
        site = replace(site, tracker=replace(site.tracker, window_steps=window))
        self._front: Front = front_of(site, told, source=feed.source)
        self._method = _method(site, told, feed)
        self._rules = Rules(
            step_s=step_s,
            window=window,
            keys=self._front.keys,
            most=self._front.most,
            by_arrival=site.network is not None,
        )
        self._maker = fingerprint(
            site.sensor_ids,
            site.positions.tolist(),
            *_models(site),
            [astuple(part) for part in (site.target, site.tracker, site.reports)],
            [astuple(group) for group in site.groups],
            None if site.network is None else astuple(site.network),
            (feed.source, feed.seed, feed.says_zero, type(self._method).__name__),
            (self._lag, self._every_s),
        )
        self._slots = Slots(self._rules, self._front.width)
        self._state: Any = self._method.initial()
        self._scans: deque[ReportScan] = deque(maxlen=_REMEMBERED + window)
        self._shown: Shown = {}
        self._counts: Counter[str] = Counter()
        self._method_counts: Counter[str] = Counter()
        self._learned: dict[str, float] = {}
        self._next_report = 0
        self._last_told_s = -math.inf

    @property
    def counts(self) -> dict[str, int]:
        """How rows fared and what the tracker counted.

        `accepted`, of those `delayed` (into a closed step); dropped as `duplicate`, `late` (beyond
        the window), `ahead` (of a clock that jumped), `outside` the region or `flooded` (more than
        a step takes); `steps`; tracks `started` and `ended`.
        """
        own = dict.fromkeys((*_COUNTS, "steps", "started", "ended"), 0)
        return {**own, **self._counts, **self._slots.counts}

    @property
    def method_counts(self) -> dict[str, int]:
        """What the method counted, for diagnostics."""
        return dict(self._method_counts)

    @property
    def learned(self) -> Mapping[str, float]:
        """What is believed now of quantities that the site leaves open."""
        return dict(self._learned)

    def process(self, table: Table, *, watermark_s: float | None = None) -> Tracks:
        """Take reports or readings, in order of arrival; return the rows that are settled now.

        Nothing with a time up to `watermark_s` may follow, but for what is late.
        """
        taken = self._front.rows(table, self._counts)
        closings = self._slots.take(*taken)
        if watermark_s is not None:
            if not math.isfinite(watermark_s):
                raise InputError(f"watermark_s: found {watermark_s}, expected a finite number")
            closings += self._slots.advance(watermark_s)
        return self._told(closings)

    def finish(self) -> Tracks:
        """Close the last step and return the remaining rows, those that wait for their lag too."""
        rows = [row for closing in self._slots.finish() for row in self._step(closing)]
        for lag in range(min(self._lag, self._counts["steps"]) - 1, -1, -1):
            rows += self._rows(lag)
        return tracks_of(rows)

    def explain(self, track_id: int) -> Explanation | FieldExplanation | None:
        """Say why a track is there: existence, since when, its reports, and what else may be.

        Of detections: which sensors speak for it. None where no track has this number now. `report`
        looks up the numbers of reports.
        """
        return self._method.explain(self._state, track_id)

    def report(self, number: int) -> Report | None:
        """Look up one of the reports of the last steps by its number; None if it is forgotten."""
        for scan in self._scans:
            place = np.flatnonzero(scan.number == number)
            if place.size:
                xx, xy, yy = scan.covariance[place[0]]
                return Report(scan.t_s, scan.position[place[0]], np.array([[xx, xy], [xy, yy]]))
        return None

    def snapshot(self) -> bytes:
        """State of the run as bytes: a versioned header, the steps, and the method's own state."""
        head = {
            "counts": dict(self._counts),
            "method_counts": dict(self._method_counts),
            "learned": self._learned,
            "next_report": self._next_report,
            "last_told_s": self._last_told_s,
            "shown": list(self._shown.values()),  # numbers of JSON come back exactly
            "scans": [[scan.t_s, *(part.tolist() for part in scan[1:])] for scan in self._scans],
        }
        parts = (
            json.dumps(head).encode(),
            slots_archive.pack(self._slots),
            self._method.encode(self._state),
        )
        sizes = struct.pack("<QQQ", *(len(part) for part in parts))
        return seal(sizes + b"".join(parts), self._maker)

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit."""
        body = unseal(data, self._maker)
        sizes = struct.unpack_from("<QQQ", body)
        cuts = np.cumsum([24, *sizes]).tolist()
        first, second, third = (body[i:j] for i, j in pairwise(cuts))
        try:
            head: dict[str, Any] = json.loads(first)
        except ValueError as error:
            raise StateError(f"found a damaged snapshot: {error}") from error
        slots = slots_archive.unpack(second, self._rules)
        self._state = self._method.decode(third)
        self._slots = slots
        self._counts = Counter(head["counts"])
        self._method_counts = Counter(head["method_counts"])
        self._learned = head["learned"]
        self._next_report = head["next_report"]
        self._last_told_s = head["last_told_s"]
        self._shown = {row.track: row for row in (Row(*numbers) for numbers in head["shown"])}
        self._scans.clear()
        self._scans.extend(_scan(*parts) for parts in head["scans"])

    def _told(self, closings: list[Closing]) -> Tracks:
        return tracks_of([row for closing in closings for row in self._step(closing)])

    def _step(self, closing: Closing) -> list[Row]:
        """Close a step: late rows go to their scans, its own make the next; its rows."""
        time, late = self._slots.time, list[Scan]()
        for one in closing.late:
            late.append(self._front.late(time(one.slot), one, self._next_report))
            self._remember(late[-1])
        scan = self._front.scan(time(closing.slot), closing.rows, self._next_report)
        self._remember(scan)
        self._state, info = self._method.step(self._state, scan, late)
        self._method_counts.update(info.counts)
        self._counts["steps"] += 1
        self._learned = dict(info.learned)
        return self._rows(self._lag) if self._counts["steps"] > self._lag else []

    def _remember(self, scan: Scan) -> None:
        """Count the reports of a scan, and keep them to be looked up."""
        if isinstance(scan, ReportScan) and len(scan.number):
            self._next_report += len(scan.number)
            self._scans.append(scan)

    def _rows(self, lag: int) -> list[Row]:
        believed = self._method.estimates(self._state, lag)
        if believed.t_s < self._last_told_s + self._every_s * (1.0 - _SLACK):
            return []
        self._last_told_s = believed.t_s
        told = tell(self._shown, believed)
        self._shown = told.shown
        self._counts["started"] += told.started
        self._counts["ended"] += told.ended
        return told.rows


def _method(site: Site, told: Scene, feed: Feed) -> Any:  # noqa: ANN401 - trackers of two kinds of scans
    if feed.associator is not None:
        return feed.associator
    if feed.source == "detection":
        return detector(site, told, seed=feed.seed, says_zero=feed.says_zero)
    return associator_of(site, told, seed=feed.seed)


def _models(site: Site) -> tuple[list[SensorModel], list[int]]:
    """Different models of a site, and which of them each sensor has: there may be thousands."""
    different = {model: place for place, model in enumerate(dict.fromkeys(site.models))}
    return list(different), [different[model] for model in site.models]


def _scan(t_s: float, position: Any, covariance: Any, number: Any) -> ReportScan:  # noqa: ANN401 - of JSON
    """Make a scan of the lists of a snapshot."""
    return ReportScan(
        t_s,
        np.array(position, np.float64).reshape(-1, 2),
        np.array(covariance, np.float64).reshape(-1, 3),
        np.array(number, np.int32),
    )


def track_unknown(
    site: Site,
    tables: Iterable[Table],
    feed: Feed = Feed(),  # noqa: B008 - an immutable value
    *,
    lag_s: float = 0.0,
    lag_steps: int = 0,
    every_s: float = 0.0,
) -> Run:
    """Track the unknown targets of a whole run; rows in order of time.

    A run without a target is a run: it has no rows.
    """
    tracker = UntaggedTracker(site, feed, lag_s=lag_s, lag_steps=lag_steps, every_s=every_s)
    parts = [tracker.process(table) for table in tables]
    parts.append(tracker.finish())
    return Run(join_rows(parts), tracker.counts)
