"""How likely samples of an amplitude are, and what one sample tells: Berger (4), (38), (40)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr

from trackfield.errors import InputError
from trackfield.sensing.amplitude import AmplitudeModels
from trackfield.types import Matrix

_LOG_ROOT_2PI = 0.5 * math.log(2.0 * math.pi)


class SampleMisfit(NamedTuple):
    """Each sample's negative log-likelihood `cost` (...), and its `slope` in the amplitude (...).

    `clipped` says where a sample stands at the saturation and so tells "at least this".
    """

    cost: Matrix
    slope: Matrix
    clipped: NDArray[np.bool_]


def misfit(models: AmplitudeModels, values: Matrix, *, mean: Matrix) -> SampleMisfit:
    """Negative log-likelihood of samples `values` (...) of amplitudes `mean` (...), Berger (4).

    With fading, Berger (38); there a negative value is an `InputError`, and a zero counts as the
    least positive number. The columns of `models` broadcast against both.
    """
    if not np.isfinite(values).all():
        raise InputError("amplitudes: found one that is not finite, expected finite numbers")
    clipped = np.asarray(values >= models.saturation)
    if models.fading == "none":
        return _gaussian(models, values, mean, clipped)
    if (values < 0.0).any():
        raise InputError(
            f"amplitudes: found {np.min(values):g}, expected 0 or more: an envelope is not negative"
        )
    return _rayleigh(models, values, mean, clipped)


def sample_information(models: AmplitudeModels, mean: Matrix) -> Matrix:
    """Fisher information (...) about the amplitude `mean` (...) in one sample of it.

    1/sigma^2, or (2 a / (N0 + a^2))^2 with fading, Berger (16), (42); less what saturation hides.
    """
    s = np.asarray(models.saturation)
    if models.fading == "rayleigh":
        v = np.square(models.sigma) + mean**2
        return np.square(2.0 * mean / v) * -np.expm1(-np.square(s) / v)
    if np.isinf(s).all():
        return np.broadcast_to(1.0 / np.square(models.sigma), np.shape(mean)).astype(float)
    u = np.minimum((s - mean) / models.sigma, 40.0)  # further up nothing is hidden
    density = np.exp(-0.5 * u**2 - _LOG_ROOT_2PI)
    told = ndtr(u) + density * (_hazard(u) - u)
    return np.clip(told, 0.0, 1.0) / np.square(models.sigma)


def _gaussian(
    models: AmplitudeModels, values: Matrix, mean: Matrix, clipped: NDArray[np.bool_]
) -> SampleMisfit:
    z = (values - mean) / models.sigma
    cost = 0.5 * z**2 + np.log(models.sigma) + _LOG_ROOT_2PI
    slope = -z / models.sigma
    if clipped.any():
        cost = np.where(clipped, -log_ndtr(-z), cost)
        slope = np.where(clipped, -_hazard(z) / models.sigma, slope)
    return SampleMisfit(cost, slope, clipped)


def _rayleigh(
    models: AmplitudeModels, values: Matrix, mean: Matrix, clipped: NDArray[np.bool_]
) -> SampleMisfit:
    v = np.square(models.sigma) + mean**2
    q = values**2 / v
    density = np.log(v) - np.log(2.0 * np.maximum(values, np.finfo(float).tiny))
    cost = q + np.where(clipped, 0.0, density)
    slope = 2.0 * mean / v * (np.where(clipped, 0.0, 1.0) - q)
    return SampleMisfit(cost, slope, clipped)


def _hazard(u: Matrix) -> Matrix:
    """Density over upper tail of the normal law at `u`, finite at both ends."""
    return np.exp(-0.5 * u**2 - _LOG_ROOT_2PI - log_ndtr(-u))
