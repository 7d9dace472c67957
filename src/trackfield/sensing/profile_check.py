"""Whether samples follow a profile at all: tests of the fit, sample by sample and part by part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackfield.sensing.amplitude import AmplitudeModels, for_samples
from trackfield.types import Matrix, Vector

PARTS = 8  # of a record, at most
LEAST_PART = 3  # samples of a part
SIGMAS = 4.0  # by which a deviance may exceed its mean: a right profile does in under 0.2 %


def contradicted(models: AmplitudeModels, values: Matrix, *, mean: Matrix) -> NDArray[np.bool_]:
    """Say for each record (...) of samples `values` (..., m) if a profile `mean` (..., m) is wrong.

    White noise: the squared residuals in sigmas add up to m. Then parts of the record, on average
    (with fading, on average of the energy): their deviance is about one each, where a second source
    or a turn shifts several parts against the profile. Samples at the saturation count as expected.
    """
    own = for_samples(models)
    clipped = np.asarray(values >= own.saturation)
    if models.fading == "rayleigh":
        energy = np.square(values) / (np.square(own.sigma) + mean**2)
        return _beyond(_energy_deviance(np.where(clipped, 1.0, energy)))
    residual = np.where(clipped, 0.0, (values - mean) / own.sigma)
    sizes = [np.square(part.sum(axis=-1)) / part.shape[-1] for part in _parts(residual)]
    return _beyond(np.square(residual)) | _beyond(np.stack(sizes, axis=-1))


def _energy_deviance(energy: Matrix) -> Matrix:
    """Deviance (..., parts) of parts of exponential samples (..., m) of mean one."""
    parts = [(part.shape[-1], part.mean(axis=-1)) for part in _parts(energy)]
    tiny = np.finfo(float).tiny
    return np.stack([2.0 * k * (e - 1.0 - np.log(np.maximum(e, tiny))) for k, e in parts], axis=-1)


def _parts(samples: Matrix) -> list[Matrix]:
    count = max(1, min(PARTS, samples.shape[-1] // LEAST_PART))
    return np.array_split(samples, count, axis=-1)


def _beyond(deviances: Vector) -> NDArray[np.bool_]:
    """Say if deviances (..., k), each of mean one and chi-squared, add up to too much."""
    k = deviances.shape[-1]
    return np.asarray(deviances.sum(axis=-1) > k + SIGMAS * np.sqrt(2.0 * k))
