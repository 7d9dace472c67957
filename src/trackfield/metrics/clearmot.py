"""CLEAR-MOT: one track a target, kept as long as it fits; what is missed, false, or switched."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.matching import cheapest
from trackfield.metrics.steps import Pairs, Steps

MOSTLY, HARDLY = 0.8, 0.2  # shares of a target's life


class ClearMot(NamedTuple):
    """MOTA = 1 - (misses + false_positives + switches) / rows of the truth, at most 1.

    `motp_m` is the mean distance of matches [m]; `switches` counts targets matched to another track
    than the last time, `fragments` the times that a target is lost between two matches;
    `mostly_tracked` targets are matched in at least 80 % of their steps, `mostly_lost` ones in less
    than 20 %, `partly_tracked` ones between. `recall` and `precision` are shares of targets and of
    tracks that are matched. A share of nothing is None.
    """

    mota: float | None
    motp_m: float | None
    recall: float | None
    precision: float | None
    matches: int
    misses: int
    false_positives: int
    switches: int
    fragments: int
    mostly_tracked: int
    partly_tracked: int
    mostly_lost: int


class Matches(NamedTuple):
    """Chosen pairs: a mask (k,) of them, and of those of another track than the target's last."""

    chosen: NDArray[np.bool_]
    switched: NDArray[np.bool_]


def clear_mot(steps: Steps, near: Pairs) -> ClearMot:
    """Score the matches of `near`, pairs that are close enough to be the same.

    Bernardin, Stiefelhagen (2008); Milan et al. (2016).
    """
    chosen, switched = match_steps(steps, near)
    matched = np.zeros(steps.truth.who.size, bool)
    matched[near.truth[chosen]] = True
    rows, shown, matches = matched.size, steps.shown.who.size, int(np.count_nonzero(chosen))
    switches = int(np.count_nonzero(switched))
    life = np.bincount(steps.truth.who, minlength=steps.targets)
    held = np.bincount(steps.truth.who[matched], minlength=steps.targets)
    share = held[life > 0] / life[life > 0]
    mostly, lost = int(np.sum(share >= MOSTLY)), int(np.sum(share < HARDLY))
    return ClearMot(
        mota=1.0 - (rows - matches + shown - matches + switches) / rows if rows else None,
        motp_m=float(np.mean(near.distance[chosen])) if matches else None,
        recall=matches / rows if rows else None,
        precision=matches / shown if shown else None,
        matches=matches,
        misses=rows - matches,
        false_positives=shown - matches,
        switches=switches,
        fragments=_fragments(steps, matched),
        mostly_tracked=mostly,
        partly_tracked=share.size - mostly - lost,
        mostly_lost=lost,
    )


def match_steps(steps: Steps, near: Pairs) -> Matches:
    """Match step by step: a target keeps the track that it had last, where that one is near.

    The others are matched so that as many as can be are, at the least sum of distances. Of two
    targets that had the same track last, the first keeps it.
    """
    target, track = steps.truth.who[near.truth], steps.shown.who[near.shown]
    starts = np.searchsorted(steps.truth.step[near.truth], np.arange(steps.t_s.size + 1)).tolist()
    last = np.full(steps.targets, -1)
    chosen, switched = np.zeros((2, target.size), bool)
    for start, end in pairwise(starts):
        if start == end:
            continue
        i, j = target[start:end], track[start:end]
        picked = _keep_and_fill(i, j, last[i] == j, near.distance[start:end])
        chosen[start:end] = picked
        switched[start:end] = picked & (last[i] >= 0) & (last[i] != j)
        last[i[picked]] = j[picked]
    return Matches(chosen, switched)


def _keep_and_fill(
    i: NDArray[np.int32],
    j: NDArray[np.int32],
    same: NDArray[np.bool_],
    distance: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Match the pairs of one step; `same` marks those of a target and its last track."""
    picked = np.zeros(i.size, bool)
    kept = np.flatnonzero(same)
    if kept.size:
        _, first = np.unique(j[kept], return_index=True)
        picked[kept[first]] = True
    free = np.flatnonzero(~(np.isin(i, i[picked]) | np.isin(j, j[picked])))
    if free.size:
        targets, a = np.unique(i[free], return_inverse=True)
        tracks, b = np.unique(j[free], return_inverse=True)
        # One more match outweighs any distances.
        worth = 2.0 * min(targets.size, tracks.size) * distance[free].max() + 1.0
        picked[free] = cheapest(a, b, distance[free], alone=worth)
    return picked


def _fragments(steps: Steps, matched: NDArray[np.bool_]) -> int:
    """Count the times that a target goes from matched to missed, and is matched again later."""
    order = np.lexsort((steps.truth.step, steps.truth.who))
    who, held = steps.truth.who[order], matched[order]
    who = who[held]
    place = np.flatnonzero(held)
    return int(np.count_nonzero((np.diff(place) > 1) & (np.diff(who) == 0)))
