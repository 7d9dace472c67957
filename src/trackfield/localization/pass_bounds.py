"""How well a pass can be known at best: Cramer-Rao bounds of all samples, and of messages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.linalg import UNKNOWN_VARIANCE
from trackfield.sensing.amplitude import CORE_M, AmplitudeModels, for_samples, strength
from trackfield.sensing.amplitude_likelihood import sample_information
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import information
from trackfield.types import Matrix, Vector


class PassBound(NamedTuple):
    """Least covariance (5, 5) of an unbiased theta = [P, x0, y0, vx, vy], (6, 6) with the exponent.

    `determined` is false where a direction is free; its variance is huge there.
    """

    covariance: Matrix
    determined: bool


def pass_information(
    theta: Vector,
    sensors: Matrix,
    t_s: Vector,
    *,
    models: AmplitudeModels,
    unknown_exponent: bool = False,
) -> Matrix:
    """Fisher information about `theta` (5,) in samples of `sensors` (n, 2) at `t_s` (m,) or (n, m).

    Berger (5), (40): sum of w(a) grad a grad a', w = 1/sigma^2 or (2 a / (N0 + a^2))^2. (5, 5), or
    (6, 6) with the exponent.
    """
    theta = np.asarray(theta, float)
    if theta.shape != (5,) or np.ndim(sensors) != 2 or np.shape(sensors)[1] != 2:
        raise InputError(
            f"theta of shape {theta.shape} and sensors of shape {np.shape(sensors)}: "
            "expected (5,) and (n, 2)"
        )
    per_sample = for_samples(models)
    alpha = np.asarray(per_sample.exponent, float)
    t = np.broadcast_to(np.asarray(t_s, float), (len(sensors), np.shape(t_s)[-1]))
    offset = theta[1:3] + t[..., None] * theta[3:5] - sensors[:, None, :]
    r = np.maximum(np.linalg.norm(offset, axis=-1), CORE_M)
    a = strength(per_sample, r, power=theta[0])
    toward = (-alpha * a / r**2)[..., None] * offset
    parts = [(0.5 * a / theta[0])[..., None], toward, t[..., None] * toward]
    if unknown_exponent:
        parts.append((-a * np.log(r))[..., None])
    G = np.concatenate(parts, axis=-1)
    weighted = sample_information(per_sample, a)[..., None] * G
    return np.einsum("kmi,kmj->ij", weighted, G)


def pass_bound(
    theta: Vector,
    sensors: Matrix,
    t_s: Vector,
    *,
    models: AmplitudeModels,
    unknown_exponent: bool = False,
) -> PassBound:
    """Cramer-Rao bound of `theta` from all samples, see `pass_information`; Berger (5), (40)."""
    return _inverse(
        pass_information(theta, sensors, t_s, models=models, unknown_exponent=unknown_exponent)
    )


def message_bound(
    theta: Vector,
    sensors: Matrix,
    t_s: Vector,
    *,
    models: AmplitudeModels,
    added: Matrix | None = None,
) -> PassBound:
    """Cramer-Rao bound of `theta` (5,) from messages that meet their own bound (16), (42).

    J = sum G_k' (J_k^-1 + A_k)^-1 G_k, G_k the slope of the three numbers in theta. A pass shows in
    a record through these three numbers only, so without `added` errors A (n, 3, 3), of an encoding
    say, this is `pass_bound`: to first order a message loses nothing.
    """
    theta, sensors = np.asarray(theta, float), np.asarray(sensors, float)
    alpha = np.asarray(models.exponent, float)
    J = information(predict(theta, sensors, exponent=alpha), np.asarray(t_s, float), models)
    told = J if added is None else J @ np.linalg.inv(np.eye(3) + added @ J)
    G = message_slopes(theta, sensors, exponent=alpha)
    return _inverse(np.einsum("kia,kij,kjb->ab", G, told, G))


def message_slopes(theta: Vector, sensors: Matrix, *, exponent: float | Vector = 1.0) -> Matrix:
    """Slope (n, 3, 5) of `pass_profile.predict` in `theta` (5,), Berger (19), corrected."""
    psi = predict(theta, sensors, exponent=exponent).array()
    v = theta[3:5]
    speed2 = float(v @ v)
    if not speed2 > 0.0:
        raise InputError("a target at rest has no closest approach to speak of")
    across = np.array([-v[1], v[0]])
    offset = theta[1:3] - sensors
    h = offset @ across
    d_v = np.column_stack([offset[:, 1], -offset[:, 0]])  # slope of h in v
    h = np.where(np.abs(h) > 0.0, h, np.finfo(float).tiny)
    G = np.zeros((len(sensors), 3, 5))
    # log d = log |h| - log |v|
    log_d = np.concatenate([across / h[:, None], d_v / h[:, None] - v / speed2], axis=1)
    G[:, 0, 0] = 0.5 * psi[:, 0] / theta[0]
    G[:, 0, 1:] = -np.broadcast_to(exponent, h.shape)[:, None] * psi[:, :1] * log_d
    G[:, 1, 1:3] = -v / speed2
    G[:, 1, 3:] = (-offset - 2.0 * psi[:, 1:2] * v) / speed2
    G[:, 2, 1:] = psi[:, 2:] * log_d
    G[:, 2, 3:] -= psi[:, 2:] * v / speed2
    return G


def _inverse(J: Matrix) -> PassBound:
    """Invert information whose entries have different units: scaled first."""
    size = np.sqrt(np.diag(J))
    unit = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), np.sqrt(UNKNOWN_VARIANCE))
    roots, axes = np.linalg.eigh(J * np.outer(unit, unit))
    determined = bool(roots[0] > 1e-13)
    inverse = (axes / np.maximum(roots, 1e-13)) @ axes.T
    return PassBound(inverse * np.outer(unit, unit), determined)
