"""Other answers than those that a track holds: found by a fresh start, weighed, and joined to it.

A start looks for all answers to a few scans, but targets turn while it looks, and what fits badly
then may be right. So starts go on being made, and what they find competes with the track.
"""

from __future__ import annotations

import numpy as np

from trackfield.filtering.angle_state import AngleTrack
from trackfield.filtering.interacting import Modes
from trackfield.filtering.matrices import solve
from trackfield.types import Gaussian, Matrix, Vector

_ODDS = 0.2  # of a rival that explains the last scans as well as the track does
_CREDIBLE = 0.01  # weight that a rival needs to be joined
_SAME2 = 9.0  # squared standard deviations within which a rival is no other answer
_MOST = 12  # hypotheses of a track


def joined(track: AngleTrack, new: AngleTrack) -> AngleTrack:
    """Join to a track the hypotheses of a new one that explain the last scans about as well.

    Both are at one time. The first half of the scans of the new track is left out of account: they
    were fitted.
    """
    seen = min(max(new.evidence.shape[1] // 2, 1), track.evidence.shape[1])
    best = int(track.weights.argmax())
    gain = (new.evidence[:, -seen:] - track.evidence[best, -seen:]).sum(axis=1)
    weights: Vector = _ODDS * track.weights[best] * np.exp(np.clip(gain, -50.0, 50.0))
    order: list[int] = np.argsort(-weights, kind="stable").tolist()
    rivals = [
        i
        for i in order
        if weights[i] > _CREDIBLE and not _told(track.whole, new.whole.mean[i], new.whole, i)
    ][: _MOST - len(track.names)]
    if not rivals:
        return track
    first = max(track.names) + 1
    width = min(track.evidence.shape[1], new.evidence.shape[1])
    together = np.concatenate([track.weights, weights[rivals]])
    return track._replace(
        names=(*track.names, *range(first, first + len(rivals))),
        weights=together / together.sum(),
        modes=Modes(
            np.concatenate([track.modes.weights, new.modes.weights[rivals]]),
            _both(track.modes.beliefs, new.modes.beliefs, rivals),
        ),
        prior=_both(track.prior, new.prior, rivals),
        whole=_both(track.whole, new.whole, rivals),
        evidence=np.concatenate(
            [track.evidence[:, -width:], new.evidence[rivals, -width:]],
        ),
    )


def _both(one: Gaussian, other: Gaussian, rows: list[int]) -> Gaussian:
    return Gaussian(
        np.concatenate([one.mean, other.mean[rows]]),
        np.concatenate([one.covariance, other.covariance[rows]]),
    )


def _told(whole: Gaussian, mean: Vector, new: Gaussian, i: int) -> bool:
    """Whether one of the hypotheses is this answer already."""
    for belief, covariance in zip(whole.mean, whole.covariance, strict=True):
        apart: Vector = mean - belief
        both: Matrix = covariance + new.covariance[i]
        if float(apart @ solve(both, apart)) < _SAME2:
            return True
    return False
