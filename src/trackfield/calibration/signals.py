"""Signal models learned from a run with truth: law of distance, noise, gain of each sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from trackfield.errors import InputError
from trackfield.sensing import signal
from trackfield.sensing.signal import SignalModel
from trackfield.types import Matrix, Vector

_optimize = cast("Any", optimize)  # which has no types
_LEAST = 50  # readings near targets
_ROUNDS = 6
_FAR = 5.0  # a reading further off, in standard deviations, is of a broken sensor
_LAW = ("amplitude", "falloff", "exponent")


@dataclass(frozen=True, slots=True, eq=False)
class SignalRun:
    """Readings of a field beside its truth, step by step.

    `values` (steps, n) of `sensors` (n, 2) [m], NaN where a sensor did not speak; `targets`
    (steps, k, 2) [m], NaN while a target is not there.
    """

    values: Matrix
    sensors: Matrix
    targets: Matrix


class SignalErrors(NamedTuple):
    """Standard errors of the values that all sensors share."""

    amplitude: float
    falloff: float
    exponent: float


@dataclass(frozen=True, slots=True, eq=False)
class SignalCalibration:
    """Learned models, and how well they are known.

    `pooled` is the model of all sensors alike: its `sigma_gain` is how much their gains differ.
    `models` has one a sensor: its own gain is in the amplitude, and `sigma_gain` is what remains
    unknown of it. `gain` (n,) and `gain_error` (n,) say the same as numbers. `broken` (n,) are
    sensors of whose readings near targets more than half fit no law. Of `given` readings `used`
    were near a target and not far off.
    """

    pooled: SignalModel
    models: tuple[SignalModel, ...]
    errors: SignalErrors
    gain: Vector
    gain_error: Vector
    broken: NDArray[np.bool_]
    given: int
    used: int


class _Near(NamedTuple):
    """Readings that a target is near: their `step`, `sensor` and value `z` (m,)."""

    step: NDArray[np.intp]
    sensor: NDArray[np.intp]
    z: Vector


class _Gains(NamedTuple):
    """Gain (n,) of each sensor, and how well it is known."""

    gain: Vector
    error: Vector


def calibrate_signals(run: SignalRun, start: SignalModel | None = None) -> SignalCalibration:
    """Learn amplitude, falloff, exponent, noise and gains by robust least squares, in turn.

    The law of distance by least squares that readings far off do not move (soft l1), each sensor
    with the gain that it has so far; sigma and the spread of gains by maximum likelihood with the
    gains integrated out; gains as posterior means, shrunk to 0 by what little a sensor heard, and
    0 on average; and again. Range, placement error, saturation and how targets combine are taken
    from `start`.

    Raises `InputError` for shapes that do not fit, or fewer than 50 readings near targets.
    """
    model = SignalModel() if start is None else start
    values, targets = _checked(run)
    near, quiet = _near(values, targets, run.sensors, model)
    model = replace(model, sigma=_spread(quiet) if quiet.size >= _LEAST else model.sigma)
    n = len(run.sensors)
    gains = _Gains(np.zeros(n), np.full(n, model.sigma_gain))
    kept = np.ones(near.z.size, bool)
    for _ in range(_ROUNDS):
        model = _law(model, run.sensors, targets, near=_rows(near, kept), gains=gains)
        h = _expected(model, run.sensors, targets, near=near)
        off = _off(model, h, near=near, gains=gains)
        kept = np.abs(off) <= _FAR
        if kept.sum() < _LEAST:
            raise InputError(f"found {int(kept.sum())} readings that fit a law, expected {_LEAST}")
        model, gains = _sensors(model, h[kept], near=_rows(near, kept), n=n)
    heard = np.bincount(near.sensor, minlength=n)
    fit = np.bincount(near.sensor[kept], minlength=n)
    return SignalCalibration(
        pooled=model,
        models=tuple(
            replace(model, amplitude=model.amplitude * (1.0 + float(g)), sigma_gain=float(e))
            for g, e in zip(gains.gain, gains.error, strict=True)
        ),
        errors=_errors(model, run.sensors, targets, near=_rows(near, kept), gains=gains),
        gain=gains.gain,
        gain_error=gains.error,
        broken=fit < 0.5 * heard,
        given=int(np.isfinite(values).sum()),
        used=int(kept.sum()),
    )


def _checked(run: SignalRun) -> tuple[Matrix, Matrix]:
    steps, n = run.values.shape if run.values.ndim == 2 else (-1, -1)
    if run.sensors.shape != (n, 2) or run.targets.ndim != 3 or len(run.targets) != steps:
        raise InputError(
            f"values of shape {run.values.shape}, sensors {run.sensors.shape}, targets "
            f"{run.targets.shape}: expected (steps, n), (n, 2) and (steps, k, 2)"
        )
    if np.isinf(run.values).any() or not np.isfinite(run.sensors).all():
        raise InputError("expected finite values and sensors; NaN is for a sensor that is silent")
    return run.values, run.targets


def _near(
    values: Matrix, targets: Matrix, sensors: Matrix, model: SignalModel
) -> tuple[_Near, Vector]:
    """Pick readings with a target in range, off its border; and those with none anywhere near."""
    offsets = targets[:, None] - sensors[:, None]
    r = np.sqrt((offsets**2).sum(-1))
    nearest = np.where(np.isnan(r), np.inf, r).min(-1, initial=np.inf)
    spoken = np.isfinite(values)
    margin = 3.0 * model.placement_sigma_m
    unsure = (np.abs(r - model.max_range_m) < margin).any(-1)
    inside = spoken & (nearest <= model.max_range_m) & ~unsure & (values < model.saturation)
    step, sensor = np.nonzero(inside)
    if step.size < _LEAST:
        raise InputError(f"found {step.size} readings near targets, expected {_LEAST} or more")
    outside = spoken & (nearest > model.max_range_m + margin)
    return _Near(step, sensor, values[step, sensor]), values[outside]


def _rows(near: _Near, kept: NDArray[np.bool_]) -> _Near:
    return _Near(near.step[kept], near.sensor[kept], near.z[kept])


def _expected(model: SignalModel, sensors: Matrix, targets: Matrix, *, near: _Near) -> Vector:
    r = np.sqrt(((targets[near.step] - sensors[near.sensor, None]) ** 2).sum(-1))
    single = np.where(np.isnan(r), 0.0, signal.strength(model, np.nan_to_num(r)))
    return single.max(-1) if model.combination == "max" else single.sum(-1)


def _told(model: SignalModel, logs: Vector) -> SignalModel:
    return replace(
        model, **dict(zip(_LAW, np.exp(np.clip(logs, -20.0, 20.0)).tolist(), strict=True))
    )


def _logs(model: SignalModel) -> Vector:
    return np.log([model.amplitude, model.falloff, model.exponent])


def _off(model: SignalModel, h: Vector, *, near: _Near, gains: _Gains) -> Vector:
    """Residuals (m,) in standard deviations, each sensor with its own gain."""
    sigma_gain = gains.error[near.sensor]
    v = model.sigma**2 + (sigma_gain * h) ** 2
    return (near.z - (1.0 + gains.gain[near.sensor]) * h) / np.sqrt(v)


def _law(
    model: SignalModel, sensors: Matrix, targets: Matrix, *, near: _Near, gains: _Gains
) -> SignalModel:
    """Fit amplitude, falloff and exponent, positive by their logarithms."""
    weight = 1.0 / np.hypot(
        model.sigma,
        gains.error[near.sensor] * _expected(model, sensors, targets, near=near),
    )

    def misfit(logs: Vector) -> Vector:
        h = _expected(_told(model, logs), sensors, targets, near=near)
        return weight * (near.z - (1.0 + gains.gain[near.sensor]) * h)

    found = _optimize.least_squares(misfit, _logs(model), loss="soft_l1", x_scale=0.1)
    return _told(model, np.asarray(found.x, float))


def _sensors(model: SignalModel, h: Vector, *, near: _Near, n: int) -> tuple[SignalModel, _Gains]:
    """Fit sigma, the spread of gains, and the gains, to residuals against the pooled law.

    Those of a sensor are N(0, sigma^2 I + sigma_gain^2 h h'). The amplitude takes what the gains
    have in common.
    """
    residual = near.z - h
    power: Vector = np.bincount(near.sensor, weights=h * h, minlength=n).astype(float)
    lean: Vector = np.bincount(near.sensor, weights=h * residual, minlength=n).astype(float)
    squares = float(residual @ residual)

    def cost(logs: Vector) -> float:
        s2, g2 = np.exp(2.0 * np.clip(logs, -15.0, 15.0)).tolist()
        shrunk = 1.0 + g2 * power / s2
        explained = float(np.sum(g2 * (lean / s2) ** 2 / shrunk))
        return squares / s2 - explained + float(np.log(shrunk).sum() + h.size * np.log(s2))

    first = np.log([model.sigma, max(model.sigma_gain, 0.01)])
    options = {"xatol": 1e-4, "fatol": 1e-4}
    found = _optimize.minimize(cost, first, method="Nelder-Mead", options=options)
    sigma, sigma_gain = np.exp(np.clip(np.asarray(found.x, float), -15.0, 15.0)).tolist()
    precision = power / sigma**2 + 1.0 / sigma_gain**2
    gain = lean / sigma**2 / precision
    heard = power > 0.0
    common = 1.0 + float(gain[heard].mean())
    gain = np.where(heard, (1.0 + gain) / common - 1.0, 0.0)
    learned = replace(model, amplitude=model.amplitude * common, sigma=sigma, sigma_gain=sigma_gain)
    return learned, _Gains(gain, 1.0 / np.sqrt(precision))


def _errors(
    model: SignalModel, sensors: Matrix, targets: Matrix, *, near: _Near, gains: _Gains
) -> SignalErrors:
    """Find standard errors by the sandwich, whose middle squares a sensor's whole score."""
    h = _expected(model, sensors, targets, near=near)
    own = 1.0 + gains.gain[near.sensor]
    logs, step = _logs(model), 1e-5
    slopes = [
        own
        * (
            _expected(_told(model, logs + step * e), sensors, targets, near=near)
            - _expected(_told(model, logs - step * e), sensors, targets, near=near)
        )
        / (2.0 * step)
        for e in np.eye(3)
    ]
    sigma = np.hypot(model.sigma, gains.error[near.sensor] * h)
    J = np.stack(slopes, axis=1) / sigma[:, None]
    bread = np.linalg.pinv(J.T @ J)
    scores = np.zeros((len(sensors), 3))
    np.add.at(scores, near.sensor, J * _off(model, h, near=near, gains=gains)[:, None])
    relative = np.sqrt(np.diag(bread @ (scores.T @ scores) @ bread))
    return SignalErrors(*(float(value) for value in np.exp(logs) * relative))


def _spread(values: Vector) -> float:
    """Estimate a standard deviation about 0 that a few broken sensors do not move."""
    return 1.4826 * float(np.median(np.abs(values)))
