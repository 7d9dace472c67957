"""Signal strength that falls with distance and adds up over targets, Oh (1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtr

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_CORE_M = 1e-6  # nearer to a sensor than this there is no slope to speak of [m]


@dataclass(frozen=True, slots=True)
class SignalModel:
    """Strength near a target at distance r: z = amplitude / (1 + falloff r^exponent) + w, Oh (1).

    Beyond `max_range_m` there is nothing but the noise w ~ N(0, sigma^2). `sigma_gain` is the
    relative error of the amplitude, `placement_sigma_m` (per axis) that of the sensor's place: a
    model error that the variance does not know is what ruins fusion. Targets differ in strength by
    factors exp(N(0, sigma_factor^2)). Several targets add up, or the strongest hides the others
    (`combination`). A sensor shows nothing above `saturation`.
    """

    amplitude: float = 195.0  # 3 (1 + falloff max_range_m^exponent): three sigma at the edge
    falloff: float = 1.0  # [1/m^exponent]
    exponent: float = 2.0
    max_range_m: float = 8.0
    sigma: float = 1.0
    sigma_gain: float = 0.1
    placement_sigma_m: float = 0.0
    sigma_factor: float = 0.0
    saturation: float = math.inf
    combination: Literal["sum", "max"] = "sum"


class SignalColumns(NamedTuple):
    """What each sensor's `SignalModel` says, as columns (n,); the last two belong to the field."""

    amplitude: Vector
    falloff: Vector
    exponent: Vector
    max_range_m: Vector
    sigma: Vector
    sigma_gain: Vector
    placement_sigma_m: Vector
    saturation: Vector
    sigma_factor: float = 0.0
    combination: Literal["sum", "max"] = "sum"


SignalModels = SignalModel | SignalColumns
"""One model for all sensors, or a column of models; every function of signals takes either."""


class SensorErrors(NamedTuple):
    """What is wrong with each sensor of one field: `gain` (n,), and `place` (n, 2) [m].

    The sensor multiplies what it hears by 1 + gain, and stands at its told place + `place`.
    """

    gain: Vector
    place: Matrix


def columns(models: Sequence[SignalModel]) -> SignalColumns:
    """Columns (n,) of the models of n sensors, which must agree in what belongs to the field."""
    for name in ("sigma_factor", "combination"):
        values = {getattr(model, name) for model in models}
        if len(values) != 1:
            raise InputError(f"{name} of a field's sensors: found {values}, expected one value")
    own = SignalColumns._fields[:-2]
    return SignalColumns(
        *(np.array([getattr(model, name) for model in models], float) for name in own),
        sigma_factor=models[0].sigma_factor,
        combination=models[0].combination,
    )


def strength(models: SignalModels, r: Matrix) -> Matrix:
    """Mean signal h(r) (..., n) of one target at distances `r` (..., n) [m], Oh (1)."""
    inside = r <= models.max_range_m
    return np.where(inside, models.amplitude / (1.0 + models.falloff * r**models.exponent), 0.0)


def slope(models: SignalModels, r: Matrix) -> Matrix:
    """Slope h'(r) (..., n) [1/m] of `strength`; the step at `max_range_m` is left out."""
    r = np.maximum(r, _CORE_M)
    q = models.falloff * r**models.exponent
    return -strength(models, r) * models.exponent * q / (r * (1.0 + q))


def expected(
    models: SignalModels, sensors: Matrix, *, targets: Matrix, factors: Matrix | None = None
) -> Matrix:
    """Mean reading (..., n) of `sensors` (n, 2) with targets at (..., k, 2) [m].

    `factors` (..., k) multiply the amplitude; a target at NaN is not there.
    """
    single = _single(models, sensors, targets, factors).strength
    return _combined(models, single)


def jacobian(
    models: SignalModels, sensors: Matrix, *, targets: Matrix, factors: Matrix | None = None
) -> Matrix:
    """Slope (..., n, k, 2) [1/m] of `expected` in the targets' positions (..., k, 2)."""
    single = _single(models, sensors, targets, factors)
    if models.combination == "max" and targets.shape[-2] > 1:
        strongest = np.asarray(single.strength.argmax(-1), np.intp)
        return single.gradient * np.eye(targets.shape[-2])[strongest][..., None]
    return single.gradient


def variance(
    models: SignalModels, sensors: Matrix, *, targets: Matrix, factors: Matrix | None = None
) -> Matrix:
    """Variance (..., n) of a reading about `expected`: noise, gain, and place to first order.

    sigma^2 + (sigma_gain h)^2 + placement_sigma_m^2 |grad h|^2, h the combined signal; and near
    `max_range_m`, where a sensor may stand on the other side, the step's square times the
    probability of that.
    """
    single = _single(models, sensors, targets, factors)
    h = _combined(models, single.strength)
    gradient = jacobian(models, sensors, targets=targets, factors=factors).sum(-2)
    place = np.asarray(models.placement_sigma_m)
    v = models.sigma**2 + (models.sigma_gain * h) ** 2 + place**2 * np.sum(gradient**2, -1)
    if not place.any():
        return v
    limit = np.asarray(models.max_range_m)
    edge = strength(models, np.broadcast_to(limit, single.distance.shape[:-2] + h.shape[-1:]))
    beyond = ndtr(-np.abs(single.distance - limit[..., None]) / np.maximum(place, 1e-12)[..., None])
    return v + np.sum((edge[..., None] * single.factors) ** 2 * beyond, -1)


def variance_at(models: SignalModels, r: Matrix) -> Matrix:
    """`variance` (..., n) of readings of one target at distances `r` (..., n) [m], in space too."""
    h, place = strength(models, r), np.asarray(models.placement_sigma_m)
    v = models.sigma**2 + (models.sigma_gain * h) ** 2 + (place * slope(models, r)) ** 2
    limit = np.broadcast_to(models.max_range_m, h.shape)
    beyond = np.where(place > 0.0, ndtr(-np.abs(r - limit) / np.maximum(place, 1e-12)), 0.0)
    return v + strength(models, limit) ** 2 * beyond


def draw_errors(models: SignalModels, sensors: Matrix, *, rng: np.random.Generator) -> SensorErrors:
    """Draw what is wrong with each of `sensors` (n, 2): gains and places, as `models` say."""
    gain = models.sigma_gain * rng.standard_normal(len(sensors))
    place = np.asarray(models.placement_sigma_m)[..., None] * rng.standard_normal((len(sensors), 2))
    return SensorErrors(gain, place)


def simulate(
    models: SignalModels,
    sensors: Matrix,
    *,
    targets: Matrix,
    rng: np.random.Generator,
    factors: Matrix | None = None,
    errors: SensorErrors | None = None,
) -> Matrix:
    """Draw readings (..., n) of `sensors` (n, 2) with targets at (..., k, 2), Oh (1).

    The sensors keep their `errors` (drawn if not given) over all leading axes; a target at NaN is
    not there.
    """
    faults = draw_errors(models, sensors, rng=rng) if errors is None else errors
    h = expected(models, sensors + faults.place, targets=targets, factors=factors)
    z = (1.0 + faults.gain) * h + models.sigma * rng.standard_normal(h.shape)
    return np.minimum(z, models.saturation)


class _Single(NamedTuple):
    """Each target alone: `strength`, `distance` (..., n, k), `gradient` (..., n, k, 2)."""

    strength: Matrix
    gradient: Matrix
    distance: Matrix
    factors: Matrix  # (..., 1, k), 0 for a target that is not there


def _single(
    models: SignalModels, sensors: Matrix, targets: Matrix, factors: Matrix | None
) -> _Single:
    if sensors.ndim != 2 or sensors.shape[1] != 2 or targets.ndim < 2 or targets.shape[-1] != 2:
        raise InputError(
            f"sensors of shape {sensors.shape} and targets of shape {targets.shape}: "
            "expected (n, 2) and (..., k, 2)"
        )
    there: Matrix = np.where(np.isnan(targets).any(-1), 0.0, 1.0)
    places = np.where(there[..., None] > 0.0, targets, 0.0)
    offsets = places[..., None, :, :] - sensors[:, None, :]
    r: Matrix = np.linalg.norm(offsets, axis=-1)
    scale: Matrix = (there if factors is None else there * factors)[..., None, :]
    per_target = _per_target(models)
    h = scale * strength(per_target, r)
    radial = scale * slope(per_target, r) / np.maximum(r, _CORE_M)
    return _Single(h, radial[..., None] * offsets, r, scale)


def _per_target(models: SignalModels) -> SignalModels:
    """Give columns a last axis for targets, so that they meet distances (..., n, k)."""
    if isinstance(models, SignalModel):
        return models
    own = {name: getattr(models, name)[:, None] for name in SignalColumns._fields[:-2]}
    return models._replace(**own)


def _combined(models: SignalModels, single: Matrix) -> Matrix:
    if models.combination == "max":
        return single.max(-1, initial=0.0)
    return single.sum(-1)
