"""Draws of signal strength: shadows that lie over the plane, bodies in the way, outliers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.sensing.rssi import RssiModels, distance, expected
from trackfield.types import Matrix, Vector

_WAVES = 256  # of which a shadow is made


class Shadows(NamedTuple):
    """Each receiver's shadow over the plane, a sum of waves; made by `draw_shadows`.

    Wave k of receiver i has the wave vector `wave` (n, k, 2) [1/m] and the amplitudes `cosine` and
    `sine` (n, k) [dB].
    """

    wave: NDArray[np.float64]
    cosine: Matrix
    sine: Matrix


class SimulatedRssi(NamedTuple):
    """What the receivers measured along a path, (..., steps, n) each.

    `value` [dBm] is what a receiver would have read, heard or not; `heard` says where it was strong
    and near enough; `blocked` where something stood in the way.
    """

    value: Matrix
    heard: NDArray[np.bool_]
    blocked: NDArray[np.bool_]


def draw_shadows(models: RssiModels, *, sensors: int, rng: np.random.Generator) -> Shadows:
    """Draw the shadows of n `sensors`, each N(0, shadow_db^2), E[s s'] = shadow_db^2 exp(-d/l).

    The waves are drawn from the spectrum of that covariance, a bivariate Cauchy of scale 1 / l, so
    that it holds exactly in the mean over draws; l is `shadow_m`.
    """
    length = np.broadcast_to(np.maximum(models.shadow_m, 1e-9), (sensors,))
    normal = rng.standard_normal((sensors, _WAVES, 2))
    scale = np.abs(rng.standard_normal((sensors, _WAVES, 1)))
    wave = normal / np.maximum(scale, 1e-9) / length[:, None, None]
    size = np.broadcast_to(models.shadow_db, (sensors,))[:, None] / np.sqrt(_WAVES)
    cosine, sine = (size * rng.standard_normal((sensors, _WAVES)) for _ in range(2))
    return Shadows(wave, cosine, sine)


def shadow_at(shadows: Shadows, positions: Matrix) -> Matrix:
    """Shadow (..., n) [dB] of each receiver at `positions` (..., d) [m]; heights do not matter."""
    plane = positions[..., :2]
    found = np.zeros((*plane.shape[:-1], len(shadows.wave)))
    for i, (wave, cosine, sine) in enumerate(zip(*shadows, strict=True)):
        phase = plane @ wave.T
        found[..., i] = np.cos(phase) @ cosine + np.sin(phase) @ sine
    return found


def simulate(
    models: RssiModels,
    sensors: Matrix,
    *,
    path: Matrix,
    t_s: Vector,
    rng: np.random.Generator,
    shadows: Shadows | None = None,
) -> SimulatedRssi:
    """Draw what `sensors` (n, d) read of a beacon on `path` (..., steps, d) at `t_s` (steps,).

    The receivers keep their `shadows` (drawn if not given) over all leading axes; each leading
    index is a run of its own otherwise. A gap of some seconds between steps is one in which bodies
    come and go.
    """
    if t_s.shape != path.shape[-2:-1] or np.any(np.diff(t_s) < 0.0):
        raise InputError(
            f"times of shape {t_s.shape} for a path of shape {path.shape}: expected (steps,), "
            "in order, and (..., steps, d)"
        )
    r = distance(sensors, path)
    z = expected(models, r) + models.sigma_db * rng.standard_normal(r.shape)
    if np.any(np.asarray(models.shadow_db) > 0.0):
        cast = draw_shadows(models, sensors=len(sensors), rng=rng) if shadows is None else shadows
        z = z + shadow_at(cast, path)
    loss, blocked = _blocks(models, t_s, shape=r.shape, rng=rng)
    outlier = rng.random(r.shape) < models.p_outlier
    z = z - loss + outlier * models.outlier_db * rng.standard_normal(r.shape)
    return SimulatedRssi(z, (z >= models.min_dbm) & (r <= models.max_range_m), blocked)


def _blocks(
    models: RssiModels, t_s: Vector, *, shape: tuple[int, ...], rng: np.random.Generator
) -> tuple[Matrix, NDArray[np.bool_]]:
    """Loss (..., steps, n) [dB] of what stands in the way, and where something does.

    A process in two states that forgets at a rate 1 / (burst_s (1 - p)): it is blocked with
    probability p whenever it is looked at, and for burst_s at a time.
    """
    p = np.asarray(models.p_blocked)
    blocked = rng.random(shape) < p
    loss = models.blocked_db + models.blocked_sigma_db * rng.standard_normal(shape)
    lasting = np.maximum(models.burst_s * (1.0 - p), 1e-12)
    kept = rng.random(shape) < np.exp(-np.diff(t_s, prepend=-np.inf)[:, None] / lasting)
    for k in range(1, shape[-2]):
        stays = kept[..., k, :]
        blocked[..., k, :] = np.where(stays, blocked[..., k - 1, :], blocked[..., k, :])
        loss[..., k, :] = np.where(stays, loss[..., k - 1, :], loss[..., k, :])
    return np.where(blocked, loss, 0.0), blocked
