"""Several answers to what angles say: how they are thinned, smoothed and shown together."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trackfield.filtering import interacting, smoothing
from trackfield.filtering.angle_state import AngleTrack
from trackfield.filtering.interacting import Modes
from trackfield.filtering.matrices import solve
from trackfield.filtering.scans import Shown
from trackfield.filtering.smoothing import Passed
from trackfield.motion import ConstantVelocity
from trackfield.types import Gaussian, Matrix, Status, Vector

_PRUNED = 1e-4
_SAME2 = 1.0  # squared standard deviations within which two hypotheses are one


def fresh(beliefs: Gaussian, *, t_s: float, modes: int) -> AngleTrack:
    """Make a track of hypotheses (H, n) that are equally likely, as are the modes of each."""
    hypotheses = len(beliefs.mean)
    return AngleTrack(
        t_s=t_s,
        names=tuple(range(hypotheses)),
        weights=np.full(hypotheses, 1.0 / hypotheses),
        modes=interacting.init(beliefs, (1.0,) * modes),
        prior=beliefs,
        whole=beliefs,
        nis=math.nan,
        misfits=(),
        evidence=np.empty((hypotheses, 0)),
        confirmed=False,
    )


def thinned(track: AngleTrack) -> AngleTrack:
    """Drop hypotheses that are unlikely, or have become the same as a likelier one."""
    if len(track.names) == 1:
        return track
    whole = track.whole
    weights: Vector = track.weights.copy()
    keep: list[int] = []
    order: list[int] = np.argsort(-track.weights, kind="stable").tolist()
    for i in order:
        twin = next((j for j in keep if _apart2(whole, i, j) < _SAME2), None)
        if twin is not None:
            weights[twin] += track.weights[i]
        elif track.weights[i] > _PRUNED:
            keep.append(i)
    modes, prior = track.modes, track.prior
    return track._replace(
        names=tuple(track.names[i] for i in keep),
        weights=weights[keep] / weights[keep].sum(),
        modes=Modes(
            modes.weights[keep],
            Gaussian(modes.beliefs.mean[keep], modes.beliefs.covariance[keep]),
        ),
        prior=Gaussian(prior.mean[keep], prior.covariance[keep]),
        whole=Gaussian(whole.mean[keep], whole.covariance[keep]),
        evidence=track.evidence[keep],
    )


def _apart2(whole: Gaussian, i: int, j: int) -> float:
    apart = whole.mean[i] - whole.mean[j]
    return float(apart @ solve(whole.covariance[j], apart))


def weight_of(track: AngleTrack, name: int) -> float:
    """Weight of a hypothesis; 0 once it was given up."""
    return float(track.weights[track.names.index(name)]) if name in track.names else 0.0


def smoothed(tracks: Sequence[AngleTrack], name: int) -> Gaussian:
    """RTS over successive tracks of one hypothesis, on the moments of its modes."""
    later = _belief(tracks[-1], name)
    for now, then in zip(tracks[-2::-1], tracks[:0:-1], strict=True):
        place = then.names.index(name)
        prior = Gaussian(then.prior.mean[place], then.prior.covariance[place])
        d = later.mean.size // 2
        carried = ConstantVelocity(0.0, d).transition(then.t_s - now.t_s)
        later = smoothing.back(later, Passed(_belief(now, name), carried, prior))
    return later


def _belief(track: AngleTrack, name: int) -> Gaussian:
    place = track.names.index(name)
    return Gaussian(track.whole.mean[place], track.whole.covariance[place])


def together(weights: Vector, whole: Gaussian) -> Matrix:
    """Covariance (d, d) of the place by all hypotheses, about the likeliest."""
    mean = whole.mean[int(np.argmax(weights))]
    d = mean.size // 2
    apart = whole.mean[:, :d] - mean[:d]
    spread: Matrix = np.einsum("h,hi,hj->ij", weights, apart, apart)
    inside: Matrix = np.einsum("h,hij->ij", weights, whole.covariance[:, :d, :d])
    return spread + inside


def shown(t_s: float, weights: Vector, whole: Gaussian, *, status: Status, nis: float) -> Shown:
    """Show the likeliest of hypotheses (H,) with moments `whole`, with the spread of all."""
    mean = whole.mean[int(np.argmax(weights))]
    d = mean.size // 2
    P = together(weights, whole)
    position, velocity = np.full(3, np.nan), np.zeros(3)
    position[:d], velocity[:d] = mean[:d], mean[d:]
    return Shown(t_s, position, velocity, np.array([P[0, 0], P[0, 1], P[1, 1]]), status, nis)
