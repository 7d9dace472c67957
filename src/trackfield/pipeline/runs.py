"""Whole runs through an operator of readings: what such operators share, and what comes out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np

from trackfield.errors import InputError
from trackfield.types import Readings, Tracks, join_rows, select_rows


class Run(NamedTuple):
    """Outcome of a whole run: rows in order of time, and how readings fared."""

    tracks: Tracks
    counts: dict[str, int]


class ReadingsTracker(Protocol):
    """What tracks readings whose targets have names, or are told apart by it: an operator."""

    @property
    def counts(self) -> dict[str, int]:
        """How readings fared (accepted, duplicate, late, ...); tracks started and ended."""
        ...

    @property
    def heard(self) -> tuple[str, ...]:
        """Sensors that have spoken."""
        ...

    @property
    def wants(self) -> str:
        """What it takes to start a track, in words."""
        ...

    def process(self, readings: Readings, *, watermark_s: float | None = None) -> Tracks:
        """Take readings, in order of arrival; return the rows that are settled now."""
        ...

    def finish(self) -> Tracks:
        """Close all and return the remaining rows."""
        ...

    def snapshot(self) -> bytes:
        """State of the run as sealed bytes; not pickle."""
        ...

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit."""
        ...


def track_readings(tracker: ReadingsTracker, readings: Iterable[Readings]) -> Run:
    """Track all targets of a whole run; rows in order of time.

    Raises `InputError` if no track could start because too little was heard.
    """
    parts = [tracker.process(chunk) for chunk in readings]
    parts.append(tracker.finish())
    require_tracks(tracker)
    return Run(sort_rows(join_rows(parts)), tracker.counts)


def require_tracks(tracker: ReadingsTracker) -> None:
    """Raise `InputError` if a finished run started no track, saying what was missing."""
    counts = tracker.counts
    if counts["started"] or not counts["accepted"]:
        return
    raise InputError(
        f"found {counts['accepted']} usable readings from {len(tracker.heard)} sensors "
        f"({', '.join(tracker.heard[:8])}) and no time at which a track could start, "
        f"expected {tracker.wants}"
    )


def sort_rows(tracks: Tracks) -> Tracks:
    """Rows in order of time; rows of one time stay in the order in which they were shown."""
    if np.all(tracks.t_s[1:] >= tracks.t_s[:-1]):
        return tracks
    return select_rows(tracks, np.argsort(tracks.t_s, kind="stable"))
