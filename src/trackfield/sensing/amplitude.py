"""Amplitudes: how strongly a source of unknown power is received, sample by sample, Berger (2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

Fading = Literal["none", "rayleigh"]
CORE_M = 1e-9  # a source nearer than this counts as this far: amplitudes stay finite [m]


@dataclass(frozen=True, slots=True)
class AmplitudeModel:
    """Amplitude a = sqrt(P) / r^exponent of a source of power P at distance r, Berger (2).

    P, the power at 1 m, is the source's own and unknown. Without `fading` a reading is a + n,
    n ~ N(0, sigma^2), which may be negative, Berger (4); with "rayleigh" it is |h a + w|, h and w
    complex Gaussian of variances 1 and sigma^2, Berger (37). A sensor shows nothing above
    `saturation`. Its clock is off by N(0, clock_sigma_s^2), once and for all. `max_range_m` is how
    far it hears.
    """

    exponent: float = 1.0
    sigma: float = 0.1
    fading: Fading = "none"
    saturation: float = math.inf
    clock_sigma_s: float = 0.0
    max_range_m: float = math.inf


class AmplitudeColumns(NamedTuple):
    """What each sensor's `AmplitudeModel` says, as columns (n,); `fading` is the field's."""

    exponent: Vector
    sigma: Vector
    saturation: Vector
    clock_sigma_s: Vector
    max_range_m: Vector
    fading: Fading = "none"


AmplitudeModels = AmplitudeModel | AmplitudeColumns
"""One model for all sensors, or a column of models; every function of amplitudes takes either."""


class SimulatedAmplitudes(NamedTuple):
    """What the sensors measured along a path: `value` and `heard` (..., steps, n).

    `value` is what a sensor would have read, in range or not; `heard` says where the source was
    within `max_range_m`. `ahead_s` (..., n) is how far each sensor's clock was ahead: it stamps a
    sample of time t with t + ahead_s.
    """

    value: Matrix
    heard: NDArray[np.bool_]
    ahead_s: Matrix


def columns(models: Sequence[AmplitudeModel]) -> AmplitudeColumns:
    """Columns (n,) of the models of n sensors, which must agree in their fading."""
    fading = {model.fading for model in models}
    if len(fading) != 1:
        raise InputError(f"fading of a field's sensors: found {sorted(fading)}, expected one value")
    own = AmplitudeColumns._fields[:-1]
    return AmplitudeColumns(
        *(np.array([getattr(model, name) for model in models], float) for name in own),
        fading=models[0].fading,
    )


def for_samples(models: AmplitudeModels) -> AmplitudeModels:
    """Give columns (n,) a last axis, so that each sensor's row of samples (n, m) meets its own."""
    if isinstance(models, AmplitudeModel):
        return models
    own = {name: getattr(models, name)[..., None] for name in AmplitudeColumns._fields[:-1]}
    return models._replace(**own)


def strength(models: AmplitudeModels, r: Matrix, *, power: float | Matrix) -> Matrix:
    """Amplitude sqrt(power) r^-exponent (..., n) at distances `r` (..., n) [m], Berger (2)."""
    return np.sqrt(power) * np.maximum(r, CORE_M) ** -np.asarray(models.exponent)


def expected(
    models: AmplitudeModels, sensors: Matrix, *, positions: Matrix, power: float | Matrix
) -> Matrix:
    """Amplitude a (..., n) at `sensors` (n, d) of a source at `positions` (..., d) [m].

    What the sensor reads without noise; with fading, the root of the mean energy that is the
    source's. `power` broadcasts against (..., n).
    """
    return strength(models, _distance(sensors, positions), power=power)


def noisy(models: AmplitudeModels, mean: Matrix, *, rng: np.random.Generator) -> Matrix:
    """Draw samples (..., n) of amplitudes `mean` (..., n): noise, fading, saturation."""
    if models.fading == "none":
        return np.minimum(mean + models.sigma * rng.standard_normal(mean.shape), models.saturation)
    variance = np.square(models.sigma) + mean**2
    return np.minimum(np.sqrt(variance * rng.standard_exponential(mean.shape)), models.saturation)


def simulate(
    models: AmplitudeModels,
    sensors: Matrix,
    *,
    path: Matrix,
    power: float | Matrix,
    rng: np.random.Generator,
) -> SimulatedAmplitudes:
    """Draw what `sensors` (n, d) read of a source of `power` on `path` (..., steps, d).

    Each leading index is a run of its own, in which a sensor's clock keeps its error.
    """
    r = _distance(sensors, path)
    value = noisy(models, strength(models, r, power=power), rng=rng)
    ahead_s = models.clock_sigma_s * rng.standard_normal((*r.shape[:-2], r.shape[-1]))
    return SimulatedAmplitudes(value, np.asarray(r <= models.max_range_m), ahead_s)


def _distance(sensors: Matrix, positions: Matrix) -> Matrix:
    d = sensors.shape[-1]
    if sensors.ndim != 2 or d not in {2, 3} or positions.shape[-1:] != (d,):
        raise InputError(
            f"sensors of shape {sensors.shape} and positions of shape {positions.shape}: "
            "expected (n, d) and (..., d) with the same d, 2 or 3"
        )
    return np.linalg.norm(positions[..., None, :] - sensors, axis=-1)
