"""Late reports: go back to the state before their scan, add them, and take all scans since again.

Any tracker with immutable states can be rewound: a window keeps each of the last scans with the
state before it. The same serves detection probabilities that grow with a scan's age, since what a
silence says about a scan changes while its reports are still on their way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from trackfield.association.contract import ReportScan
from trackfield.errors import InputError

State = TypeVar("State")
Replay = Callable[[State, ReportScan, int], State]
"""The next state from a state, a scan, and how many scans came after that."""


class Kept(NamedTuple, Generic[State]):
    """A scan of the window, and the state before it."""

    before: State
    scan: ReportScan


class Window(NamedTuple, Generic[State]):
    """The last scans, oldest first, and the state after all of them."""

    kept: tuple[Kept[State], ...]
    state: State

    @property
    def newest_s(self) -> float:
        """Time of the newest scan; -inf before the first."""
        return self.kept[-1].scan.t_s if self.kept else -math.inf


class Advanced(NamedTuple, Generic[State]):
    """A window with one scan more; what became of late reports, by the age of their scans."""

    window: Window[State]
    replayed: int  # scans taken again
    dropped: int  # late reports older than the window, or of no scan in it
    late_by_age: tuple[int, ...]


def advance(
    window: Window[State],
    scan: ReportScan,
    replay: Replay[State],
    *,
    late: Sequence[ReportScan] = (),
    length: int = 10,
    unsettled: int = 0,
) -> Advanced[State]:
    """Take the next scan and late reports of the last `length` scans.

    Late reports join the scan of the same time. The last `unsettled` scans are taken again in any
    case, because their age changes what they say. `InputError` if the scan is not newer than all
    before.
    """
    if not scan.t_s > window.newest_s:
        raise InputError(
            f"scans in order of time expected, found {scan.t_s} after {window.newest_s}"
        )
    scans = [kept.scan for kept in window.kept]
    first = max(0, len(scans) - unsettled)
    dropped = 0
    by_age = [0] * (length + 1)
    for added in late:
        place = _place(scans, added.t_s)
        if place is None:
            dropped += len(added.number)
            continue
        by_age[len(scans) - place] += len(added.number)
        scans[place] = joined(scans[place], added)
        first = min(first, place)
    kept = list(window.kept[:first])
    state = window.kept[first].before if first < len(scans) else window.state
    for place in range(first, len(scans)):
        kept.append(Kept(state, scans[place]))
        state = replay(state, scans[place], len(scans) - place)
    kept.append(Kept(state, scan))
    state = replay(state, scan, 0)
    moved = Window(tuple(kept[-length:]) if length else (), state)
    return Advanced(moved, len(scans) - first, dropped, tuple(by_age))


def joined(scan: ReportScan, added: ReportScan) -> ReportScan:
    """All reports of two parts of a scan."""
    return ReportScan(
        scan.t_s,
        np.concatenate([scan.position, added.position]),
        np.concatenate([scan.covariance, added.covariance]),
        np.concatenate([scan.number, added.number]),
    )


def _place(scans: list[ReportScan], t_s: float) -> int | None:
    for place in range(len(scans) - 1, -1, -1):
        if scans[place].t_s == t_s:
            return place
        if scans[place].t_s < t_s:
            return None
    return None
