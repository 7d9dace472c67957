"""What readings say to each particle: a mixture over clear, blocked and outlying paths."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.sensing.rssi import RssiColumns
from trackfield.types import Indices, Matrix, Vector

_HALF_LOG_TWO_PI = 0.5 * math.log(2.0 * math.pi)
_FAINTEST = -300.0  # of a log density: below, numbers get slow, and then 0
_LEAST = math.exp(2.0 * _FAINTEST)


class PathBelief(NamedTuple):
    """What is believed of the paths from m receivers to N particles.

    Shadows N(`shadow_db`, `shadow_var`) and probabilities `blocked`, (m, N) each.
    """

    shadow_db: Matrix
    shadow_var: Matrix
    blocked: Matrix


class HeardPaths(NamedTuple):
    """Paths that know the readings, and what these say of the particles."""

    path: PathBelief
    log_likelihood: Vector  # (N,) of all readings


def hear(
    models: RssiColumns, receivers: Indices, *, off_db: Matrix, sigma_db: Vector, path: PathBelief
) -> HeardPaths:
    """Condition on readings (m,) of different receivers, `off_db` (m, N) from law and survey.

    `sigma_db` (m,) is of the white noise. With S = var + sigma^2 the mixture is clear N(0, S),
    blocked N(-blocked_db, S + blocked_sigma_db^2) and outlying N(0, S + outlier_db^2), as in
    `rssi.log_density`; the shadow's posterior is moment-matched.
    """
    var, outlier = path.shadow_var, models.p_outlier[receivers, None]
    e = off_db - path.shadow_db
    S = var + np.square(sigma_db)[:, None]
    S_blocked = S + np.square(models.blocked_sigma_db[receivers, None])
    clear = _part(np.maximum(1.0 - path.blocked - outlier, 0.0), e, S)
    blocked = _part(path.blocked, e + models.blocked_db[receivers, None], S_blocked)
    parts = [clear, blocked]
    if outlier.any():
        parts.append(_part(outlier, e, S + np.square(models.outlier_db[receivers, None])))
    total = np.maximum(sum(part.density for part in parts), _LEAST)
    # Of a part the shadow goes by var d / v, to var - var^2 / v.
    pull = var / total
    step = pull * sum(part.first for part in parts)
    left = var + pull * var * sum(part.second for part in parts) - step * step
    log_likelihood = np.log(total).sum(axis=0) - _HALF_LOG_TWO_PI * receivers.size
    after = PathBelief(path.shadow_db + step, np.maximum(left, 0.0), blocked.density / total)
    return HeardPaths(after, log_likelihood)


def surprise(
    models: RssiColumns,
    receivers: Indices,
    *,
    off_db: Matrix,
    sigma_db: Vector,
    path: PathBelief,
    w: Vector,
) -> float:
    """Sum over readings (m,) of (z - mean)^2 / variance, as believed before by particles.

    Mean and variance are those of the whole mixture, over particles of probabilities `w` (N,).
    """
    e = off_db - path.shadow_db
    mean = e @ w
    spread = (np.square(e - mean[:, None]) + path.shadow_var) @ w + np.square(sigma_db)
    p, q = path.blocked @ w, models.p_outlier[receivers]
    down = models.blocked_db[receivers]
    spread += p * (np.square(models.blocked_sigma_db[receivers]) + (1.0 - p) * np.square(down))
    spread += q * np.square(models.outlier_db[receivers])
    return float((np.square(mean + p * down) / spread).sum())


class _Part(NamedTuple):
    """One part of the mixture: share times density f, f d / v and f (d^2 / v - 1) / v, (m, N)."""

    density: Matrix
    first: Matrix
    second: Matrix


def _part(share: Matrix, d: Matrix, v: Matrix) -> _Part:
    inverse = 1.0 / v
    square = d * d * inverse
    density = share * np.exp(np.maximum(-0.5 * square, _FAINTEST)) * np.sqrt(inverse)
    weighed = density * inverse
    return _Part(density, weighed * d, weighed * (square - 1.0))
