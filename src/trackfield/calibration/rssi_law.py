"""The law of distance of each receiver, with the shadow that lies over it, by marginal likelihood.

Receiver i hears y = level_i - exponent_i (x - centre) + shadow + fading + noise, x = 10 log10 r.
Levels and exponents of receivers scatter around common ones; how much, and what shadow and fading
are, is learned from all receivers together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from scipy import linalg, optimize

from trackfield.types import Matrix, Vector

_linalg, _optimize = cast("Any", linalg), cast("Any", optimize)  # which have no types
_ENOUGH = 150  # places of a receiver from which shadow and fading are learned
_ODD = 2.5  # standard deviations from which a fingerprint counts less
_ROUNDS = 3


class HeardPlaces(NamedTuple):
    """What one receiver heard at p places.

    `place` (p, 2) [m], `x` (p,) = 10 log10 of the distance, `level_dbm` (p,), and `noise` (p,)
    [dB^2], the variance of that but for shadow and fading.
    """

    place: Matrix
    x: Vector
    level_dbm: Vector
    noise: Vector


class Scatter(NamedTuple):
    """What all receivers share: shadow, fading, and how much levels and exponents differ."""

    shadow_db: float = 3.0
    shadow_m: float = 4.0
    fading_db: float = 2.5
    level_spread_db: float = 3.0
    exponent_spread: float = 0.4


_DOUBT = 0.8  # of the logarithm of each: nothing but runs of few places feel this prior
_LIMITS = Scatter(*cast("Any", [(0.1, 30.0), (0.3, 100.0), (0.2, 30.0), (0.05, 30.0), (0.01, 3.0)]))
_COMMON = np.array([-70.0, 2.0])  # prior of the common level and exponent, and its deviations
_COMMON_SIGMA = np.array([30.0, 1.5])


class Laws(NamedTuple):
    """Level at distance `centre` (as x) and exponent, (2,) in common and (n, 2) of each receiver.

    `covariance` (n, 2, 2) is what remains unknown of those. `off` and `variance` (m,) are errors of
    leaving out each fingerprint, receiver by receiver, with what was expected of their squares;
    `off_law` (m,) the same by the laws alone. `weight` (m,) is below 1 for odd fingerprints.
    """

    scatter: Scatter
    centre: float
    common: Vector
    common_covariance: Matrix
    own: Matrix
    covariance: Matrix
    off: Vector
    variance: Vector
    off_law: Vector
    weight: Vector


class _Receiver(NamedTuple):
    """A receiver's fingerprints ready for algebra: distances, regressors, levels, noise."""

    apart: Matrix  # (p, p)
    A: Matrix  # (p, 2)
    y: Vector
    noise: Vector
    weight: Vector


class _Solved(NamedTuple):
    """Factor of C = shadow + fading + noise, and the normal equations of level and exponent."""

    factor: Any
    log_det: float
    M: Matrix  # A' C^-1 A
    b: Vector  # A' C^-1 y
    square: float  # y' C^-1 y


def fit_laws(heard: Sequence[HeardPlaces], start: Scatter = Scatter()) -> Laws:  # noqa: B008 - immutable
    """Fit laws and scatter to what n receivers heard; a receiver may have heard nothing.

    Scatter maximises the marginal likelihood, all laws integrated out, under wide log-normal priors
    about `start`. Fingerprints that lie more than 2.5 standard deviations off what the others say
    count less (their noise grows with their distance), and the fit is repeated.
    """
    x = np.concatenate([one.x for one in heard])
    centre = float(x.mean())
    weight = [np.ones(one.x.size) for one in heard]
    scatter = start
    receivers: list[_Receiver] = []
    for round_ in range(_ROUNDS + 1):
        receivers = [_receiver(one, centre, w) for one, w in zip(heard, weight, strict=True)]
        scatter = _best(receivers, scatter, start)
        if round_ < _ROUNDS:
            common = _common(receivers, scatter)[0]
            weight = [_weight(one, scatter, common=common) for one in receivers]
    return _laws(receivers, scatter, centre, np.concatenate(weight))


def _laws(receivers: list[_Receiver], scatter: Scatter, centre: float, weight: Vector) -> Laws:
    common, covariance = _common(receivers, scatter)
    spread = _spread(scatter)
    own, own_covariance = np.empty((len(receivers), 2)), np.empty((len(receivers), 2, 2))
    for i, receiver in enumerate(receivers):
        solved = _solve(receiver, scatter)
        P = np.linalg.inv(solved.M + np.diag(1.0 / spread))
        own[i] = P @ (solved.b + common / spread)
        pull = P / spread  # how much of the common law is in this one
        own_covariance[i] = P + pull @ covariance @ pull.T
    errors = [_left_out(one, scatter, common=common) for one in receivers]
    bare = [_left_out(one, scatter, common=common, mapped=False) for one in receivers]
    return Laws(
        scatter=scatter,
        centre=centre,
        common=common,
        common_covariance=covariance,
        own=own,
        covariance=own_covariance,
        off=np.concatenate([off for off, _ in errors]),
        variance=np.concatenate([v for _, v in errors]),
        off_law=np.concatenate([off for off, _ in bare]),
        weight=weight,
    )


def _receiver(heard: HeardPlaces, centre: float, weight: Vector) -> _Receiver:
    apart = np.sqrt(((heard.place[:, None] - heard.place) ** 2).sum(axis=-1))
    A = np.column_stack([np.ones(heard.x.size), centre - heard.x])
    return _Receiver(apart, A, heard.level_dbm, heard.noise, weight)


def _best(receivers: list[_Receiver], first: Scatter, prior: Scatter) -> Scatter:
    """Scatter of the highest marginal likelihood times prior, from `first`."""
    some = [_thinned(one) for one in receivers]
    center = np.log(np.array(prior))

    def cost(logs: Vector) -> float:
        scatter = Scatter(*np.exp(logs).tolist())
        away = (logs - center) / _DOUBT
        return -_log_likelihood(some, scatter) + 0.5 * float(away @ away)

    limits = [tuple(np.log(pair)) for pair in cast("Any", _LIMITS)]
    found = _optimize.minimize(cost, np.log(np.array(first)), method="L-BFGS-B", bounds=limits)
    return Scatter(*np.exp(np.asarray(found.x, float)).tolist())


def _thinned(one: _Receiver) -> _Receiver:
    """Take some of many places, evenly: the time of a fit grows with their cube."""
    if one.y.size <= _ENOUGH:
        return one
    rows = np.linspace(0, one.y.size - 1, _ENOUGH).astype(int)
    apart = one.apart[np.ix_(rows, rows)]
    return _Receiver(apart, one.A[rows], one.y[rows], one.noise[rows], one.weight[rows])


def _log_likelihood(receivers: list[_Receiver], scatter: Scatter) -> float:
    """Log density of all levels, with receivers' laws and the common one integrated out."""
    spread = _spread(scatter)
    prior = 1.0 / _COMMON_SIGMA**2
    total, information, pull = 0.0, np.diag(prior), prior * _COMMON
    for receiver in receivers:
        solved = _solve(receiver, scatter)
        # Own laws integrated out: C + A S A', by its inverse in two dimensions.
        inner = solved.M + np.diag(1.0 / spread)
        K = np.linalg.inv(inner)
        log_det = solved.log_det + float(np.log(np.linalg.det(inner) * spread.prod()))
        total -= 0.5 * (log_det + solved.square - float(solved.b @ K @ solved.b))
        information = information + solved.M - solved.M @ K @ solved.M
        pull = pull + solved.b - solved.M @ K @ solved.b
    shared = float(pull @ np.linalg.solve(information, pull))
    return total + 0.5 * (shared - float(np.linalg.slogdet(information)[1]))


def _common(receivers: list[_Receiver], scatter: Scatter) -> tuple[Vector, Matrix]:
    """Posterior mean (2,) and covariance of the level and exponent that receivers scatter about."""
    prior = 1.0 / _COMMON_SIGMA**2
    information, pull = np.diag(prior), prior * _COMMON
    for receiver in receivers:
        solved = _solve(receiver, scatter)
        K = np.linalg.inv(solved.M + np.diag(1.0 / _spread(scatter)))
        information = information + solved.M - solved.M @ K @ solved.M
        pull = pull + solved.b - solved.M @ K @ solved.b
    covariance = np.asarray(np.linalg.inv(information), float)
    return covariance @ pull, covariance


def _left_out(
    receiver: _Receiver, scatter: Scatter, *, common: Vector, mapped: bool = True
) -> tuple[Vector, Vector]:
    """Errors (p,) of each level as the others foretell it, and the variance that they expect.

    Not `mapped`: by the receiver's law alone, as if shadow were noise.
    """
    if not receiver.y.size:
        return np.empty(0), np.empty(0)
    A = receiver.A
    shared = _covariance(receiver, scatter)
    known = shared if mapped else np.diag(np.diag(shared))
    inverse = np.asarray(np.linalg.inv(known + (A * _spread(scatter)) @ A.T), float)
    precision = np.diag(inverse)
    return inverse @ (receiver.y - A @ common) / precision, 1.0 / precision


def _weight(receiver: _Receiver, scatter: Scatter, *, common: Vector) -> Vector:
    """Weight (p,), (2.5 sigma / error)^2 and at most 1, of each level by how odd it is."""
    off, variance = _left_out(receiver, scatter, common=common)
    # What an odd level was given in excess of the others does not excuse it.
    excess = (receiver.noise + scatter.fading_db**2) * (1.0 / receiver.weight - 1.0)
    return np.minimum(1.0, _ODD**2 * (variance - excess) / np.maximum(off**2, 1e-12))


def _covariance(receiver: _Receiver, scatter: Scatter) -> Matrix:
    K = scatter.shadow_db**2 * np.exp(-receiver.apart / scatter.shadow_m)
    return K + np.diag((receiver.noise + scatter.fading_db**2) / receiver.weight)


def _solve(receiver: _Receiver, scatter: Scatter) -> _Solved:
    if not receiver.y.size:
        return _Solved(None, 0.0, np.zeros((2, 2)), np.zeros(2), 0.0)
    factor = _linalg.cho_factor(_covariance(receiver, scatter), lower=True)
    both = np.column_stack([receiver.A, receiver.y])
    solved = np.asarray(_linalg.cho_solve(factor, both), float)
    normal = both.T @ solved
    log_det = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return _Solved(factor, log_det, normal[:2, :2], normal[:2, 2], float(normal[2, 2]))


def _spread(scatter: Scatter) -> Vector:
    return np.array([scatter.level_spread_db, scatter.exponent_spread]) ** 2
