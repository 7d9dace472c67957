"""How far points are from the ellipsoids in which targets are believed to be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import gate
from trackfield.types import Matrix, Vector

_ITERATIONS = 30
"""Of Newton's method, which needs about six; all points go on until the last one is done."""

_POINT = 1e-30  # [m^2] a variance that is none: what has it is known


def ellipsoid_gate(covariances: Matrix, probability: float) -> float:
    """Gate within which Gaussians of `covariances` (..., d, d) lie with `probability`.

    `InputError` where the probability is not between 0 and 1, or a covariance is no number.
    """
    if not 0.0 < probability < 1.0:
        raise InputError(f"found a probability of {probability:g}, expected one between 0 and 1")
    if not np.isfinite(covariances).all():
        raise InputError("found a covariance that is no number, expected finite ones")
    return float(gate(probability, int(covariances.shape[-1])))


def ellipsoid_reach(covariances: Matrix, limit: float) -> Vector:
    """Half of the longest axis (...) [m] of {e: e' P^-1 e <= limit}, covariances P (..., d, d)."""
    return np.sqrt(limit * np.maximum(np.linalg.eigvalsh(covariances)[..., -1], 0.0))


def distance_to_ellipsoid(
    offsets: Matrix, covariances: Matrix, limit: float, *, which: NDArray[np.integer[Any]]
) -> Vector:
    """Distance (m,) [m] of points to the ellipsoids {e: e' P^-1 e <= limit}, 0 within them.

    `offsets` (m, d) [m] lead to the points from the centre of ellipsoid `which` (m,) of
    `covariances` (k, d, d) [m^2], which may be singular. The nearest point has coordinates
    y_j l_j / (l_j + t) in the axes of P, where t >= 0 solves sum y_j^2 l_j / (l_j + t)^2 = limit:
    Newton's method on the reciprocal root of the left side, which is nearly linear in t, climbs to
    the solution from t = 0 and never passes it.
    """
    lengths, axes = np.linalg.eigh(covariances)
    lengths = np.maximum(lengths, np.maximum(1e-14 * lengths[:, -1:], _POINT))
    y = np.einsum("mdj,md->mj", axes[which], offsets)
    distance = np.zeros(len(y))
    outside = np.flatnonzero((y**2 / lengths[which]).sum(axis=-1) > limit)
    distance[outside] = _to_surface(y[outside], lengths[which[outside]], limit)
    return distance


def _to_surface(y: Matrix, lengths: Matrix, limit: float) -> Vector:
    """Distances (m,) from points outside with coordinates y (m, d) in the axes of ellipsoids."""
    t = np.zeros(len(y))
    for _ in range(_ITERATIONS):
        wide = lengths + t[:, None]
        weight = y**2 * lengths / wide**2
        total = weight.sum(axis=-1)
        slope = (weight / wide).sum(axis=-1)
        step = np.maximum(total / slope * (np.sqrt(total / limit) - 1.0), 0.0)
        t += step
        if not (step > 1e-12 * t).any():
            break
    return np.linalg.norm(y * t[:, None] / (lengths + t[:, None]), axis=-1)
