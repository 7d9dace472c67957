"""The energy profile of one pass, as one sensor sees it: three numbers, Berger (11)-(17)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.amplitude import AmplitudeModels, for_samples
from trackfield.sensing.amplitude_likelihood import misfit, sample_information
from trackfield.types import Matrix, Vector


class Profile(NamedTuple):
    """Amplitude of a target that passes straight: a = a_max (1 + c tau^2)^(-alpha/2), Berger (11).

    tau = (t - t_max_s) / width_s, c = `steepness(alpha)`: `a_max` at the closest approach, at the
    time `t_max_s`; half of it `width_s` before and after (6 dB). All (...), numbers for one pass.
    """

    a_max: float | Vector
    t_max_s: float | Vector
    width_s: float | Vector

    def array(self) -> Vector:
        """Return the three numbers as a last axis, (..., 3): Berger's psi."""
        return np.stack(np.broadcast_arrays(*self), axis=-1).astype(float)


def profile_of(numbers: Vector) -> Profile:
    """Profiles (...) of psi (..., 3), as `Profile.array` gives it."""
    return Profile(numbers[..., 0], numbers[..., 1], numbers[..., 2])


def steepness(exponent: float | Vector) -> Vector:
    """Give c = 2^(2/exponent) - 1, which puts half the amplitude at the width; 3 in free space."""
    return np.exp2(2.0 / np.asarray(exponent, float)) - 1.0


def expected(profile: Profile, t_s: Matrix, *, exponent: float | Vector = 1.0) -> Matrix:
    """Amplitudes (..., m) of profiles (...) at times `t_s` (m,) or (..., m), Berger (11)."""
    a, _, falloff = _shape(profile, t_s, exponent)
    return a * falloff


def gradient(profile: Profile, t_s: Matrix, *, exponent: float | Vector = 1.0) -> Matrix:
    """Slope (..., m, 3) of `expected` in (a_max, t_max_s, width_s), Berger (17)."""
    return _slopes(profile, t_s, exponent)[1]


def information(profile: Profile, t_s: Matrix, models: AmplitudeModels) -> Matrix:
    """Fisher information (..., 3, 3) about the three numbers in samples at `t_s`.

    `t_s` (m,) or (..., m); Berger (16), (42). Columns of `models` are one for each profile.
    """
    mean, G = _slopes(profile, t_s, models.exponent)
    weight = sample_information(for_samples(models), mean)
    return np.swapaxes(G, -1, -2) @ (weight[..., None] * G)


def negative_log_likelihood(
    profile: Profile, t_s: Matrix, values: Matrix, *, models: AmplitudeModels
) -> Vector:
    """Negative log-likelihood (...) of samples `values` (..., m) at `t_s`, Berger (15), (38)."""
    if np.shape(t_s)[-1:] != values.shape[-1:]:
        raise InputError(f"{np.shape(t_s)[-1:]} times for {values.shape[-1:]} samples")
    mean = expected(profile, t_s, exponent=models.exponent)
    return misfit(for_samples(models), values, mean=mean).cost.sum(axis=-1)


def _slopes(profile: Profile, t_s: Matrix, exponent: float | Vector) -> tuple[Matrix, Matrix]:
    """Amplitudes (..., m) and their slopes (..., m, 3)."""
    a, tau, falloff = _shape(profile, t_s, exponent)
    alpha = np.asarray(exponent, float)[..., None]
    c = steepness(alpha)
    steep = alpha * c * a * falloff / (1.0 + c * tau**2) / np.asarray(profile.width_s)[..., None]
    G = np.stack([falloff, steep * tau, steep * tau**2], axis=-1)
    return a * falloff, G


def _shape(
    profile: Profile, t_s: Matrix, exponent: float | Vector
) -> tuple[Matrix, Matrix, Matrix]:
    """a_max with an axis for samples, tau (..., m), and the factor by which a_max has fallen."""
    a, t_max, width = (np.asarray(part, float)[..., None] for part in profile)
    alpha = np.asarray(exponent, float)[..., None]
    tau = (np.asarray(t_s, float) - t_max) / width
    return a, tau, (1.0 + steepness(alpha) * tau**2) ** (-0.5 * alpha)
