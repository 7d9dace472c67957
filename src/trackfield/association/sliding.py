"""The sliding window of MCMCDA: what a new scan and late reports do to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.association.contract import ReportScan
from trackfield.association.intake import take_in
from trackfield.association.mcmcda_state import State
from trackfield.association.model import Scene
from trackfield.errors import InputError
from trackfield.types import Indices

_MOST_REPORTS = 500  # of a scan
_COUNTED = ("outside", "duplicate", "crowded", "late_taken", "late_dropped")


class Taken(NamedTuple):
    """The window after a scan: its scans, and the old track and identity of their reports (n,)."""

    scans: tuple[ReportScan, ...]
    owner: Indices
    track: Indices
    counts: dict[str, int]
    begins: bool


def slide(
    scene: Scene, window: int, state: State, *, scan: ReportScan, late: Sequence[ReportScan]
) -> Taken:
    """Add a scan to the window of `window` steps, late reports to their slots; drop the old.

    Reports outside the region, duplicates, more than 500 a scan and those without a slot are
    dropped and counted. `InputError` for a scan that is malformed or not newer than the last.
    """
    counts: Counter[str] = Counter(dict.fromkeys(_COUNTED, 0))
    if state.scans and not scan.t_s > state.scans[-1].t_s:
        raise InputError(
            f"a scan of time {scan.t_s} s after one of {state.scans[-1].t_s} s: expected a later "
            "one; reports of earlier times go into `late`"
        )
    slots = _slots(state)
    oldest = scan.t_s - (window - 0.5) * scene.reporting.step_s
    kept = [slot for slot in slots if slot.scan.t_s > oldest][-(window - 1) :]
    none = np.zeros(0, np.int32)
    kept.append(_Slot(ReportScan(scan.t_s, np.zeros((0, 2)), np.zeros((0, 3)), none), none, none))
    sigma_m = state.learned.known(scene).sigma_m
    kept[-1] = _joined(kept[-1], scan, scene=scene, sigma_m=sigma_m, counts=counts)
    for other in late:
        away = [abs(slot.scan.t_s - other.t_s) for slot in kept]
        nearest = int(np.argmin(away))
        if away[nearest] > scene.reporting.step_s / 2:
            counts["late_dropped"] += len(other.number)
            continue
        before = len(kept[nearest].owner)
        kept[nearest] = _joined(kept[nearest], other, scene=scene, sigma_m=sigma_m, counts=counts)
        counts["late_taken"] += len(kept[nearest].owner) - before
    return Taken(
        scans=tuple(slot.scan for slot in kept),
        owner=np.concatenate([slot.owner for slot in kept]),
        track=np.concatenate([slot.track for slot in kept]),
        counts=dict(counts),
        begins=state.begins and len(kept) == len(slots) + 1,
    )


class _Slot(NamedTuple):
    scan: ReportScan
    owner: Indices
    track: Indices


def _slots(state: State) -> list[_Slot]:
    ends = np.cumsum([len(scan.number) for scan in state.scans])[:-1]
    owners, tracks = np.split(state.owner, ends), np.split(state.track, ends)
    return [_Slot(*row) for row in zip(state.scans, owners, tracks, strict=False)]


def _joined(
    slot: _Slot, more: ReportScan, *, scene: Scene, sigma_m: float, counts: Counter[str]
) -> _Slot:
    """Add the reports that can be used and are not there yet, while there is room."""
    old = slot.scan
    taken = take_in(more, scene.reporting.region, sigma_m=sigma_m, known=old.position)
    added = min(len(taken.scan.number), _MOST_REPORTS - len(old.number))
    counts["outside"] += taken.outside
    counts["duplicate"] += taken.duplicate
    counts["crowded"] += len(taken.scan.number) - added
    return _Slot(
        ReportScan(
            old.t_s,
            np.concatenate([old.position, taken.scan.position[:added]]),
            np.concatenate([old.covariance, taken.scan.covariance[:added]]),
            np.concatenate([old.number, taken.scan.number[:added]]),
        ),
        np.append(slot.owner, np.full(added, -1, np.int32)),
        np.append(slot.track, np.zeros(added, np.int32)),
    )
