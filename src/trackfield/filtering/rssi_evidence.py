"""What readings say to each particle: a mixture over clear, blocked and outlying paths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.sensing.rssi import RssiColumns
from trackfield.types import Indices, Matrix, Vector


class Heard(NamedTuple):
    """Shadows (m, N) that know the readings, and what these say of the particles."""

    shadow_db: Matrix
    shadow_var: Matrix
    log_likelihood: Vector  # (N,) of all readings


def hear(
    models: RssiColumns,
    receivers: Indices,
    *,
    off_db: Matrix,
    sigma_db: Vector,
    shadow: tuple[Matrix, Matrix],
) -> Heard:
    """Condition on readings (m,) of different receivers, `off_db` (m, N) from what was expected.

    What was expected does not hold the shadow, of mean and variance `shadow` (m, N); `sigma_db`
    (m,) is of the white noise. With S = var + sigma^2 the mixture is clear N(0, S), blocked
    N(-blocked_db, S + blocked_sigma_db^2) and outlying N(0, S + outlier_db^2), as in
    `rssi.log_density`; its posterior is moment-matched.
    """
    mean, var = shadow
    e = off_db - mean
    S = var + np.square(sigma_db)[:, None]
    parts = _parts(models, receivers)
    densities: list[Matrix] = []
    gains: list[Matrix] = []
    steps: list[Matrix] = []
    for share, shift, more in parts:
        v = S + np.square(more)[:, None]
        d = e - shift[:, None]
        gain = var / v
        densities.append(share[:, None] * np.exp(-0.5 * d * d / v) / np.sqrt(v))
        gains.append(gain)
        steps.append(gain * d)
    total = sum(densities[1:], densities[0])
    total = np.maximum(total, np.finfo(np.float64).tiny)
    p = [density / total for density in densities]
    step = sum((q * s for q, s in zip(p, steps, strict=True)), np.zeros_like(e))
    left = var.copy() if var.shape == e.shape else np.broadcast_to(var, e.shape).copy()
    for q, gain, own in zip(p, gains, steps, strict=True):
        left += q * (np.square(own - step) - gain * var)
    log_likelihood = (np.log(total) - 0.5 * np.log(2.0 * np.pi)).sum(axis=0)
    return Heard(mean + step, np.maximum(left, 0.0), log_likelihood)


def _parts(models: RssiColumns, receivers: Indices) -> list[tuple[Vector, Vector, Vector]]:
    """Share, shift and further sigma (m,) of each part that any of the readings may come from."""
    blocked, outlier = models.p_blocked[receivers], models.p_outlier[receivers]
    none = np.zeros(receivers.size)
    parts = [(np.maximum(1.0 - blocked - outlier, 0.0), none, none)]
    if np.any(blocked > 0.0):
        parts.append((blocked, -models.blocked_db[receivers], models.blocked_sigma_db[receivers]))
    if np.any(outlier > 0.0):
        parts.append((outlier, none, models.outlier_db[receivers]))
    return parts
