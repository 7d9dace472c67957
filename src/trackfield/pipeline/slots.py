"""Event time in steps: which step a row belongs to, when a step closes, what is late or wild.

A step closes when something of a later one arrives, or when a watermark says that nothing more will
come; with a network whose delays are known also when something *arrives* in a later one. A row for
a closed step waits until the next closing, as far back as the window reaches.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Matrix, Vector

_MOST_EMPTY = 100  # steps of a silence that are taken one by one; the rest of it is one step
_FAR = 2.0**53  # steps; beyond, times do not tell steps apart
_SLACK = 1e-6  # of a step: a time on the border is on it, however it was computed


class Rules(NamedTuple):
    """How rows are put into steps: the first `keys` columns of two copies are equal.

    `window` says how many closed steps take late rows, `most` how many rows a step takes; with
    `by_arrival` steps close by times of arrival too.
    """

    step_s: float
    window: int
    keys: int
    most: int
    by_arrival: bool = False


class Late(NamedTuple):
    """All rows of a step that closed before, (n, w); the first `given` were known then."""

    slot: int
    rows: Matrix
    given: int


class Closing(NamedTuple):
    """A step that closes, with its rows (n, w), and the late rows of steps before it."""

    slot: int
    rows: Matrix
    late: tuple[Late, ...]


@dataclass(slots=True, eq=False)
class Slot:
    """Rows of one step so far; the first `given` have been handed on."""

    parts: list[Matrix]
    count: int = 0
    given: int = 0
    seen: set[bytes] = field(default_factory=set[bytes])

    def rows(self, width: int) -> Matrix:
        """All rows (n, width)."""
        if len(self.parts) != 1:
            self.parts = [np.concatenate([np.empty((0, width)), *self.parts])]
        return self.parts[0]


@dataclass(slots=True, eq=False)
class Slots:
    """The steps of a run: those of the window with their rows, and what waits to be believed.

    A row far ahead of all others may come from a clock that jumped. It waits: the next row of a
    later time confirms it, a row of the present refutes it. So does the first row of a run.
    """

    rules: Rules
    width: int
    phase_s: float | None = None  # times of steps are phase_s + k step_s
    closed: int | None = None  # the newest step that closed; None before the first row is believed
    kept: dict[int, Slot] = field(default_factory=dict[int, Slot])
    waiting: tuple[int, Slot] | None = None
    counts: Counter[str] = field(default_factory=Counter[str])
    _closings: list[Closing] = field(default_factory=list[Closing])

    def time(self, slot: int) -> float:
        """Time of a step [s], to the nanosecond: .3 rather than .30000000000000004."""
        return round((self.phase_s or 0.0) + slot * self.rules.step_s, 9)

    def take(self, t_s: Vector, arrival_s: Vector, rows: Matrix) -> list[Closing]:
        """Add rows (n, w) of times `t_s` in order of arrival; the steps that close by them."""
        if not len(rows):
            return []
        if self.phase_s is None:
            step = self.rules.step_s
            self.phase_s = float(t_s[0] - math.floor(t_s[0] / step) * step)
            if not 0.0 <= self.phase_s < step:  # a time too large to have a phase
                self.phase_s = 0.0
        slot = self._slots(t_s, 0.5)
        passed = np.full(slot.size, -_FAR)
        if self.rules.by_arrival:
            told = np.isfinite(arrival_s)
            passed[told] = self._slots(arrival_s[told], _SLACK) - 1.0
        change = (slot[1:] != slot[:-1]) | (passed[1:] != passed[:-1])
        cuts = [0, *(np.flatnonzero(change) + 1).tolist(), slot.size]
        for i, j in pairwise(cuts):
            self._arrived(int(passed[i]))
            self._sort_in(int(slot[i]), rows[i:j])
        return self._taken()

    def advance(self, watermark_s: float) -> list[Closing]:
        """Close the steps that end before `watermark_s`."""
        if self.phase_s is None:
            return []
        last = int(self._slots(np.array([watermark_s]), _SLACK - 0.5)[0])
        if self.waiting is not None and self.waiting[0] <= last:
            self._believe()
        if self.closed is not None:
            self._close_to(last)
        return self._taken()

    def finish(self) -> list[Closing]:
        """Close the step that is open; what waits is believed only if there is nothing else."""
        if self.waiting is not None and self.closed is None:
            self._believe()
        self._refute()
        if self.closed is not None and self.closed + 1 in self.kept:
            self._close_to(self.closed + 1)
        return self._taken()

    def _slots(self, t_s: Vector, shift: float) -> NDArray[np.float64]:
        steps = np.floor((t_s - (self.phase_s or 0.0)) / self.rules.step_s + shift)
        return np.clip(steps, -_FAR, _FAR)

    def _taken(self) -> list[Closing]:
        closings, self._closings = self._closings, []
        return closings

    def _newest(self) -> int:
        """Newest step of which something is believed."""
        closed = self.closed or 0
        return closed + 1 if closed + 1 in self.kept else closed

    def _arrived(self, passed: int) -> None:
        """Close the steps that were over when something arrived, but for a clock that jumped."""
        if self.closed is not None and passed <= self._newest() + self.rules.window:
            self._close_to(passed)

    def _sort_in(self, slot: int, rows: Matrix) -> None:
        if self.closed is None or slot > self._newest() + self.rules.window:
            self._wait(slot, rows)
        elif slot <= self.closed and slot not in self.kept:
            # Older than the window, than the run, or of a silence that was passed over.
            self.counts["late"] += len(rows)
        else:
            self._refute()
            self._accept(slot, rows)

    def _accept(self, slot: int, rows: Matrix) -> None:
        if self.closed is None:
            self.closed = slot - 1
        self._close_to(slot - 1)
        kept = self.kept.setdefault(slot, Slot([]))
        before = kept.count
        self._add(kept, rows)
        self.counts["accepted"] += kept.count - before
        if slot <= self.closed:
            self.counts["delayed"] += kept.count - before

    def _add(self, slot: Slot, rows: Matrix) -> None:
        """Add rows that are not there yet, as many as a step takes."""
        keys, new = row_keys(rows, self.rules.keys), list[int]()
        fresh = set(keys)
        if (
            len(fresh) == len(keys)
            and slot.count + len(keys) <= self.rules.most
            and fresh.isdisjoint(slot.seen)
        ):  # nearly always
            slot.seen |= fresh
            slot.parts.append(rows)
            slot.count += len(keys)
            return
        for place, key in enumerate(keys):
            if key in slot.seen:
                self.counts["duplicate"] += 1
            elif slot.count + len(new) == self.rules.most:
                self.counts["flooded"] += 1
            else:
                slot.seen.add(key)
                new.append(place)
        slot.parts.append(rows[new])
        slot.count += len(new)

    def _wait(self, slot: int, rows: Matrix) -> None:
        if self.waiting is None or slot < self.waiting[0] - self.rules.window:
            self._refute()
            self.waiting = (slot, Slot([]))
        if slot == self.waiting[0]:
            self._add(self.waiting[1], rows)
            return
        if slot > self.waiting[0]:
            self._believe()
            self._sort_in(slot, rows)
            return
        # Two steps of about the same time, the earlier one behind: both are believed.
        later, self.waiting = self.waiting, None
        self._accept(slot, rows)
        self._accept(later[0], later[1].rows(self.width))

    def _believe(self) -> None:
        """Believe what waits."""
        if self.waiting is not None:
            (slot, one), self.waiting = self.waiting, None
            self._accept(slot, one.rows(self.width))

    def _refute(self) -> None:
        """Drop what waits."""
        if self.waiting is not None:
            self.counts["ahead"] += self.waiting[1].count
            self.waiting = None

    def _close_to(self, last: int) -> None:
        first = (self.closed or 0) + 1
        silent = min(first + _MOST_EMPTY, last)
        for slot in range(first, silent):
            self._close(slot)
        if last >= first:
            self._close(last)

    def _close(self, slot: int) -> None:
        late: list[Late] = []
        for number in sorted(n for n in self.kept if n < slot):
            kept = self.kept[number]
            if kept.given < kept.count:
                late.append(Late(number, kept.rows(self.width), kept.given))
                kept.given = kept.count
        one = self.kept.setdefault(slot, Slot([]))
        one.given = one.count
        self._closings.append(Closing(slot, one.rows(self.width), tuple(late)))
        self.closed = slot
        for number in [n for n in self.kept if n <= slot - self.rules.window]:
            del self.kept[number]


def row_keys(rows: Matrix, columns: int) -> list[bytes]:
    """First columns of each row (n, w) as bytes; zero has no sign."""
    keys = np.ascontiguousarray(rows[:, :columns]) + 0.0
    return keys.view(np.dtype((np.void, keys.itemsize * columns))).ravel().tolist()
