"""Position error of tracks against truth, and how much of the time there was a position at all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Matrix, Status, Tracks, Truth, Vector

HOLD_S = 1.0  # how long a shown position stands for the target


class Matched(NamedTuple):
    """Shown rows of tracks that have a truth, (m,): `row` in the tracks, `target` in the truth.

    `error` (m, 3) [m] is track minus truth; its z is NaN where either height is unknown.
    """

    row: NDArray[np.intp]
    target: Indices
    error: Matrix


class ErrorSummary(NamedTuple):
    """Horizontal error |p - p_true| of a set of rows [m]."""

    rmse_m: float
    median_m: float
    p95_m: float


def shown(tracks: Tracks) -> NDArray[np.bool_]:
    """Rows (n,) that a user was shown: confirmed or coasting."""
    return (tracks.status == Status.CONFIRMED) | (tracks.status == Status.COASTING)


def match(truth: Truth, tracks: Tracks, *, max_gap_s: float = 1.0) -> Matched:
    """Set the shown rows beside the truth of their target at their time.

    Truth is interpolated linearly between samples at most `max_gap_s` apart and never extrapolated;
    rows without truth are left out. Targets are matched by name; where the truth knows exactly one
    target, rows that name none are its, and rows of the only target of the tracks.
    """
    rows: list[NDArray[np.intp]] = []
    targets: list[Indices] = []
    errors: list[Matrix] = []
    of_truth = truth_target(truth, tracks)
    for target in range(len(truth.target_ids)):
        row = np.flatnonzero(shown(tracks) & (of_truth == target))
        position = truth_at(truth, target, times=tracks.t_s[row], max_gap_s=max_gap_s)
        known = ~np.isnan(position[:, 0])
        rows.append(row[known])
        targets.append(np.full(int(known.sum()), target, np.int32))
        errors.append(tracks.position[row[known]] - position[known])
    if not rows:
        return Matched(np.empty(0, np.intp), np.empty(0, np.int32), np.empty((0, 3)))
    return Matched(np.concatenate(rows), np.concatenate(targets), np.concatenate(errors))


def truth_target(truth: Truth, tracks: Tracks) -> Indices:
    """Truth's target (n,) of every row of tracks, -1 for none."""
    place = {name: i for i, name in enumerate(truth.target_ids)}
    nameless = 0 if len(truth.target_ids) == 1 else -1
    alone = nameless if len(tracks.target_ids) == 1 else -1
    lookup = [place.get(name, alone) for name in tracks.target_ids]
    return np.array([*lookup, nameless], np.int32)[tracks.target]


def truth_at(truth: Truth, target: int, *, times: Vector, max_gap_s: float = 1.0) -> Matrix:
    """Interpolate the positions (m, 3) [m] of a target at `times` (m,); NaN where not known."""
    own = np.flatnonzero(truth.target == target)
    t, first = np.unique(truth.t_s[own], return_index=True)
    if t.size == 0 or times.size == 0:
        return np.full((times.size, 3), np.nan)
    position = truth.position[own[first]]
    after = np.clip(np.searchsorted(t, times), 0, t.size - 1)
    before = np.where(t[after] == times, after, np.maximum(after - 1, 0))
    gap = t[after] - t[before]
    share = np.where(gap > 0.0, times - t[before], 0.0) / np.where(gap > 0.0, gap, 1.0)
    known = (times >= t[0]) & (times <= t[-1]) & (gap <= max_gap_s)
    between = position[before] + share[:, None] * (position[after] - position[before])
    return np.where(known[:, None], between, np.nan)


def summarize(error: Matrix) -> ErrorSummary:
    """RMSE, median and 95th percentile of horizontal errors of rows (m, >= 2), m >= 1."""
    distance = np.hypot(error[:, 0], error[:, 1])
    median, p95 = np.percentile(distance, [50.0, 95.0])
    return ErrorSummary(float(np.sqrt(np.mean(distance**2))), float(median), float(p95))


def availability(truth: Truth, tracks: Tracks, *, target: int) -> float:
    """Share of the target's time in which it was shown, 0 to 1.

    Its time is the samples of its truth from its first row of any status to its last; a sample is
    covered by a shown row of at most `HOLD_S` before, or twice the usual time between its rows
    where that is longer (thinned tracks). Outages of all sensors count against it.
    """
    own = truth_target(truth, tracks) == target
    if not own.any():
        return 0.0
    rows, shown_at = np.unique(tracks.t_s[own]), np.unique(tracks.t_s[own & shown(tracks)])
    samples = truth.t_s[truth.target == target]
    samples = samples[(samples >= rows[0]) & (samples <= rows[-1])]
    if shown_at.size == 0 or samples.size == 0:
        return 0.0
    hold = max(HOLD_S, 2.0 * float(np.median(np.diff(rows)))) if rows.size > 1 else HOLD_S
    last = np.searchsorted(shown_at, samples, side="right") - 1
    age = np.where(last >= 0, samples - shown_at[np.maximum(last, 0)], np.inf)
    return float(np.mean(age <= hold))
