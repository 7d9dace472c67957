"""The unscented Kalman filter: curved functions carried by sigma points, Julier and Uhlmann.

All functions take leading axes, like `filtering.kalman`; a reading that is NaN was not made.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackfield.filtering import kalman
from trackfield.filtering.extended import Sensor
from trackfield.filtering.matrices import apply, symmetric, transposed
from trackfield.linalg import square_root
from trackfield.motion import CurvedMotion
from trackfield.types import Gaussian, Matrix, Vector


class Spread(NamedTuple):
    """How far the 2n + 1 sigma points stand apart: the scaled transform.

    The points lie at mean +- sqrt(lambda + n) columns of the Cholesky root, lambda =
    alpha^2 (n + kappa) - n; beta = 2 suits Gaussian beliefs.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0


class Points(NamedTuple):
    """Sigma points (..., 2n + 1, n) and their weights (2n + 1,) for means and for covariances."""

    at: Matrix
    for_mean: Vector
    for_covariance: Vector


def sigma_points(belief: Gaussian, *, spread: Spread = Spread()) -> Points:  # noqa: B008 (immutable)
    """Choose points whose weighted mean and covariance are those of `belief`."""
    n = belief.mean.shape[-1]
    reach = spread.alpha**2 * (n + spread.kappa)
    offsets = transposed(square_root(reach * belief.covariance))
    centre = belief.mean[..., None, :]
    at = np.concatenate([centre, centre + offsets, centre - offsets], axis=-2)
    weights = np.full(2 * n + 1, 0.5 / reach)
    weights[0] = 1.0 - n / reach
    for_covariance = weights.copy()
    for_covariance[0] += 1.0 - spread.alpha**2 + spread.beta
    return Points(at, weights, for_covariance)


def transform(
    belief: Gaussian,
    function: Callable[[Vector], Vector],
    *,
    spread: Spread = Spread(),  # noqa: B008 (immutable)
) -> tuple[Gaussian, Matrix]:
    """Moments of y = f(x): N(mean, covariance) of y (..., m), and cov(x, y) (..., n, m)."""
    points = sigma_points(belief, spread=spread)
    y = function(points.at)
    mean = (points.for_mean[:, None] * y).sum(-2)
    dy = y - mean[..., None, :]
    dx = points.at - belief.mean[..., None, :]
    weighted = points.for_covariance[:, None] * dy
    return Gaussian(mean, transposed(dy) @ weighted), transposed(dx) @ weighted


def predict(
    belief: Gaussian,
    motion: CurvedMotion,
    *,
    dt_s: float,
    spread: Spread = Spread(),  # noqa: B008 (immutable)
) -> Gaussian:
    """Carry a belief through a curved motion by `dt_s`."""
    moved, _ = transform(belief, lambda x: motion.move(x, dt_s), spread=spread)
    return Gaussian(moved.mean, symmetric(moved.covariance + motion.noise(dt_s)))


def update(
    prior: Gaussian,
    z: Vector,
    sensor: Sensor,
    *,
    spread: Spread = Spread(),  # noqa: B008 (immutable)
) -> kalman.Update:
    """Condition on z = h(x) + v, with the moments of h(x) by sigma points.

    The readings are regressed on the state, which is a linear reading of the same moments: noise
    is what the sensor has and what the slope cannot explain.
    """
    expected, cross = transform(prior, sensor.predict, spread=spread)
    H = transposed(np.linalg.solve(prior.covariance, cross))
    unexplained = symmetric(expected.covariance - H @ prior.covariance @ transposed(H))
    made = ~np.isnan(z)
    noise = np.where(made, sensor.variance(np.where(made, z, 0.0)), 1.0)
    R = unexplained + noise[..., None] * np.eye(z.shape[-1])
    linear = kalman.Linear(H, R)
    return kalman.update(prior, z - expected.mean + apply(H, prior.mean), linear)


def step(
    belief: Gaussian, z: Vector, *, sensor: Sensor, motion: CurvedMotion, dt_s: float
) -> tuple[Gaussian, kalman.Info]:
    """Predict by `dt_s`, then `update`."""
    prior = predict(belief, motion, dt_s=dt_s)
    updated = update(prior, z, sensor)
    return updated.posterior, kalman.Info(prior, updated)
