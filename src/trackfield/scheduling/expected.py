"""Selection for a target that is somewhere: expected over where the prediction says it may be.

The sensors that are best for the predicted place may not hear the target where it really is. So the
criterion is taken at many places of the predicted distribution and averaged; a sensor that is out
of range at a place has a row of zeros there, as `localization.information` gives it.

What is averaged is what will be left: the trace of (P_0 + sum g g')^-1 at each place, whose mean is
the mean squared error to expect. Averaging the information instead, tr (P_0 + mean sum g g')^-1, is
the posterior Cramer-Rao bound. It is less always (Jensen), and blind to the edge of the range: a
sensor that is heard half of the time counts as half a sensor that is always heard, and a target
that is found or lost as one that is half known. `Expected.pooled` tells it, for comparison.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield._core import _selection
from trackfield.errors import InputError
from trackfield.linalg import cholesky, square_root
from trackfield.scheduling.criteria import (
    FINE,
    Criterion,
    checked,
    checked_number,
    checked_prior,
    criterion_code,
)
from trackfield.scheduling.selection import ENUMERATED
from trackfield.types import Gaussian, Indices, Matrix, Vector


class Places(NamedTuple):
    """Where a target may be: places `at` (s, d) [m] with probabilities `weights` (s,)."""

    at: Matrix
    weights: Vector


class Expected(NamedTuple):
    """Sensors selected for all places, and what is to be expected of them.

    `sensors` (k,) are rows of the gains, ascending; `value` is the mean of the criterion over the
    places, `pooled` the criterion of the mean information, which is never worse; `silent` the
    probability that none of the sensors hears the target; `optimal` says that all sets were
    compared, otherwise single sensors were exchanged until that did not help.
    """

    sensors: Indices
    value: float
    pooled: float
    silent: float
    optimal: bool


def places(belief: Gaussian, *, order: int = 5) -> Places:
    """Places that stand for a Gaussian: the grid of order^d nodes of Gauss-Hermite quadrature.

    Means of polynomials of degree 2 order - 1 are exact; at the edge of a range the more the
    better. `InputError` for an order outside 1 to 20.
    """
    if not 1 <= order <= 20:
        raise InputError(f"order: found {order}, expected 1 to 20")
    d = belief.mean.size
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    grid = np.stack(np.meshgrid(*[nodes] * d, indexing="ij"), axis=-1).reshape(-1, d)
    products = np.stack(np.meshgrid(*[weights / weights.sum()] * d), axis=-1).reshape(-1, d)
    return Places(belief.mean + grid @ square_root(belief.covariance).T, products.prod(axis=1))


def hearings(gains: Matrix, probability: Matrix, *, draws: int, rng: np.random.Generator) -> Matrix:
    """Draw who hears: gains (s draws, n, d), each sensor's row kept with its `probability` (s, n).

    For ranges whose edge is soft, and readings that are lost on their way. Draws of a place follow
    each other, so that its weight is `np.repeat(weights / draws, draws)`. `InputError` for
    probabilities outside 0 to 1.
    """
    p = np.broadcast_to(np.asarray(probability, float), gains.shape[:2])
    if not ((p >= 0.0) & (p <= 1.0)).all():
        raise InputError("probability to hear: found one that is not from 0 to 1")
    kept = rng.random((len(gains), draws, gains.shape[1])) < p[:, None]
    return np.where(kept[..., None], gains[:, None], 0.0).reshape(-1, *gains.shape[1:])


def select_expected(
    gains: Matrix, k: int, *, weights: Vector, prior: Matrix, criterion: Criterion = "A"
) -> Expected:
    """Select k of n sensors for a target at one of s places: least mean trace (or best D, E).

    `gains` (s, n, d) at each place, `weights` (s,) the probabilities of the places (scaled to sum
    to 1), `prior` (d, d) the information of the prediction itself: positive definite, for where
    nobody hears it is all there is. Where n < k all are taken.

    Up to `selection.ENUMERATED` sets are all compared; otherwise greedy and exchanges, O(s n k) a
    round. Raises `InputError` for other shapes, values that are not finite, negative weights.
    """
    g, w, p = _checked(gains, weights, prior)
    code = criterion_code(criterion)
    k = min(checked_number(k), g.shape[1])
    few = math.comb(g.shape[1], k) <= ENUMERATED
    sensors = np.arange(k, dtype=np.int32)
    if 0 < k < g.shape[1]:
        search = _selection.enumerated if few else _selection.exchanged
        sensors = np.sort(search(g, np.tile(p, (len(g), 1, 1)), w, k, code, FINE))
    chosen = g[:, sensors]
    silent = float(w @ (chosen == 0.0).all(axis=(1, 2)))
    value, pooled = expected_values(chosen, weights=w, prior=p, criterion=criterion)
    return Expected(sensors, value, pooled, silent, few)


def expected_values(
    gains: Matrix, *, weights: Vector, prior: Matrix, criterion: Criterion = "A"
) -> tuple[float, float]:
    """Mean of the criterion over places, and the criterion of the mean information.

    `gains` (s, k, d) of the sensors that will read; the rest as in `select_expected`.
    """
    g, w, p = _checked(gains, weights, prior)
    criterion_code(criterion)
    informations = p + np.swapaxes(g, 1, 2) @ g
    pooled = np.tensordot(w, informations, axes=1)
    values = _values(np.concatenate([informations, pooled[None]]), criterion)
    return float(w @ values[:-1]), float(values[-1])


def _values(informations: Matrix, criterion: Criterion) -> Vector:
    roots = np.linalg.eigvalsh(informations)
    if criterion == "A":
        return np.asarray((1.0 / roots).sum(axis=-1), np.float64)
    return np.asarray(np.log(roots).sum(axis=-1) if criterion == "D" else roots[..., 0], np.float64)


def _checked(gains: Matrix, weights: Vector, prior: Matrix) -> tuple[Matrix, Vector, Matrix]:
    g = np.ascontiguousarray(gains, float)
    w = np.ascontiguousarray(weights, float)
    if g.ndim != 3 or w.shape != g.shape[:1] or not len(w):
        raise InputError(
            f"gains of shape {g.shape} and weights of shape {w.shape}: expected (s, n, d) and (s,)"
        )
    checked(g.reshape(-1, g.shape[2]), None)
    if not (np.isfinite(w).all() and (w >= 0.0).all() and w.sum() > 0.0):
        raise InputError("weights: expected probabilities, at least 0 and not all 0")
    p = checked_prior(prior, g.shape[2])
    if not cholesky(p).ok:
        raise InputError(f"prior: found {p.tolist()}, expected positive definite information")
    return g, w / w.sum(), p
