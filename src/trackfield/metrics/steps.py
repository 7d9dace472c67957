"""Truth and shown tracks side by side, step by step: what all scores of many targets look at."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from trackfield.errors import InputError
from trackfield.metrics.error import shown, truth_at
from trackfield.types import Indices, Matrix, Tracks, Truth, Vector

SAME_S = 1e-6  # times this close are one: files of tracks tell no finer ones
MOST_STEPS = 10_000_000
_EMPTY_GAP = 1.5  # of usual spacings: where nobody is, a longer one holds steps without a target


class Rows(NamedTuple):
    """Who is where: a row a step and identity, in the order of steps, then of identities.

    `step` (n,) numbers the steps, `who` (n,) the identities from 0; `position` (n, 2) [m].
    """

    step: Indices
    who: Indices
    position: Matrix

    def counts(self, steps: int) -> Indices:
        """How many are there at each step, (steps,)."""
        return np.bincount(self.step, minlength=steps).astype(np.int32)


class Steps(NamedTuple):
    """Targets and shown tracks at the times `t_s` (T,) of the steps.

    `targets` and `tracks` are the numbers of identities; `row` (m,) says which rows of the table of
    tracks `shown` is made of; `off_steps` counts shown rows that belong to no step: before, after,
    or between them.
    """

    t_s: Vector
    truth: Rows
    shown: Rows
    targets: int
    tracks: int
    row: Indices
    off_steps: int


class Pairs(NamedTuple):
    """Targets and tracks near each other at the same step, in the order of steps and targets.

    `truth` (k,) and `shown` (k,) are rows of the two tables, `distance` (k,) is horizontal [m].
    """

    truth: Indices
    shown: Indices
    distance: Vector

    def within(self, reach_m: float) -> Pairs:
        """Those that are less than `reach_m` apart."""
        near = self.distance < reach_m
        return Pairs(self.truth[near], self.shown[near], self.distance[near])


def side_by_side(
    truth: Truth,
    tracks: Tracks,
    *,
    times_s: Vector | None = None,
    tolerance_s: float | None = None,
    max_gap_s: float = 0.0,
) -> Steps:
    """Set what was shown beside the truth, at the steps of the truth.

    Steps are the times of the truth, and times at the same spacing where it has a gap that no
    target bridges: there, nobody is. `times_s` tells other ones. A target is there where the truth
    has a row, or where it can be interpolated between rows at most `max_gap_s` apart. A shown row
    belongs to the nearest step, at most `tolerance_s` away (half the usual spacing, where None); of
    several rows of a track the nearest counts, and of equally near ones the last. Tentative and
    ended rows are not shown.

    `InputError` for positions or times that are no numbers, for a target that is at two places at
    once, and for no truth at no told times.
    """
    visible = np.flatnonzero(shown(tracks))
    _check_finite("truth", truth.t_s, truth.position)
    _check_finite("tracks", tracks.t_s[visible], tracks.position[visible])
    times = _truth_times(truth) if times_s is None else _told(times_s)
    within = _half_spacing(times) if tolerance_s is None else tolerance_s
    if not within >= 0.0:
        raise InputError(f"found a tolerance of {within:g} s, expected 0 or more")
    step, near = _nearest(times, tracks.t_s[visible], within)
    visible, off_steps = visible[step >= 0], int(np.count_nonzero(step < 0))
    near, step = near[step >= 0], step[step >= 0]
    numbers, who = np.unique(tracks.track[visible], return_inverse=True)
    order = np.lexsort((visible, -near, who, step))
    last = _last_of_runs(step[order], who[order])
    rows = order[last]
    return Steps(
        t_s=times,
        truth=_truth_rows(truth, times, max_gap_s),
        shown=Rows(_index(step[rows]), _index(who[rows]), tracks.position[visible[rows], :2]),
        targets=len(truth.target_ids),
        tracks=int(numbers.size),
        row=_index(visible[rows]),
        off_steps=off_steps,
    )


def pairs(steps: Steps, reach_m: float) -> Pairs:
    """Find all pairs of a target and a track of one step that are less than `reach_m` apart."""
    count = steps.t_s.size
    a, b = (
        np.searchsorted(rows.step, np.arange(count + 1)).tolist()
        for rows in (steps.truth, steps.shown)
    )
    found: list[Pairs] = []
    for i in range(count):
        if a[i] == a[i + 1] or b[i] == b[i + 1]:
            continue
        distance = distances(
            steps.truth.position[a[i] : a[i + 1]], steps.shown.position[b[i] : b[i + 1]]
        )
        one, other = np.nonzero(distance < reach_m)
        found.append(Pairs(_index(a[i] + one), _index(b[i] + other), distance[one, other]))
    if not found:
        return Pairs(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))
    return Pairs(*map(np.concatenate, zip(*found, strict=True)))


def distances(one: Matrix, other: Matrix) -> Matrix:
    """Distances (n, m) [m] of positions (n, d) and (m, d) [m]."""
    return cdist(one, other).astype(np.float64, copy=False)


def _truth_times(truth: Truth) -> Vector:
    """Tell the times of the truth, and of the steps at which nobody is there."""
    if not len(truth):
        raise InputError("the truth holds no rows: nothing to score against")
    times = np.unique(truth.t_s)
    times = times[np.concatenate([[True], np.diff(times) > SAME_S])]
    if times.size < 3:
        return times
    gaps = np.diff(times)
    usual = float(np.median(gaps))
    rows = np.lexsort((truth.t_s, truth.target))
    step = np.searchsorted(times, truth.t_s[rows] + SAME_S) - 1
    goes_on = (np.diff(step) == 1) & (np.diff(truth.target[rows]) == 0)
    bridged = np.zeros(gaps.size, bool)
    bridged[step[:-1][goes_on]] = True
    empty = np.flatnonzero(~bridged & (gaps > _EMPTY_GAP * usual))
    more = np.rint(gaps[empty] / usual)
    if float(more.sum()) + times.size > MOST_STEPS:
        raise InputError(
            f"the truth has gaps of up to {gaps[empty].max():g} s at a spacing of {usual:g} s, "
            f"over {MOST_STEPS} steps; expected a truth without them, or the times of the steps"
        )
    filled: list[Vector] = [
        np.linspace(times[i], times[i + 1], int(n) + 1)[1:-1]
        for i, n in zip(empty, more, strict=True)
    ]
    return np.sort(np.concatenate([times, *filled]))


def _told(times_s: Vector) -> Vector:
    times = np.unique(np.asarray(times_s, np.float64))
    if times.size == 0 or not np.isfinite(times).all():
        raise InputError("found no times of steps, or such that are no numbers; expected seconds")
    return times


def _truth_rows(truth: Truth, times: Vector, max_gap_s: float) -> Rows:
    """Rows of the truth by step; those at no step are left out."""
    if max_gap_s > 0.0:
        return _interpolated(truth, times, max_gap_s)
    step, _ = _nearest(times, truth.t_s, SAME_S)
    kept = np.flatnonzero(step >= 0)
    order = kept[np.lexsort((truth.target[kept], step[kept]))]
    last = _last_of_runs(step[order], truth.target[order])
    again = np.flatnonzero(~last)  # the same target and step as the next one
    moved = np.any(truth.position[order[again], :2] != truth.position[order[again + 1], :2], axis=1)
    if moved.any():
        row = int(order[again[np.flatnonzero(moved)[0]]])
        raise InputError(
            f"the truth has target {truth.target_ids[truth.target[row]]!r} at two places at "
            f"{truth.t_s[row]:g} s, expected one"
        )
    rows = order[last]
    return Rows(_index(step[rows]), _index(truth.target[rows]), truth.position[rows, :2])


def _interpolated(truth: Truth, times: Vector, max_gap_s: float) -> Rows:
    step: list[NDArray[Any]] = []
    position: list[Matrix] = []
    for target in range(len(truth.target_ids)):
        places = truth_at(truth, target, times=times, max_gap_s=max_gap_s)[:, :2]
        known = np.flatnonzero(~np.isnan(places[:, 0]))
        step.append(known)
        position.append(places[known])
    who = np.repeat(np.arange(len(step)), [one.size for one in step])
    steps = np.concatenate([*step, np.empty(0, np.intp)])
    order = np.argsort(steps, kind="stable")  # the targets of a step stay in order
    return Rows(
        _index(steps[order]),
        _index(who[order]),
        np.concatenate([*position, np.empty((0, 2))])[order],
    )


def _nearest(times: Vector, t_s: Vector, within_s: float) -> tuple[NDArray[np.intp], Vector]:
    """Find the nearest step (n,) of each time, -1 where none is, and how far it is; ties late."""
    after = np.clip(np.searchsorted(times, t_s), 0, times.size - 1)
    before = np.maximum(after - 1, 0)
    step = np.where(t_s - times[before] < times[after] - t_s, before, after)
    away = np.abs(t_s - times[step])
    # Decimal times are not exact in binary: half a step off is half a step off.
    return np.where(away <= within_s * (1.0 + 1e-9) + 1e-12, step, -1), away


def _half_spacing(times: Vector) -> float:
    return 0.5 * float(np.median(np.diff(times))) if times.size > 1 else SAME_S


def _last_of_runs(*keys: NDArray[Any]) -> NDArray[np.bool_]:
    """Rows (n,) after which some key changes; the last row too."""
    changes = np.any([np.diff(key) != 0 for key in keys], axis=0)
    return np.append(changes, True)[: keys[0].size]


def _check_finite(what: str, t_s: Vector, position: Matrix) -> None:
    sound = np.isfinite(t_s) & np.isfinite(position[:, :2]).all(axis=1)
    if not sound.all():
        row = int(np.flatnonzero(~sound)[0])
        raise InputError(
            f"{what}: found t_s {t_s[row]:g}, x_m {position[row, 0]:g}, y_m {position[row, 1]:g}, "
            "expected finite numbers"
        )


def _index(values: NDArray[Any]) -> Indices:
    return values.astype(np.int32)
