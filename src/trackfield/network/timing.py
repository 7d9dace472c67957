"""When the rows of a run came: how often, how late, and which of them twice."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trackfield.types import Matrix, Vector

_TAIL = 4096  # rows of the last chunk that are remembered, to find their copies


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """Counts of a run so far: rows in all, those `repeated`, and those `unordered`.

    `late_s` is how far behind the newest one a row came at most, `behind` how many came more than a
    window behind. `tail` are the rows by which copies are found.
    """

    rows: int
    first_s: float
    last_s: float
    longest_gap_s: float
    repeated: int
    unordered: int
    late_s: float
    behind: int
    tail: Matrix


def no_rows(columns: int) -> Timing:
    """Begin; copies will be found by so many columns."""
    return Timing(0, math.inf, -math.inf, 0.0, 0, 0, 0.0, 0, np.empty((0, columns)))


def timed(timing: Timing, t_s: Vector, rows: Matrix, *, window_s: float) -> Timing:
    """Add a chunk: times (n,), and the columns (n, k) in which copies agree."""
    if not t_s.size:
        return timing
    newest = np.maximum.accumulate(np.maximum(t_s, timing.last_s))
    before = np.concatenate([[timing.last_s], newest[:-1]])
    late = np.where(np.isfinite(before), before - t_s, 0.0)
    forward = np.where(np.isfinite(before), newest - before, 0.0)
    known = np.concatenate([timing.tail, rows])
    new = _distinct(known) - _distinct(timing.tail)
    return replace(
        timing,
        rows=timing.rows + t_s.size,
        first_s=min(timing.first_s, float(t_s.min())),
        last_s=float(newest[-1]),
        longest_gap_s=max(timing.longest_gap_s, float(forward.max())),
        repeated=timing.repeated + t_s.size - new,
        unordered=timing.unordered + int(np.count_nonzero(late > 0.0)),
        late_s=max(timing.late_s, float(late.max())),
        behind=timing.behind + int(np.count_nonzero(late > window_s)),
        tail=known[-_TAIL:],
    )


def _distinct(rows: Matrix) -> int:
    """Count the rows (n, k) that differ."""
    ordered = rows[np.lexsort(rows.T)]
    return len(rows) - int(np.count_nonzero((ordered[1:] == ordered[:-1]).all(axis=1)))
