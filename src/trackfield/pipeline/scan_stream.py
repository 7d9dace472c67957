"""One target's readings as scans in order of time, whatever the order in which they come."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Mapping
from typing import Generic, NamedTuple

import numpy as np

from trackfield.errors import StateError
from trackfield.filtering.scans import Scan, ScanFilter, Shown, State
from trackfield.types import Status

_SLACK_S = 1e-9
_KEPT = 8  # states of a window that are kept to go back to


class StreamRules(NamedTuple):
    """How late readings may come, when a silent track ends, and which rows are asked for [s]."""

    window_s: float
    drop_s: float
    lag_s: float = 0.0
    lag_steps: int = 0
    every_s: float = 0.0

    @property
    def lags(self) -> bool:
        """Whether rows wait for what comes later."""
        return self.lag_s > 0.0 or self.lag_steps > 0


class Said(NamedTuple):
    """What a sensor said of a target at one time; sigma is NaN where it told none."""

    value: float
    sigma: float


class StreamLife(NamedTuple, Generic[State]):
    """All that a target's future depends on."""

    state: State
    t_s: float = -math.inf  # of its last scan
    on: bool = False  # whether it has a track now
    tracks: int = 0  # that it has had
    ended: int = 0  # of them
    row_s: float = -math.inf  # of its last row


class StreamMoment(NamedTuple, Generic[State]):
    """A scan, by sensor, and what is believed after it, if that is kept.

    `due` rows wait for their lag.
    """

    t_s: float
    said: Mapping[int, Said]
    life: StreamLife[State] | None = None
    due: bool = False


class ToldRow(NamedTuple):
    """A row of a target's track; `track` counts the target's own from 1."""

    track: int
    shown: Shown


class ScanStream(Generic[State]):
    """The scans of one target: closed, put in order, replayed when a reading comes late.

    States are immutable values: some of those of the window are kept, and a late reading goes back
    to one before it. With a lag all are kept as long as a row waits. Rows told are not revised.
    """

    def __init__(self, model: ScanFilter[State], rules: StreamRules) -> None:
        self._filter, self._rules = model, rules
        self.life = StreamLife(model.start())
        self.history = [
            StreamMoment(-math.inf, {}, self.life)
        ]  # the first is what replays start from
        self.open_s, self.open = -math.inf, dict[int, Said]()  # the scan that may still grow
        self.dirty_s = math.inf  # the earliest late reading that is not replayed yet
        self.told_s = -math.inf  # rows up to here are told
        self.counts = Counter[str]()

    def add(self, t_s: float, sensor: int, *, said: Said) -> list[ToldRow]:
        """Take a reading; the rows that are settled by it."""
        newest = self.open_s if self.open else self.life.t_s
        if t_s > newest:
            rows = self._close()
            self.open_s, self.open[sensor] = t_s, said
            self.counts["accepted"] += 1
            return rows
        if self.open and t_s == newest:
            if sensor in self.open:
                self.counts["duplicate"] += 1
            else:
                self.open[sensor] = said
                self.counts["accepted"] += 1
            return []
        if self._rules.window_s <= 0.0 or t_s < newest - self._rules.window_s:
            self.counts["late"] += 1
            return []
        self._put_late(t_s, sensor, said)
        return []

    def advance(self, watermark_s: float) -> list[ToldRow]:
        """Close what no reading will join; tell of a silent target, and that its track ends."""
        rows: list[ToldRow] = []
        if self.open and self.open_s <= watermark_s:
            rows += self._close()
        elif self.dirty_s < math.inf:
            rows += self._replay()
        rows += self._coast(watermark_s)
        if not self.open and self.life.on and watermark_s - self.life.t_s > self._rules.drop_s:
            rows += self._end(len(self.history))
        return rows

    def finish(self) -> list[ToldRow]:
        """Close the last scan and tell all rows that wait."""
        return self._close() + self._flush(len(self.history), every=True)

    def _put_late(self, t_s: float, sensor: int, said: Said) -> None:
        place = bisect_left(self.history, t_s, key=_time)
        there = self.history[place] if place < len(self.history) else None
        if there is None or there.t_s != t_s:
            self.history.insert(place, StreamMoment(t_s, {sensor: said}))
        elif sensor in there.said:
            self.counts["duplicate"] += 1
            return
        else:
            self.history[place] = there._replace(said={**there.said, sensor: said})
        self.counts["accepted"] += 1
        self.dirty_s = min(self.dirty_s, t_s)

    def _close(self) -> list[ToldRow]:
        rows = self._replay() if self.dirty_s < math.inf else []
        if not self.open:
            return rows
        self.history.append(StreamMoment(self.open_s, self.open))
        self.open = {}
        rows += self._apply(len(self.history) - 1)
        self._forget()
        return rows

    def _replay(self) -> list[ToldRow]:
        """Go back to before the earliest late reading, and take all scans since then again."""
        self.counts["rewound"] += 1
        place, self.life = self._kept(bisect_left(self.history, self.dirty_s, key=_time))
        self.dirty_s = math.inf
        return [row for i in range(place + 1, len(self.history)) for row in self._apply(i)]

    def _kept(self, end: int) -> tuple[int, StreamLife[State]]:
        """Find the last moment before `end` whose state is kept: the first of all always is."""
        for place in range(end - 1, -1, -1):
            life = self.history[place].life
            if life is not None:
                return place, life
        raise StateError("found a history without a state to begin with")

    def _apply(self, place: int) -> list[ToldRow]:
        """Condition on the scan at a place of the history; all before it have been."""
        t_s, said = self.history[place][:2]
        rows = self._coast(t_s)
        if t_s - self.life.t_s > self._rules.drop_s:
            rows += self._end(place)
        state = self._filter.step(self.life.state, _scan(t_s, said))
        shown = self._filter.shown(state, t_s)
        alive = shown is not None and shown.status != Status.ENDED
        if self.life.on and not alive:
            rows += self._flush(place, every=True)
            rows += [] if shown is None else self._tell(shown)
        due = alive and t_s >= self.life.row_s + self._rules.every_s - _SLACK_S
        self.life = StreamLife(
            state,
            t_s,
            on=alive,
            tracks=self.life.tracks + (alive and not self.life.on),
            ended=self.life.ended + (self.life.on and not alive),
            row_s=t_s if due else self.life.row_s,
        )
        gap_s = t_s - self._kept(place)[1].t_s
        keep = self._rules.lags or gap_s >= self._rules.window_s / _KEPT
        self.history[place] = StreamMoment(
            t_s, said, self.life if keep else None, due and self._rules.lags
        )
        if self._rules.lags:
            return rows + self._flush(place + 1)
        return rows + (self._tell(shown) if due and shown is not None else [])

    def _coast(self, until_s: float) -> list[ToldRow]:
        """Tell where a silent target should be, every so often, as long as its track lasts."""
        every_s, life = self._rules.every_s, self.life
        if self._rules.lags or every_s <= 0.0 or not life.on:
            return []
        rows: list[ToldRow] = []
        stop_s = min(until_s, life.t_s + self._rules.drop_s)
        while life.row_s + max(2.0 * every_s, 1.0) <= stop_s:
            life = life._replace(row_s=life.row_s + every_s)
            shown = self._filter.shown(life.state, life.row_s)
            if shown is None or shown.status == Status.ENDED:
                break
            coasting = shown.status == Status.CONFIRMED
            status = Status.COASTING if coasting else shown.status
            rows += self._tell(shown._replace(status=status, nis=math.nan))
        self.life = life
        return rows

    def _end(self, place: int) -> list[ToldRow]:
        """End what has been silent for too long, where it would be then; begin anew."""
        life, rows = self.life, list[ToldRow]()
        if life.on:
            rows += self._flush(place, every=True)
            shown = self._filter.shown(life.state, life.t_s + self._rules.drop_s)
            if shown is not None:
                rows += self._tell(shown._replace(status=Status.ENDED, nis=math.nan))
        self.life = life._replace(
            state=self._filter.start(), on=False, ended=life.ended + int(life.on)
        )
        return rows

    def _flush(self, end: int, *, every: bool = False) -> list[ToldRow]:
        """Tell the rows that have waited long enough, or every one, by what came before `end`."""
        rows: list[ToldRow] = []
        first = bisect_right(self.history, self.told_s, key=_time) if self._rules.lags else end
        for place in range(first, end):
            moment = self.history[place]
            if not moment.due or moment.life is None:
                continue
            if not (every or self._ripe(place, end - 1)):
                break
            known = [one.life.state for one in self.history[place:end] if one.life is not None]
            found = self._filter.hindsight(known)
            if found is not None:
                rows += self._tell(found, moment.life.tracks)
            self.told_s = max(self.told_s, moment.t_s)
        return rows

    def _ripe(self, place: int, last: int) -> bool:
        """Whether a moment has waited for its lag when scan `last` has come."""
        if self._rules.lag_steps > 0:
            return last - place >= self._rules.lag_steps
        waited_s = self.history[last].t_s - self.history[place].t_s
        return waited_s >= self._rules.lag_s - _SLACK_S

    def _tell(self, shown: Shown, track: int | None = None) -> list[ToldRow]:
        """One row, of the present track unless told; none where later ones are told already."""
        if shown.t_s <= self.told_s:
            return []
        self.told_s = shown.t_s
        return [ToldRow(self.life.tracks if track is None else track, shown)]

    def _forget(self) -> None:
        """Keep one state from before the window, and those of rows that wait for their lag."""
        window_s = self._rules.window_s
        before, _ = self._kept(bisect_left(self.history, self.life.t_s - window_s, key=_time))
        untold = bisect_right(self.history, self.told_s, key=_time)
        waits = (i for i in range(untold, before) if self.history[i].due)
        del self.history[: next(waits, before)]


def _time(moment: StreamMoment[State]) -> float:
    return moment.t_s


def _scan(t_s: float, said: Mapping[int, Said]) -> Scan:
    """Make a scan, in the order of the site: the order in which readings came does not count."""
    sensors = sorted(said)
    return Scan(
        t_s,
        np.array(sensors, np.int32),
        np.array([said[one].value for one in sensors], np.float64),
        np.array([said[one].sigma for one in sensors], np.float64),
    )
