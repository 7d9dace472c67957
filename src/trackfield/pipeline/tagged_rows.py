"""Rows of tracks of tagged targets: numbers of targets and tracks, and tables of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trackfield.filtering.scans import Shown
from trackfield.types import Indices, Tracks, Vector

ANONYMOUS = ""  # the one target of readings that name none


class TargetRow(NamedTuple):
    """A row of a target: numbers of the target and of its track, from 1 over all targets."""

    target: int
    track: int
    shown: Shown


class Numbering:
    """Numbers of targets from 0, and of tracks from 1, in order of appearance."""

    def __init__(self) -> None:
        self.targets: dict[str, int] = {}
        self.tracks: dict[tuple[int, int], int] = {}  # by target and which of its tracks it is

    def target(self, name: str) -> int:
        """Find a target's number; a new one gets the next."""
        return self.targets.setdefault(name, len(self.targets))

    def track(self, target: int, count: int) -> int:
        """Find the number of a target's first, second, ... track; a new one gets the next."""
        return self.tracks.setdefault((target, count), len(self.tracks) + 1)

    def table(self, rows: Sequence[TargetRow]) -> Tracks:
        """Make a table of rows, in the order in which they are told."""
        target, names = named(np.array([row.target for row in rows], np.int32), self.targets)
        return Tracks(
            t_s=np.array([row.shown.t_s for row in rows], np.float64),
            track=np.array([row.track for row in rows], np.int32),
            position=_vectors([row.shown.position for row in rows]),
            velocity=_vectors([row.shown.velocity for row in rows]),
            covariance=_vectors([row.shown.covariance for row in rows]),
            status=np.array([row.shown.status for row in rows], np.int32),
            target=target,
            nis=np.array([row.shown.nis for row in rows], np.float64),
            target_ids=names,
        )


def named(target: Indices, targets: Mapping[str, int]) -> tuple[Indices, tuple[str, ...]]:
    """Places (n,) of the `target` numbers (n,) among the names of those that have one, and these.

    Who has no name is in place -1.
    """
    names = tuple(name for name in targets if name != ANONYMOUS)
    if ANONYMOUS not in targets:
        return target, names
    nameless = targets[ANONYMOUS]
    places = np.where(target > nameless, target - 1, target)
    return np.where(target == nameless, -1, places).astype(np.int32), names


def _vectors(rows: list[Vector]) -> Vector:
    return np.array(rows, np.float64).reshape(-1, 3)
