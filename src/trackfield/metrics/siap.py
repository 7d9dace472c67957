"""SIAP: how complete, unambiguous, clean, exact and unbroken the picture is."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackfield.metrics.steps import Pairs, Steps
from trackfield.types import Indices


class Siap(NamedTuple):
    """SIAP attributes, sums over the steps; every track belongs to the nearest target near it.

    `completeness`, share of targets that have a track, best 1; `ambiguity`, tracks a target that
    has one, best 1; `spuriousness`, share of tracks without a target, best 0; `position_error_m`,
    mean distance of tracks to their targets; `breaks_per_s`, further tracks needed to cover the
    time that targets are tracked, a second of it; `longest_segment`, the longest time on one track,
    interruptions left out, as a share of a target's life, best 1. A share of nothing is None.
    """

    completeness: float | None
    ambiguity: float | None
    spuriousness: float | None
    position_error_m: float | None
    breaks_per_s: float | None
    longest_segment: float | None


class Segments(NamedTuple):
    """Runs of consecutive steps at which a track belongs to the same target; all (k,).

    In the order of targets, then of starts; of equal starts the longest comes first.
    """

    target: Indices
    track: Indices
    start: Indices
    end: Indices  # the last step


def siap(steps: Steps, near: Pairs) -> Siap:
    """Score the picture; `near` are pairs close enough to be the same. Votruba et al. (2001)."""
    mine = _nearest(near)
    rows, shown = steps.truth.who.size, steps.shown.who.size
    held, known = np.unique(mine.truth).size, mine.shown.size
    tracked_s, further, longest_s = _continuity(steps, segments(steps, mine))
    life_s = _lives_s(steps)
    return Siap(
        completeness=held / rows if rows else None,
        ambiguity=known / held if held else None,
        spuriousness=(shown - known) / shown if shown else None,
        position_error_m=float(np.mean(mine.distance)) if known else None,
        breaks_per_s=further / tracked_s if tracked_s else None,
        longest_segment=longest_s / life_s if life_s else None,
    )


def segments(steps: Steps, mine: Pairs) -> Segments:
    """Find the segments of pairs that give every track at most one target a step."""
    target, track = steps.truth.who[mine.truth], steps.shown.who[mine.shown]
    step = steps.truth.step[mine.truth]
    order = np.lexsort((step, track))
    target, track, step = target[order], track[order], step[order]
    breaks = (np.diff(track) != 0) | (np.diff(target) != 0) | (np.diff(step) != 1)
    first = np.flatnonzero(np.concatenate([[True] * (step.size > 0), breaks]))
    last = np.flatnonzero(np.concatenate([breaks, [True] * (step.size > 0)]))
    found = Segments(target[first], track[first], step[first], step[last])
    return Segments(
        *(column[np.lexsort((-found.end, found.start, found.target))] for column in found)
    )


def _nearest(near: Pairs) -> Pairs:
    """Keep the nearest target of every track."""
    order = np.lexsort((near.distance, near.shown))
    _, first = np.unique(near.shown[order], return_index=True)
    nearest = order[first]
    return Pairs(near.truth[nearest], near.shown[nearest], near.distance[nearest])


def _continuity(steps: Steps, found: Segments) -> tuple[float, int, float]:
    """Time that targets are tracked [s], further tracks needed for it, longest times on one [s]."""
    bounds = np.searchsorted(found.target, np.arange(steps.targets + 1)).tolist()
    t_s, track = steps.t_s.tolist(), found.track.tolist()
    segment = list(zip(found.start.tolist(), found.end.tolist(), strict=True))
    tracked_s, further, longest_s = 0.0, 0, 0.0
    for a, b in pairwise(bounds):
        if a == b:
            continue
        own = segment[a:b]
        further += _fewest(own) - 1
        tracked_s += sum(t_s[last] - t_s[first] for first, last in _joined(own))
        on_track = dict.fromkeys(track[a:b], 0.0)
        for number, (first, last) in zip(track[a:b], own, strict=True):
            on_track[number] += t_s[last] - t_s[first]
        longest_s += max(on_track.values())
    return tracked_s, further, longest_s


def _fewest(own: list[tuple[int, int]]) -> int:
    """Fewest segments that cover all their steps; greedy, which is optimal on a line."""
    count, covered, reach = 0, -1, -1
    for start, end in own:
        if start > covered + 1 and reach > covered:
            count, covered = count + 1, reach
        if start > covered + 1:
            count, covered = count + 1, end
        reach = max(reach, end)
    return count + (reach > covered)


def _joined(own: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Unions of segments that overlap: from a step to the next one some segment goes on."""
    unions = [own[0]]
    for start, end in own[1:]:
        first, last = unions[-1]
        if start <= last:
            unions[-1] = first, max(last, end)
        else:
            unions.append((start, end))
    return unions


def _lives_s(steps: Steps) -> float:
    """Sum of all targets' times from the first to the last step [s]."""
    order = np.lexsort((steps.truth.step, steps.truth.who))
    who, step = steps.truth.who[order], steps.truth.step[order]
    same = np.diff(who) == 0
    return float(np.sum(np.diff(steps.t_s[step])[same]))
