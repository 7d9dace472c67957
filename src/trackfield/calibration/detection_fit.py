"""p, q and the health of binary sensors by maximum likelihood, where targets' places are known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, expit, logit

from trackfield.sensing.detection import log_likelihood
from trackfield.types import Indices, Matrix, Vector

_DEAD, _BABBLING = 0.05, 0.01  # prior shares of nodes that never speak, or whatever happens
_BOUND = 1e-4  # rates are kept this far from 0 and 1
_ROUNDS = 30
_ENOUGH = 1e-4  # change of the log-likelihood at which a fit has settled


class Evidence(NamedTuple):
    """What n sensors said beside what they could see; made by `evidence`.

    One row (m,) a step and sensor with a target in sight: `sensor`, `coverage` (m, k) of k targets,
    `detected`. The rest is only counted: of `blank` (n,) steps with nobody in sight a sensor spoke
    in `blank_spoken` (n,). `delivery` (n,) of a detection.
    """

    sensor: Indices
    coverage: Matrix
    detected: NDArray[np.bool_]
    blank: Vector
    blank_spoken: Vector
    delivery: Vector


class RateFit(NamedTuple):
    """p and q of all sensors alike, and what kind of node each one is.

    `information` (2, 2) is Fisher's, of (logit p, logit q). `alive`, `dead`, `babbling` (n,) are
    probabilities that sum to 1.
    """

    p: float
    q: float
    information: Matrix
    log_likelihood: float
    alive: Vector
    dead: Vector
    babbling: Vector


class _Slopes(NamedTuple):
    """Per sensor, at some logits: log-likelihood (n,), score (n, 2), information (n, 2, 2)."""

    log_likelihood: Vector
    score: Matrix
    information: NDArray[np.float64]


def evidence(
    coverage: NDArray[np.float64],
    detected: NDArray[np.bool_],
    *,
    heard: NDArray[np.bool_],
    delivery: Vector,
) -> Evidence:
    """Sort a run, `coverage` (steps, k, n) of targets and what was `detected` (steps, n).

    A message that was not `heard` (steps, n) says nothing.
    """
    seen = (coverage > 0.0).any(axis=1)
    step, sensor = np.nonzero(seen & heard)
    blank = heard & ~seen
    return Evidence(
        sensor.astype(np.int32),
        coverage[step, :, sensor],
        detected[step, sensor],
        blank.sum(axis=0).astype(float),
        (blank & detected).sum(axis=0).astype(float),
        delivery,
    )


def spoken(evidence: Evidence) -> tuple[Vector, Vector]:
    """Count (n,) detections of each sensor, and the messages that were heard of it."""
    n = evidence.blank.size
    rows = evidence.sensor
    said = np.bincount(rows, weights=evidence.detected, minlength=n) + evidence.blank_spoken
    return said, np.bincount(rows, minlength=n) + evidence.blank


def fit_rates(evidence: Evidence, start: RateFit | None = None) -> RateFit:
    """Maximise sum_i log(a L_i(p, q) + dead 1{silent} + babbling B(k+1, n-k+1)).

    L_i is the likelihood of sensor i's detections under `sensing.detection.probability`; a dead
    node never speaks, a babbling one speaks at a rate of its own, uniform a priori, whoever is
    near. EM over the kinds, each round one step of Fisher scoring. It begins with all alive, for
    at rates that are far off all nodes look broken; or at a `start` from evidence much alike, where
    most nodes are alive.
    """
    mixed = _broken(evidence)
    if start is None or start.alive.mean() < 0.5:
        nobody = np.full_like(mixed, -np.inf)
        at = _climb(evidence, nobody, np.array([logit(0.5), logit(0.05)]))
    else:
        at = np.array([logit(start.p), logit(start.q)])
    at = _climb(evidence, mixed, at)
    found, shares, total = _evaluate(evidence, mixed, at)
    rates = expit(at)
    information = _total(shares[0], found.information)
    return RateFit(float(rates[0]), float(rates[1]), information, total, *shares)


def _climb(evidence: Evidence, broken: Matrix, at: Vector) -> Vector:
    """Logits (2,) of the highest likelihood up the hill from `at`."""
    found, shares, total = _evaluate(evidence, broken, at)
    for _ in range(_ROUNDS):
        weight = shares[0]
        information = _total(weight, found.information) + 1e-9 * np.eye(2)
        step = np.clip(np.linalg.inv(information) @ (weight @ found.score), -1.0, 1.0)
        new = np.clip(at + step, logit(_BOUND), -logit(_BOUND))
        found, shares, after = _evaluate(evidence, broken, new)
        if after < total:  # overshot: half of the way
            new = 0.5 * (at + new)
            found, shares, after = _evaluate(evidence, broken, new)
        if after < total + _ENOUGH:
            return new if after >= total else at
        at, total = new, after
    return at


def sensor_rates(evidence: Evidence, fit: RateFit) -> tuple[Matrix, Matrix]:
    """Rates p and q (n, 2) of each sensor, shrunk to those of all, and standard errors (n, 2).

    Logits deviate by N(0, tau^2); tau^2 starts at what the scores exceed their information by
    (moments) and follows by EM; each sensor's is the mode given its own detections. A sensor that
    tells little stays near the common values, with an error that says so; one that is not alive has
    exactly those.
    """
    common = np.array([logit(fit.p), logit(fit.q)])
    at_common = _slopes(evidence, np.tile(common, (fit.alive.size, 1)))
    weight = fit.alive
    excess = weight @ (at_common.score**2 - _diagonals(at_common.information))
    square = weight @ _diagonals(at_common.information) ** 2
    tau2 = np.clip(excess / np.maximum(square, 1e-12), 1e-6, 4.0)
    deviation = np.zeros((fit.alive.size, 2))
    covariance = np.zeros((fit.alive.size, 2, 2))
    for _ in range(_ROUNDS):
        now = _slopes(evidence, common + deviation)
        hessian = weight[:, None, None] * now.information + np.eye(2) / tau2
        score = weight[:, None] * now.score - deviation / tau2
        covariance = np.asarray(np.linalg.inv(hessian), float)
        deviation += np.clip((covariance @ score[..., None])[..., 0], -1.0, 1.0)
        tau2 = weight @ (deviation**2 + _diagonals(covariance)) / max(weight.sum(), 1.0)
    rates = expit(common + deviation)
    # The common value is not known exactly either.
    shared = np.diag(np.linalg.pinv(fit.information))
    error = np.sqrt(_diagonals(covariance) + shared)
    return rates, error * rates * (1.0 - rates)


def _evaluate(
    evidence: Evidence, broken: Matrix, at: Vector
) -> tuple[_Slopes, NDArray[np.float64], float]:
    """Slopes at logits (2,), shares (3, n) of alive, dead, babbling, and the log-likelihood."""
    found = _slopes(evidence, np.tile(at, (broken.shape[1], 1)))
    kinds = np.vstack([np.log(1.0 - _DEAD - _BABBLING) + found.log_likelihood, broken])
    total = np.logaddexp.reduce(kinds, axis=0)
    return found, np.exp(kinds - total), float(total.sum())


def _total(weight: Vector, information: NDArray[np.float64]) -> Matrix:
    return np.tensordot(weight, information, axes=1)


def _diagonals(matrices: NDArray[np.float64]) -> Matrix:
    return np.diagonal(matrices, axis1=1, axis2=2)


def _broken(evidence: Evidence) -> Matrix:
    """Log of prior times likelihood (2, n) of a dead and of a babbling node."""
    said, heard = spoken(evidence)
    dead = np.where(said > 0, -np.inf, np.log(_DEAD))
    babbling = np.log(_BABBLING) + betaln(said + 1.0, heard - said + 1.0)
    return np.vstack([dead, babbling])


def _slopes(evidence: Evidence, logits: Matrix) -> _Slopes:
    """Log-likelihood and its slopes in the logits of p and q (n, 2), sensor by sensor."""
    rates = expit(logits)
    p, q = rates[evidence.sensor].T
    c, d = evidence.coverage, evidence.delivery[evidence.sensor]
    missed = 1.0 - p[:, None] * c
    unseen = np.prod(missed, axis=1)
    away = np.prod(1.0 - c, axis=1)
    P = np.clip(d * (1.0 - unseen + q * away), 1e-12, 1.0 - 1e-12)
    slope = np.stack(
        [d * unseen * (c / missed).sum(axis=1) * p * (1.0 - p), d * away * q * (1.0 - q)]
    )
    z = evidence.detected
    precision = 1.0 / (P * (1.0 - P))
    row = log_likelihood(P, z)

    q_blank = rates[:, 1]
    P_blank = np.clip(evidence.delivery * q_blank, 1e-12, 1.0 - 1e-12)
    slope_blank = evidence.delivery * q_blank * (1.0 - q_blank)
    silent = evidence.blank - evidence.blank_spoken
    blank = evidence.blank_spoken * np.log(P_blank) + silent * np.log1p(-P_blank)
    score_blank = (evidence.blank_spoken / P_blank - silent / (1.0 - P_blank)) * slope_blank
    information_blank = evidence.blank * slope_blank**2 / (P_blank * (1.0 - P_blank))

    def per_sensor(values: Vector) -> Vector:
        counts = np.bincount(evidence.sensor, weights=values, minlength=evidence.blank.size)
        return counts.astype(float)

    weighted = slope * precision
    score = np.stack([per_sensor((z - P) * one) for one in weighted], axis=-1)
    information = np.stack(
        [np.stack([per_sensor(a * b) for b in slope], axis=-1) for a in weighted], axis=-2
    )
    score[:, 1] += score_blank
    information[:, 1, 1] += information_blank
    return _Slopes(per_sensor(row) + blank, score, information)
