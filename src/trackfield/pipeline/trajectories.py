"""Trajectories of targets that sensors hear pass: amplitudes or energy messages in, tracks out."""

from __future__ import annotations

import heapq
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple
from typing import Any, cast

import numpy as np

from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.network.kinds import kind_of
from trackfield.network.site import Site
from trackfield.pipeline.intake import Rows, in_order, refuse, require_finite, site_sensors
from trackfield.pipeline.lags import require_lags
from trackfield.pipeline.live_passes import Key, LivePass, PassRow
from trackfield.pipeline.pass_book import PassBook
from trackfield.pipeline.pass_intake import (
    LOUD,
    decoded,
    ears,
    fades,
    pass_number,
    pass_rules,
    wants,
)
from trackfield.pipeline.pass_records import PassRecord, Said
from trackfield.pipeline.pass_report import Trajectory, trajectories_of
from trackfield.pipeline.sealing import fingerprint, seal, unseal
from trackfield.pipeline.tagged_rows import ANONYMOUS, Numbering, TargetRow
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.types import Readings, Tracks

_FATES = ("accepted", "duplicate", "late", "nothing", "saturated")  # of readings
_Sample = tuple[float, int, int, float]  # time, target, sensor, value
_RECENT = 64  # messages of a sensor of which copies are known


class TrajectoryTracker:
    """Tracks what passes from amplitudes or energy messages: an operator, as `Tracker`.

    A message counts as soon as it is there, in any order; samples of amplitudes are put in order
    within the site's `window_s`, and a sensor's message is made of them when the target has passed
    it, and a better one when it is gone. After each message the trajectories are found anew, and
    told when time has moved on, with all that was said at one time: confirmed where one explains
    what was heard, else a tentative track for each that may be. Of samples the last word is the
    maximum of the likelihood of all of them.
    Readings that name targets are kept apart by that, others are grouped by what fits together.

    `lag_s` tells where a target was so long ago, known what is known now, from the beginning of its
    records on; `every_s` thins the rows and adds coasting ones between messages.
    """

    def __init__(
        self, site: Site, *, lag_s: float = 0.0, lag_steps: int = 0, every_s: float = 0.0
    ) -> None:
        require_lags(lag_s, lag_steps, every_s=every_s)
        if lag_steps:
            found = f"found lag_steps {lag_steps}, expected a lag in seconds"
            raise ConfigurationError([f"{found}: trajectories have no steps"])
        self._site = site
        self._rules = pass_rules(site, lag_s=float(lag_s), every_s=float(every_s))
        self._places = {name: place for place, name in enumerate(site.sensor_ids)}
        self._ears = ears(site)
        self._numbering = Numbering()
        self._books: list[PassBook] = []
        self._records: dict[tuple[int, int], PassRecord] = {}  # by target and sensor
        self._waiting: list[_Sample] = []
        self._known: dict[tuple[int, int], list[tuple[float, float]]] = {}  # what was said before
        self._newest_s = self._settled_s = -math.inf
        self._counts = Counter[str]()
        self._spoken: set[int] = set()
        self._loud: set[int] = set()  # sensors that heard something clearly

    @property
    def counts(self) -> dict[str, int]:
        """How readings fared; messages that fit no trajectory; tracks started and ended.

        `nothing` are messages that say that nothing was heard, `saturated` samples (among those
        accepted) above their sensor's saturation, which say no more than that it was reached.
        """
        return {
            **{name: self._counts[name] for name in _FATES},
            "unexplained": sum(len(book.unexplained()) for book in self._books),
            "started": sum(book.started for book in self._books),
            "ended": sum(book.ended for book in self._books),
        }

    @property
    def heard(self) -> tuple[str, ...]:
        """Sensors that have spoken."""
        return tuple(self._site.sensor_ids[i] for i in sorted(self._spoken))

    @property
    def wants(self) -> str:
        """What it takes to start a track, in words."""
        return wants(len(self._loud))

    @property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """What is believed now, best trajectories first within a pass."""
        return self._trajectories([book.live for book in self._books])

    @property
    def ended(self) -> tuple[Trajectory, ...]:
        """The last hundred of each name that were confirmed and are over, as they were believed."""
        return self._trajectories([book.over for book in self._books])

    def process(self, readings: Readings, *, watermark_s: float | None = None) -> Tracks:
        """Take readings, in order of arrival; return the rows that are settled now.

        No reading with a time up to `watermark_s` may follow, but for late ones. `InputError` for a
        sensor that the site does not have or that is of another kind, and for values that such a
        sensor cannot say.
        """
        if not isinstance(readings, Readings):  # pyright: ignore[reportUnnecessaryIsInstance] - callers are not all checked
            raise InputError(f"found {type(readings).__name__}, expected Readings")
        names = (*readings.target_ids, ANONYMOUS)
        rows: list[TargetRow] = []
        for t_s, sensor, value, name in self._numbers(readings):
            target = self._target(names[int(name)])
            self._spoken.add(int(sensor))
            later, self._newest_s = t_s > self._newest_s, max(self._newest_s, t_s)
            if isinstance(self._site.models[int(sensor)], EnergyMessageModel):
                rows += self._all_told() if later else []
                rows += self._message(target, int(sensor), t_s, value)
            else:
                self._wait(t_s, target, int(sensor), value)
                rows += self._settle(self._newest_s - self._site.tracker.window_s)
        if watermark_s is not None:
            rows += self._settle(watermark_s)
            for target, book in enumerate(self._books):
                rows += self._rows(target, book.advance(watermark_s))
                if watermark_s >= book.now_s:
                    rows += self._rows(target, book.settled())
        return self._numbering.table(rows)

    def finish(self) -> Tracks:
        """End all records and return the remaining rows, those that wait for their lag too."""
        rows = self._settle(math.inf)
        for (target, sensor), record in sorted(self._records.items()):
            said = record.finish()
            if said is not None:
                rows += self._told(target, sensor, said, self._newest_s)
        for target, book in enumerate(self._books):
            rows += self._rows(target, book.finish())
        return self._numbering.table(rows)

    def snapshot(self) -> bytes:
        """State of the run as bytes: a versioned header and plain JSON; not pickle."""
        state = {
            "targets": list(self._numbering.targets),
            "tracks": [[*key, number] for key, number in self._numbering.tracks.items()],
            "books": [book.plain() for book in self._books],
            "records": [[*key, record.plain()] for key, record in self._records.items()],
            "waiting": self._waiting,
            "known": [[*key, said] for key, said in self._known.items()],
            "times": [self._newest_s, self._settled_s],
            "counts": dict(self._counts),
            "spoken": sorted(self._spoken),
            "loud": sorted(self._loud),
        }
        return seal(json.dumps(state).encode(), self._digest())

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit."""
        body = unseal(data, self._digest())
        try:
            state = cast("Mapping[str, Any]", json.loads(body))
        except ValueError as error:
            raise StateError(f"found a damaged snapshot: {error}") from error
        self._numbering = Numbering()
        self._numbering.targets = {name: place for place, name in enumerate(state["targets"])}
        self._numbering.tracks = {(a, b): number for a, b, number in state["tracks"]}
        self._books = [self._book(name) for name in state["targets"]]
        for book, plain in zip(self._books, state["books"], strict=True):
            book.restore(plain, self._ears)
        self._records = {}
        for target, sensor, plain in state["records"]:
            self._records[target, sensor] = record = self._record(sensor)
            record.restore(plain)
        self._waiting = [(t, target, sensor, z) for t, target, sensor, z in state["waiting"]]
        self._known = {(a, b): [(t, z) for t, z in said] for a, b, said in state["known"]}
        self._newest_s, self._settled_s = state["times"]
        self._counts = Counter[str](state["counts"])
        self._spoken, self._loud = set(state["spoken"]), set(state["loud"])

    def _trajectories(self, passes: Sequence[Sequence[LivePass]]) -> tuple[Trajectory, ...]:
        """Tell the trajectories of passes of each name."""
        return tuple(
            one
            for target, (name, own) in enumerate(zip(self._numbering.targets, passes, strict=True))
            for one in trajectories_of(
                own,
                name or None,
                tracks=lambda track, target=target: self._numbering.track(target, track),
                sensor_ids=self._site.sensor_ids,
            )
        )

    def _digest(self) -> bytes:
        """Fingerprint of all that the states were made from."""
        site = self._site
        return fingerprint(
            "trajectories",
            site.sensor_ids,
            site.positions.tolist(),
            [astuple(model) for model in site.models],
            astuple(site.tracker),
            self._rules,
        )

    def _numbers(self, readings: Readings) -> Iterable[tuple[float, ...]]:
        """Time, sensor, value and place of the name of readings, in order of arrival."""
        require_finite(readings.t_s, "reading", "t_s")
        require_finite(readings.value, "reading", "value")
        site = self._site
        sensor = site_sensors(readings, site.sensor_ids, self._places)
        said = [readings.kinds[int(kind)] for kind in readings.kind]
        models = [site.models[int(place)] for place in sensor]
        refuse(
            np.array([a != kind_of(b) for a, b in zip(said, models, strict=True)], bool),
            lambda row: f"kind {said[row]!r} from {site.sensor_ids[int(sensor[row])]!r}",
            f"the kind of its sensor's model in site {site.name}",
        )
        envelope = np.array([fades(model) for model in models], bool)
        refuse(
            (readings.value < 0.0) & envelope,
            lambda row: f"amplitude {readings.value[row]:g}",
            "0 or more: with fading it is an envelope",
        )
        table = np.array([readings.t_s, sensor, readings.value, readings.target], np.float64).T
        rows = in_order(Rows(readings.t_s, readings.arrival_s, table), np.ones(len(table), bool))
        return cast("Iterable[tuple[float, ...]]", rows.rows.tolist())

    def _message(self, target: int, sensor: int, t_s: float, word: float) -> list[TargetRow]:
        """Take a code word of one sensor."""
        known = self._known.setdefault((target, sensor), [])
        if (t_s, word) in known:
            self._counts["duplicate"] += 1
            return []
        if t_s < self._newest_s - self._rules.drop_s:
            self._counts["late"] += 1
            return []
        message, seen = decoded(self._site, self._ears[sensor], sensor, t_s=t_s, word=word)
        self._counts["accepted"] += 1
        self._counts["nothing"] += not seen
        self._listen(sensor, float(message.profile.a_max))
        known.append((t_s, word))
        del known[:-_RECENT]
        if not seen:  # it may have heard a little: less than it would tell
            return self._rows(target, self._books[target].advance(self._newest_s))
        said = Said(pass_number(self._books[target], message), message)
        return self._told(target, sensor, said, self._newest_s)

    def _wait(self, t_s: float, target: int, sensor: int, value: float) -> None:
        """Put a sample into the order of time, unless it is too late for that."""
        if t_s <= self._settled_s:
            self._counts["late"] += 1
        else:
            heapq.heappush(self._waiting, (t_s, target, sensor, value))

    def _settle(self, until_s: float) -> list[TargetRow]:
        """Hand on the samples up to a time: no earlier one is to come."""
        rows: list[TargetRow] = []
        while self._waiting and self._waiting[0][0] <= until_s:
            t_s, target, sensor, value = heapq.heappop(self._waiting)
            book, ears = self._books[target], self._ears[sensor]
            record = self._records.get((target, sensor))
            if record is None:
                record = self._records[target, sensor] = self._record(sensor)
            own = book.ears.setdefault(sensor, ears._replace(t_s=[], value=[]))
            if own.t_s and own.t_s[-1] >= t_s:
                self._counts["duplicate"] += 1
                continue
            self._counts["accepted"] += 1
            self._counts["saturated"] += value > own.model.saturation
            self._listen(sensor, value)
            own.add(t_s, value)
            rows += self._rows(target, book.advance(t_s))
            said = record.add(t_s, value)
            if said is not None:
                rows += self._told(target, sensor, said, t_s)
        self._settled_s = max(self._settled_s, min(until_s, self._newest_s))
        return rows

    def _listen(self, sensor: int, amplitude: float) -> None:
        if amplitude > LOUD * self._ears[sensor].model.sigma:
            self._loud.add(sensor)

    def _all_told(self) -> list[TargetRow]:
        """Rows of what changed at the time before the newest."""
        told = [(target, book.settled()) for target, book in enumerate(self._books)]
        return [row for target, rows in told for row in self._rows(target, rows)]

    def _told(self, target: int, sensor: int, said: Said, now_s: float) -> list[TargetRow]:
        key: Key = (sensor, said.pass_number)
        return self._rows(target, self._books[target].told(key, said.message, now_s))

    def _rows(self, target: int, told: list[PassRow]) -> list[TargetRow]:
        return [
            TargetRow(target, self._numbering.track(target, one.track), one.shown) for one in told
        ]

    def _target(self, name: str) -> int:
        """Find a target's number; a new one gets a book."""
        target = self._numbering.target(name)
        if target == len(self._books):
            self._books.append(self._book(name))
        return target

    def _book(self, name: str) -> PassBook:
        return PassBook(self._rules, named=name != ANONYMOUS)

    def _record(self, sensor: int) -> PassRecord:
        return PassRecord(sensor, *self._ears[sensor][:3])
