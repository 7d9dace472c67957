"""One run against its truth: the numbers of `trackfield score`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.metrics.consistency import clipped_nis, distances2, nees, share_inside
from trackfield.metrics.error import availability, match, shown, summarize, truth_target
from trackfield.types import Tracks, Truth, Vector


class Score(NamedTuple):
    """How good tracks are: horizontal errors [m], time covered, honesty of the covariances.

    `rows` counts the shown rows that have a truth; `nees` is 2 and `inside_95` .95 for right
    covariances, `nis` about 1; `nis` is None for tracks that do not tell it, `nees` where a
    covariance is no covariance, `height_rmse_m` where heights are unknown.
    """

    rmse_m: float
    median_m: float
    p95_m: float
    availability: float
    inside_95: float
    nees: float | None
    nis: float | None
    height_rmse_m: float | None
    rows: int

    def to_dict(self) -> dict[str, float | int | None]:
        """Names and numbers, ready for JSON."""
        return self._asdict()


def score(
    truth: Truth, tracks: Tracks, *, target: str | None = None, max_gap_s: float = 1.0
) -> Score:
    """Score the shown rows of all targets together, or of one.

    Truth is interpolated between samples at most `max_gap_s` apart. `InputError` where no shown row
    has a truth.
    """
    matched = match(truth, tracks, max_gap_s=max_gap_s)
    wanted = range(len(truth.target_ids)) if target is None else [_index(truth, target)]
    kept = np.isin(matched.target, np.array(wanted, np.int32))
    row, error = matched.row[kept], matched.error[kept]
    if row.size == 0:
        raise InputError(_nothing_to_score(truth, tracks))
    d2 = distances2(error, tracks.covariance[row])
    mean_d2 = nees(d2)
    height = error[:, 2][~np.isnan(error[:, 2])]
    shares = np.array([availability(truth, tracks, target=i) for i in wanted])
    samples = np.bincount(truth.target, minlength=len(truth.target_ids))[list(wanted)]
    return Score(
        *summarize(error),
        availability=float(shares @ samples) / int(samples.sum()),
        inside_95=share_inside(d2),
        nees=mean_d2 if mean_d2 < math.inf else None,
        nis=clipped_nis(tracks.nis[row]),
        height_rmse_m=float(np.sqrt(np.mean(height**2))) if height.size else None,
        rows=int(row.size),
    )


def scores_by_target(truth: Truth, tracks: Tracks, *, max_gap_s: float = 1.0) -> dict[str, Score]:
    """Score every target that has shown rows with a truth, by name."""
    matched = match(truth, tracks, max_gap_s=max_gap_s)
    matched_ids = np.bincount(matched.target, minlength=len(truth.target_ids)) > 0
    names = [name for name, known in zip(truth.target_ids, matched_ids, strict=True) if known]
    return {name: score(truth, tracks, target=name, max_gap_s=max_gap_s) for name in names}


def _index(truth: Truth, target: str) -> int:
    if target not in truth.target_ids:
        known = ", ".join(truth.target_ids[:16])
        raise InputError(f"found no target {target!r} in the truth, expected one of: {known}")
    return truth.target_ids.index(target)


def _nothing_to_score(truth: Truth, tracks: Tracks) -> str:
    """Say why nothing matches: no rows, other targets, other times."""
    visible = shown(tracks)
    if not len(truth):
        return "the truth holds no rows: nothing to score against"
    if not visible.any():
        return f"none of the {len(tracks)} rows of the tracks is confirmed: nothing to score"
    if not np.any(truth_target(truth, tracks)[visible] >= 0):
        ours, theirs = ", ".join(tracks.target_ids[:8]), ", ".join(truth.target_ids[:8])
        return f"tracks and truth share no target: tracks of {ours or 'nobody'}, truth of {theirs}"
    return (
        f"no shown row has a truth: tracks at {_span(tracks.t_s[visible])}, truth at "
        f"{_span(truth.t_s)}; truth is not extrapolated, nor bridged over longer gaps"
    )


def _span(t_s: Vector) -> str:
    return f"{float(np.min(t_s)):g} to {float(np.max(t_s)):g} s"
