"""What readings say to each particle: a mixture over clear, blocked and outlying paths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.sensing.rssi import RssiColumns
from trackfield.types import Indices, Matrix, Vector


class Path(NamedTuple):
    """What is believed of the paths from m receivers to N particles.

    Shadows N(`shadow_db`, `shadow_var`) and probabilities `blocked`, (m, N) each.
    """

    shadow_db: Matrix
    shadow_var: Matrix
    blocked: Matrix


class Heard(NamedTuple):
    """Paths that know the readings, and what these say of the particles."""

    path: Path
    log_likelihood: Vector  # (N,) of all readings


def hear(
    models: RssiColumns, receivers: Indices, *, off_db: Matrix, sigma_db: Vector, path: Path
) -> Heard:
    """Condition on readings (m,) of different receivers, `off_db` (m, N) from law and survey.

    `sigma_db` (m,) is of the white noise. With S = var + sigma^2 the mixture is clear N(0, S),
    blocked N(-blocked_db, S + blocked_sigma_db^2) and outlying N(0, S + outlier_db^2), as in
    `rssi.log_density`; the shadow's posterior is moment-matched.
    """
    var = path.shadow_var
    e = off_db - path.shadow_db
    S = var + np.square(sigma_db)[:, None]
    outlier = models.p_outlier[receivers, None]
    shares = [np.maximum(1.0 - path.blocked - outlier, 0.0), path.blocked]
    moves, spreads = (
        [e, e + models.blocked_db[receivers, None]],
        [
            S,
            S + np.square(models.blocked_sigma_db[receivers, None]),
        ],
    )
    if outlier.any():
        shares.append(np.broadcast_to(outlier, e.shape))
        moves.append(e)
        spreads.append(S + np.square(models.outlier_db[receivers, None]))
    densities = [
        share * np.exp(-0.5 * d * d / v) / np.sqrt(v)
        for share, d, v in zip(shares, moves, spreads, strict=True)
    ]
    total = np.maximum(sum(densities[1:], densities[0]), np.finfo(np.float64).tiny)
    step, left = np.zeros_like(e), var.copy()
    for density, d, v in zip(densities, moves, spreads, strict=True):
        gain = var / v
        own = gain * d
        p = density / total
        step += p * own
        left += p * (own * own - gain * var)
    left = np.maximum(left - step * step, 0.0)
    log_likelihood = (np.log(total) - 0.5 * np.log(2.0 * np.pi)).sum(axis=0)
    return Heard(Path(path.shadow_db + step, left, densities[1] / total), log_likelihood)


def surprise(
    models: RssiColumns,
    receivers: Indices,
    *,
    off_db: Matrix,
    sigma_db: Vector,
    path: Path,
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
