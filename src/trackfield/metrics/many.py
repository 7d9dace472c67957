"""One run of many targets against its truth: the numbers of `trackfield score --many`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.metrics.cardinality import Cardinality, cardinality
from trackfield.metrics.clearmot import ClearMot, clear_mot, match_steps
from trackfield.metrics.error import shown
from trackfield.metrics.identity import Identity, identity
from trackfield.metrics.ospa import SetDistances, set_distances
from trackfield.metrics.siap import Siap, siap
from trackfield.metrics.steps import Steps, pairs, side_by_side
from trackfield.types import Indices, Tracks, Truth, Vector


class Measure(NamedTuple):
    """How scores of many targets measure.

    `cutoff_m` and `order` are c and p of OSPA and GOSPA; a track less than `match_m` from a target
    may be its track (None: `cutoff_m`).
    """

    cutoff_m: float = 5.0
    order: float = 2.0
    match_m: float | None = None


USUAL = Measure()


class SetScore(NamedTuple):
    """Means over the steps of OSPA, GOSPA and its parts; `localisation` [m^p]."""

    ospa_m: float
    gospa_m: float
    localisation: float
    missed: float
    false: float


class Extent(NamedTuple):
    """What was scored: numbers of steps, targets and tracks, rows shown at no step.

    `presence` is the share of steps from a target's first to its last row at which the truth has
    it: far below 1 if targets have rows at different times (None without targets).
    """

    steps: int
    targets: int
    tracks: int
    off_steps: int
    presence: float | None


class ManyScore(NamedTuple):
    """How good tracks of many targets are, identities of tracks being free.

    What was shown at each step is set beside the truth; `over_time` has the distances of every step
    at `t_s` (T,).
    """

    sets: SetScore
    cardinality: Cardinality
    clear_mot: ClearMot
    identity: Identity
    siap: Siap
    extent: Extent
    measure: Measure
    t_s: Vector
    over_time: SetDistances

    def to_dict(self) -> dict[str, float | int | None]:
        """Names and numbers of all parts, ready for JSON; without the values over time."""
        flat: dict[str, float | int | None] = {}
        for part in self[:7]:
            flat |= part._asdict()
        return flat


def score_many(
    truth: Truth,
    tracks: Tracks,
    *,
    measure: Measure = USUAL,
    tolerance_s: float | None = None,
    max_gap_s: float = 0.0,
) -> ManyScore:
    """Score the shown tracks, whatever they are called, at the steps of the truth.

    `tolerance_s` and `max_gap_s` are those of `side_by_side`; no shown row is a score like another.
    `InputError` for truth or tracks that cannot be used, and where rows are shown but none of them
    at a step.
    """
    steps = side_by_side(truth, tracks, tolerance_s=tolerance_s, max_gap_s=max_gap_s)
    if steps.off_steps and not steps.shown.who.size:
        seen = tracks.t_s[shown(tracks)]
        raise InputError(
            f"no shown row is at a step of the truth: tracks at {_span(seen)}, truth at "
            f"{_span(steps.t_s)}"
        )
    return score_steps(steps, measure=measure)


def score_steps(steps: Steps, *, measure: Measure = USUAL) -> ManyScore:
    """Score what stands side by side; `InputError` for a measure that cannot be."""
    match_m = measure.cutoff_m if measure.match_m is None else measure.match_m
    if not 0.0 < match_m < math.inf:
        raise InputError(f"found a match distance of {match_m:g} m, expected a finite one above 0")
    near = pairs(steps, max(measure.cutoff_m, match_m))
    sets = set_distances(steps, near, cutoff_m=measure.cutoff_m, order=measure.order)
    matching = near.within(match_m)
    return ManyScore(
        sets=SetScore(*(float(np.mean(values)) for values in sets)),
        cardinality=cardinality(steps),
        clear_mot=clear_mot(steps, matching),
        identity=identity(steps, matching),
        siap=siap(steps, matching),
        extent=Extent(
            steps.t_s.size, steps.targets, steps.tracks, steps.off_steps, _presence(steps)
        ),
        measure=measure._replace(match_m=match_m),
        t_s=steps.t_s,
        over_time=sets,
    )


def followed(truth: Truth, tracks: Tracks, *, match_m: float = 5.0) -> Indices:
    """Say which target (n,) each row of tracks follows, by the matches of CLEAR-MOT; -1 for none.

    Rows that are not shown follow none. Errors are those of `score_many`.
    """
    steps = side_by_side(truth, tracks)
    near = pairs(steps, match_m)
    chosen = match_steps(steps, near).chosen
    target = np.full(len(tracks), -1, np.int32)
    target[steps.row[near.shown[chosen]]] = steps.truth.who[near.truth[chosen]]
    return target


def asks_for_many(truth: Truth, tracks: Tracks) -> bool:
    """Tell tracks that no target's name can be scored by: `score_many` is for them.

    No row names a target, and there are several: in the truth, or shown at the same time.
    """
    visible = shown(tracks)
    if not visible.any() or np.any(tracks.target >= 0):
        return False
    if np.unique(truth.target).size > 1:
        return True
    rows = np.unique(np.column_stack([tracks.t_s[visible], tracks.track[visible]]), axis=0)
    return bool(np.any(np.diff(rows[:, 0]) == 0))


def _presence(steps: Steps) -> float | None:
    rows = steps.truth.who.size
    if not rows:
        return None
    first, last = np.full(steps.targets, steps.t_s.size), np.full(steps.targets, -1)
    np.minimum.at(first, steps.truth.who, steps.truth.step)
    np.maximum.at(last, steps.truth.who, steps.truth.step)
    return rows / float(np.sum(last - first + 1, where=last >= 0))


def _span(t_s: Vector) -> str:
    return f"{float(np.min(t_s)):g} to {float(np.max(t_s)):g} s"
