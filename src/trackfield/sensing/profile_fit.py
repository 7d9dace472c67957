"""What a sensor makes of one pass: maximum-likelihood profiles, how good they are, and if at all.

Berger (15), (41), bounded, from starts that need no luck.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np

from trackfield._core import _profiles
from trackfield.errors import InputError
from trackfield.sensing.amplitude import AmplitudeModels, for_samples
from trackfield.sensing.amplitude_likelihood import misfit
from trackfield.sensing.profile import Profile, expected, information
from trackfield.sensing.profile_check import contradicted
from trackfield.types import Indices, Matrix, Vector

LEAST_SAMPLES = 4  # three numbers, and one sample to contradict them
EMPTY_GAIN = (
    8.0  # in log-likelihood over nothing at all: noise gains so much in under 1 % of records
)
FLAT_GAIN = 5.0  # the same over a constant amplitude


class Quality(IntEnum):
    """What a fitted profile is worth; `QUALITY_REASONS` says it in words."""

    GOOD = 0
    CLIPPED = 1
    NOT_PASSED = 2
    MISFIT = 3
    FLAT = 4
    NOT_CONVERGED = 5
    EMPTY = 6
    TOO_FEW = 7


QUALITY_REASONS: Mapping[Quality, str] = {
    Quality.GOOD: "The samples follow a pass.",
    Quality.CLIPPED: "Some samples stand at the saturation: it was at least so strong.",
    Quality.NOT_PASSED: "The closest approach is before the record or after it.",
    Quality.MISFIT: "The samples follow no straight pass of one source.",
    Quality.FLAT: "The amplitude does not change enough to tell when anything passed.",
    Quality.NOT_CONVERGED: "The search for the likeliest profile did not end.",
    Quality.EMPTY: "Nothing is heard above the noise.",
    Quality.TOO_FEW: "There are fewer samples than a profile needs.",
}


class FitLimits(NamedTuple):
    """Where a profile is searched.

    `t_max_s` at most `margin` times the record's length beyond it; `width_s` from `narrowest` times
    the time between samples to `widest` times the record's length. Further out samples hardly tell
    amplitude, time and width apart: wider limits give weak sensors wild numbers and gain nothing
    for passes beyond the record. A fit that stands at a limit is `NOT_PASSED` or `FLAT`.
    """

    margin: float = 0.1
    narrowest: float = 0.02  # a pass nearer than the way between two samples has such a width
    widest: float = 1.5


LIMITS = FitLimits()


class ProfileFit(NamedTuple):
    """Likeliest profiles (...) of records, with their Fisher information (..., 3, 3) there.

    `log_likelihood` (...) is that of the profile, `gain` (...) by how much it exceeds that of
    nothing at all, `gain_of_change` (...) that of the best constant amplitude. `quality` (...)
    holds `Quality`; whatever it is, all numbers are finite. `iterations` (...) counts steps of the
    search.
    """

    profile: Profile
    information: Matrix
    log_likelihood: Vector
    gain: Vector
    gain_of_change: Vector
    quality: Indices
    iterations: Indices


def fit(
    models: AmplitudeModels,
    t_s: Matrix,
    values: Matrix,
    *,
    limits: FitLimits = LIMITS,
    starts: Literal["grid", "paper"] = "grid",
) -> ProfileFit:
    """Find the likeliest profiles of records `values` (..., m) at times `t_s` (m,) or (..., m) [s].

    Columns of `models` are of the last leading axis. The first start is the paper's: the largest
    sample, and the one nearest to half of it. Others, unless `starts` is "paper", are the best two
    of a grid of times and widths, at each of which the amplitude is fitted. Newton's method,
    damped, follows, within `limits`.

    Times must rise. Without fading amplitudes may be negative, as noise is. `InputError` for what
    is no record.
    """
    times, records = _checked(t_s, values)
    columns = [
        _column(getattr(models, name), values.shape[:-1], name)
        for name in ("exponent", "sigma", "saturation")
    ]
    misfit(for_samples(models), values, mean=np.zeros(values.shape))  # refuses what cannot be
    rows, m = records.shape
    found = np.zeros((rows, 8))
    if m >= LEAST_SAMPLES:
        fades = models.fading == "rayleigh"
        _profiles.fit(
            times, records, columns, _bounds(times, rows, limits), fades, starts == "grid", found
        )
    else:
        found[:] = _untold(times, records)
    return _judged(models, t_s, values, found.reshape(*values.shape[:-1], 8))


def _judged(models: AmplitudeModels, t_s: Matrix, values: Matrix, found: Matrix) -> ProfileFit:
    """Say what the rows (..., 8) of the search are worth."""
    a, t_max, width, cost, nothing, constant, steps, converged = np.moveaxis(found, -1, 0)
    profile = Profile(a, t_max, width)
    mean = expected(profile, t_s, exponent=models.exponent)
    own, m = for_samples(models), values.shape[-1]
    first, last = np.min(t_s, axis=-1), np.max(t_s, axis=-1)
    saturated = np.asarray(values >= own.saturation).any(axis=-1)

    quality = np.where(saturated, Quality.CLIPPED, Quality.GOOD)
    wrong = contradicted(models, values, mean=mean)
    quality = np.where(wrong, Quality.MISFIT, quality)
    quality = np.where((t_max < first) | (t_max > last), Quality.NOT_PASSED, quality)
    flat = np.where(saturated, Quality.CLIPPED, Quality.FLAT)
    wrong = wrong & contradicted(models, values, mean=_level(models, values))
    flat = np.where(wrong, Quality.MISFIT, flat)
    quality = np.where(constant - cost < FLAT_GAIN, flat, quality)
    quality = np.where(converged == 0.0, Quality.NOT_CONVERGED, quality)
    quality = np.where(nothing - cost < EMPTY_GAIN + np.log(m), Quality.EMPTY, quality)
    if m < LEAST_SAMPLES:
        quality = np.full_like(quality, Quality.TOO_FEW)
        cost = misfit(own, values, mean=mean).cost.sum(axis=-1)
        nothing = constant = cost
    J = information(profile, t_s, models)
    gains = -cost, nothing - cost, constant - cost
    return ProfileFit(profile, J, *gains, quality.astype(np.int32), steps.astype(np.int32))


def _level(models: AmplitudeModels, values: Matrix) -> Matrix:
    """Give the constant amplitude (..., 1) of records (..., m)."""
    if models.fading == "none":
        return values.mean(axis=-1, keepdims=True)
    energy = np.mean(np.square(values), axis=-1, keepdims=True)
    return np.sqrt(np.maximum(energy - np.square(for_samples(models).sigma), 0.0))


def _checked(t_s: Matrix, values: Matrix) -> tuple[Matrix, Matrix]:
    """Return times (1 or b, m) and records (b, m)."""
    m = values.shape[-1] if values.ndim else 0
    if m == 0 or t_s.shape not in {(m,), values.shape}:
        raise InputError(
            f"times of shape {t_s.shape} and amplitudes of shape {values.shape}: "
            "expected (m,) or (..., m), and (..., m), m > 0"
        )
    steps = np.diff(t_s, axis=-1)
    if not np.isfinite(t_s).all() or not (steps > 0.0).all():
        raise InputError(
            "times of samples: found some that do not rise, expected each once, in order"
        )
    return (
        np.ascontiguousarray(t_s.reshape(-1, m), np.float64),
        np.ascontiguousarray(values.reshape(-1, m), np.float64),
    )


def _bounds(times: Matrix, rows: int, limits: FitLimits) -> Matrix:
    """Earliest and latest time, narrowest and widest width, (rows, 4) [s]."""
    first, last = times[:, 0], times[:, -1]
    length, step = last - first, np.median(np.diff(times, axis=1), axis=1)
    narrowest, widest = limits.narrowest * step, limits.widest * length
    if not (limits.margin >= 0.0 and limits.narrowest > 0.0 and (narrowest < widest).all()):
        raise InputError(f"limits of a fit: found {limits}, expected some room between them")
    beyond = limits.margin * length
    bounds = np.stack([first - beyond, last + beyond, narrowest, widest], axis=1)
    return np.ascontiguousarray(np.broadcast_to(bounds, (rows, 4)))


def _column(value: float | Vector, shape: tuple[int, ...], name: str) -> Vector:
    if not (np.asarray(value) > 0.0).all():
        raise InputError(f"{name}: found {value}, expected more than 0")
    return np.ascontiguousarray(np.broadcast_to(value, shape).reshape(-1), np.float64)


def _untold(times: Matrix, records: Matrix) -> Matrix:
    """Rows (b, 8) that hold the largest sample, where there are too few."""
    top = np.asarray(records.argmax(axis=1), np.intp)
    times = np.broadcast_to(times, records.shape)
    every = np.arange(len(records))
    length = times[:, -1] - times[:, 0]
    out = np.zeros((len(records), 8))
    out[:, 0] = np.maximum(records[every, top], 0.0)
    out[:, 1] = times[every, top]
    out[:, 2] = np.where(length > 0.0, length, 1.0)
    return out
