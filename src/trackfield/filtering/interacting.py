"""Interacting multiple models: a bank of filters, one for each way of moving. Blom, Bar-Shalom.

The modes are an axis: weights (..., M), means (..., M, n), covariances (..., M, n, n), with the
leading axes of `filtering.kalman` before it. All modes have the same state; see `StraightLeg`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.filtering import extended, kalman
from trackfield.filtering.matrices import symmetric, transposed
from trackfield.motion import CurvedMotion, Motion
from trackfield.types import Gaussian, Matrix, Vector

UpdateRule = Callable[[Gaussian, Vector], kalman.Update]


@dataclass(frozen=True, slots=True)
class Bank:
    """Ways of moving and how long each lasts: the mean time in mode j is `stay_s[j]`.

    A mode that is left is left for any other with equal chance; in a step of dt the chance to stay
    is exp(-dt/stay).
    """

    motions: tuple[Motion | CurvedMotion, ...]
    stay_s: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse banks whose parts do not fit."""
        if len(self.motions) != len(self.stay_s) or not self.motions:
            raise ConfigurationError(
                [f"{len(self.motions)} motions and {len(self.stay_s)} stays: expected as many"]
            )

    def switching(self, dt_s: float) -> Matrix:
        """Chances (M, M) to go from mode i to mode j in `dt_s`; rows sum to 1."""
        modes = len(self.motions)
        if modes == 1:
            return np.ones((1, 1))
        stay = np.exp(-dt_s / np.array(self.stay_s))
        chances = np.repeat(((1.0 - stay) / (modes - 1))[:, None], modes, axis=1)
        np.fill_diagonal(chances, stay)
        return chances


class Modes(NamedTuple):
    """Beliefs of a bank: `weights` (..., M) sum to 1; `beliefs` one Gaussian a mode."""

    weights: Vector
    beliefs: Gaussian


class Info(NamedTuple):
    """What a step leaves: the bank before the readings, and each mode's update (..., M)."""

    prior: Modes
    update: kalman.Update
    log_likelihood: Vector


def init(belief: Gaussian, weights: Sequence[float]) -> Modes:
    """Start every mode with the same belief and the given weight."""
    modes = len(weights)
    mean = np.repeat(belief.mean[..., None, :], modes, axis=-2)
    covariance = np.repeat(belief.covariance[..., None, :, :], modes, axis=-3)
    shares = np.array(weights, dtype=np.float64) / sum(weights)
    return Modes(np.broadcast_to(shares, mean.shape[:-1]).copy(), Gaussian(mean, covariance))


def mix(modes: Modes, switching: Matrix) -> Modes:
    """Let modes switch: each new mode begins with the moments of what may have led to it.

    The mean and covariance of the whole stay what they were.
    """
    joint = modes.weights[..., :, None] * switching  # from i to j
    weights = joint.sum(-2)
    share = transposed(joint / np.maximum(weights, 1e-300)[..., None, :])  # (..., j, i)
    means = share @ modes.beliefs.mean
    apart = modes.beliefs.mean[..., None, :, :] - means[..., :, None, :]  # (..., j, i, n)
    spread = np.einsum("...ji,...jia,...jib->...jab", share, apart, apart)
    inner = np.einsum("...ji,...iab->...jab", share, modes.beliefs.covariance)
    return Modes(weights, Gaussian(means, symmetric(inner + spread)))


def predict(modes: Modes, bank: Bank, *, dt_s: float) -> Modes:
    """Mix, then carry each mode's belief by its own motion."""
    mixed = mix(modes, bank.switching(dt_s))
    moved = [
        _moved(
            Gaussian(mixed.beliefs.mean[..., j, :], mixed.beliefs.covariance[..., j, :, :]), m, dt_s
        )
        for j, m in enumerate(bank.motions)
    ]
    mean = np.stack([g.mean for g in moved], axis=-2)
    covariance = np.stack([g.covariance for g in moved], axis=-3)
    return Modes(mixed.weights, Gaussian(mean, covariance))


def update(prior: Modes, z: Vector, rule: UpdateRule) -> tuple[Modes, Info]:
    """Condition every mode on `z` (..., m) by `rule`; weights by the modes' likelihoods.

    `rule(prior, z)` is any update that takes leading axes, such as `kalman.update` of a sensor.
    """
    updated = rule(
        prior.beliefs, np.broadcast_to(z[..., None, :], (*prior.weights.shape, z.shape[-1]))
    )
    with np.errstate(divide="ignore"):
        log_weights = np.log(prior.weights) + updated.log_likelihood
    top = log_weights.max(-1, keepdims=True)
    weights = np.exp(log_weights - top)
    total = weights.sum(-1, keepdims=True)
    log_likelihood = (top + np.log(total))[..., 0]
    posterior = Modes(weights / total, updated.posterior)
    return posterior, Info(prior, updated, log_likelihood)


def step(
    modes: Modes, z: Vector, *, rule: UpdateRule, bank: Bank, dt_s: float
) -> tuple[Modes, Info]:
    """Mix, predict by `dt_s`, update with `z`."""
    return update(predict(modes, bank, dt_s=dt_s), z, rule)


def combined(modes: Modes) -> Gaussian:
    """Return the moments of the whole: mean (..., n), covariance (..., n, n)."""
    whole = mix(modes, np.ones((modes.weights.shape[-1], 1)))
    return belief_of(whole, 0)


def belief_of(modes: Modes, mode: int) -> Gaussian:
    """Return one mode's belief: mean (..., n), covariance (..., n, n)."""
    mean, covariance = modes.beliefs
    return Gaussian(mean[..., mode, :], covariance[..., mode, :, :])


def _moved(belief: Gaussian, motion: Motion | CurvedMotion, dt_s: float) -> Gaussian:
    if isinstance(motion, CurvedMotion):
        return extended.predict(belief, motion, dt_s=dt_s)
    return kalman.predict(belief, motion.transition(dt_s), motion.noise(dt_s))
