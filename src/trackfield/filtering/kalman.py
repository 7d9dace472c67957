"""The Kalman filter: linear motion, linear readings, Gaussian noise.

All functions take leading axes: means (..., n), covariances (..., n, n), readings (..., m) of many
targets or runs at once. A reading that is NaN was not made; any number of readings will do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.filtering.matrices import apply, solve, symmetric, transposed
from trackfield.motion import Motion
from trackfield.types import Gaussian, Matrix, Vector


class Update(NamedTuple):
    """A belief after readings, and how well they fitted what was expected of them.

    `log_likelihood` and `distance2` (squared Mahalanobis distance of the innovation) have the
    leading axes of the belief; `distance2` has `count` degrees of freedom.
    """

    posterior: Gaussian
    log_likelihood: Vector
    distance2: Vector
    readings: Vector


class Linear(NamedTuple):
    """z = H x + v, v ~ N(0, R); H (..., m, n), R (..., m, m)."""

    H: Matrix
    R: Matrix


class Info(NamedTuple):
    """What a step leaves for smoothing and diagnosis."""

    prior: Gaussian
    update: Update


def predict(belief: Gaussian, transition: Matrix, noise: Matrix) -> Gaussian:
    """Carry a belief through x' = F x + w, w ~ N(0, Q), Wang (16), (17)."""
    mean = apply(transition, belief.mean)
    return Gaussian(mean, transition @ belief.covariance @ transposed(transition) + noise)


def update(prior: Gaussian, z: Vector, sensor: Linear) -> Update:
    """Condition on z = H x + v: covariance form, Wang (18)-(21).

    Joseph form: the covariance stays positive definite under rounding.
    """
    mean, P = prior
    made = ~np.isnan(z)
    H = np.where(made[..., None], sensor.H, 0.0)
    R = np.where(made[..., None] & made[..., None, :], sensor.R, np.eye(z.shape[-1]))
    innovation = np.where(made, z, 0.0) - apply(H, mean)
    S = H @ P @ transposed(H) + R
    K = transposed(np.linalg.solve(S, H @ P))
    A = np.eye(mean.shape[-1]) - K @ H
    covariance = A @ P @ transposed(A) + K @ R @ transposed(K)

    distance2 = (innovation * solve(S, innovation)).sum(-1)
    log_det = np.linalg.slogdet(S)[1]
    posterior = Gaussian(mean + apply(K, innovation), symmetric(covariance))
    return _judged(posterior, distance2, log_det, made)


def update_information(prior: Gaussian, z: Vector, H: Matrix, *, variance: Vector) -> Update:
    """Condition on readings with independent noise: P+ = (P^-1 + sum h h'/v)^-1, information form.

    z and `variance` (..., m), H (..., m, n). Equals `update` with R = diag(variance) at the cost of
    one n x n solve, whatever m is.
    """
    innovation = z - apply(H, prior.mean)
    return assimilate(prior, innovation, H, variance=variance)


def assimilate(prior: Gaussian, innovation: Vector, H: Matrix, *, variance: Vector) -> Update:
    """`update_information` for readings given as innovation, z less what was expected."""
    made = ~np.isnan(innovation)
    e = np.where(made, innovation, 0.0)
    weight = np.where(made, 1.0 / np.where(made, variance, 1.0), 0.0)
    shift, covariance, spread = shifted(prior.covariance, e, H, weight=weight)

    distance2 = (e * weight * (e - apply(H, shift))).sum(-1)
    log_noise = np.log(np.where(made, variance, 1.0)).sum(-1)
    log_det = log_noise + np.linalg.slogdet(spread)[1]
    return _judged(Gaussian(prior.mean + shift, covariance), distance2, log_det, made)


def shifted(
    P: Matrix, innovation: Vector, H: Matrix, *, weight: Vector
) -> tuple[Vector, Matrix, Matrix]:
    """Return the shift (..., n) of the mean, the new covariance, and I + P H' W H; (..., n, n).

    W = diag(`weight`) (..., m); a weight of zero is a reading that was not made.
    """
    weighted = transposed(H) * weight[..., None, :]
    spread = np.eye(P.shape[-1]) + P @ (weighted @ H)
    covariance = symmetric(np.linalg.solve(spread, P))
    return apply(covariance, apply(weighted, innovation)), covariance, spread


def step(
    belief: Gaussian, z: Vector, *, sensor: Linear, motion: Motion, dt_s: float
) -> tuple[Gaussian, Info]:
    """Predict by `dt_s`, then condition on `z`; Wang (16)-(21)."""
    prior = predict(belief, motion.transition(dt_s), motion.noise(dt_s))
    updated = update(prior, z, sensor)
    return updated.posterior, Info(prior, updated)


def _judged(posterior: Gaussian, distance2: Vector, log_det: Vector, made: Vector) -> Update:
    count = made.sum(-1).astype(np.float64)
    log_likelihood = -0.5 * (distance2 + log_det + count * math.log(2 * math.pi))
    return Update(posterior, np.asarray(log_likelihood), np.asarray(distance2), count)
