"""What ranges and silences leave of a belief, by a grid: exact where tangents are not.

A sensor that should have heard the target and did not says that the target is elsewhere; ranges to
two sensors leave two places. Neither is a matter of tangents. The position is weighed on a grid,
under a prior with heavy tails, since such readings come when the prior was wrong; the moments are
the new belief. If two places remain, its covariance spans both: it is wide, not wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.linalg import square_root
from trackfield.raster import Region
from trackfield.sensing.range import RangeModel, distance, expected, variance
from trackfield.types import Gaussian, Matrix, Vector

_CELLS, _SIGMAS = 61, 3.0  # a side of the grid, and half of it in standard deviations of the tails
_GROSS = 15.0  # -log of the likelihood of a reading that fits nowhere, at most
_OUTSIDE = -20.0  # log of the weight of places outside of the field


class Doubt(NamedTuple):
    """How wrong a belief may be: with probability `share` it is `wider` times as wide (variance).

    The tails are never wider than `limit_m` (standard deviation over all axes). `deaf` is the
    probability that a sensor within range hears nothing all the same.
    """

    share: float = 0.1
    wider: float = 16.0
    limit_m: float = 4.0
    deaf: float = 0.02


class Answers(NamedTuple):
    """Ranges `z` (m,) [m] from `sensors` (m, 2) [m], and the `silent` ones (k, 2) [m]."""

    sensors: Matrix
    z: Vector
    silent: Matrix


def update(
    prior: Gaussian,
    heard: Answers,
    *,
    models: RangeModel,
    doubt: Doubt = Doubt(),  # noqa: B008 (immutable)
    field: Region | None = None,
) -> Gaussian:
    """Moments of p ~ (1 - e) N(m, P) + e N(m, wider P) given ranges and silences, on a grid.

    A silent sensor rules out its disc of radius `max_range_m`, but for `deaf`; so does the outside
    of a `field`. What else is in the state (n >= 2) follows the position as the prior has it. One
    belief in the plane.
    """
    P = prior.covariance[:2, :2]
    tails = max(1.0, min(doubt.wider, doubt.limit_m**2 / float(np.trace(P))))
    root = square_root(tails * P)
    steps: Vector = np.linspace(-_SIGMAS, _SIGMAS, _CELLS)
    unit = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = prior.mean[:2] + unit @ root.T
    r2 = (unit**2).sum(axis=1)
    log_weight = np.logaddexp(
        np.log(1.0 - doubt.share) - 0.5 * tails * r2 + np.log(tails),
        np.log(doubt.share) - 0.5 * r2,
    )
    if field is not None:
        log_weight = log_weight + np.where(field.contains(places), 0.0, _OUTSIDE)
    log_weight = log_weight + _log_likelihood(places, heard, models, doubt)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    centre = weight @ places
    spread = (weight[:, None] * (places - centre)).T @ (places - centre)
    cell = root * (steps[1] - steps[0])
    return _carried(prior, centre, spread + cell @ cell.T / 12.0)


def _log_likelihood(places: Matrix, heard: Answers, models: RangeModel, doubt: Doubt) -> Vector:
    r = distance(heard.sensors, places)
    misfit2 = (heard.z - expected(models, r)) ** 2 / variance(models, r)
    inside = distance(heard.silent, places) <= models.max_range_m
    silence = np.where(inside, np.log(doubt.deaf), 0.0).sum(axis=1)
    return silence - np.minimum(0.5 * misfit2, _GROSS).sum(axis=1)


def _carried(prior: Gaussian, centre: Vector, spread: Matrix) -> Gaussian:
    """Let the rest of the state follow the position by the prior's regression on it.

    Where the position turned out less known than was believed, so is the rest, in proportion.
    """
    mean, C = prior
    P = C[:2, :2]
    K = np.linalg.solve(P, C[:2, 2:]).T
    worse = max(1.0, float(np.trace(spread) / np.trace(P)))
    rest = min(worse, 4.0) * (C[2:, 2:] - K @ P @ K.T)
    moved = np.concatenate([centre, mean[2:] + K @ (centre - mean[:2])])
    covariance = np.empty_like(C)
    covariance[:2, :2] = spread
    covariance[2:, :2] = K @ spread
    covariance[:2, 2:] = covariance[2:, :2].T
    covariance[2:, 2:] = rest + K @ spread @ K.T
    return Gaussian(moved, covariance)
