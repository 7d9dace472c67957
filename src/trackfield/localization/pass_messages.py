"""What a fusion center has of one pass: each sensor's three numbers, and how they were made."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.profile import Profile, information
from trackfield.types import Matrix, Vector

MOST_SAMPLES = 1_000_000  # of all records together
_LARGEST = 1e9  # places, amplitudes, widths, times from the start beyond it are no use


class PassRecords(NamedTuple):
    """Records of n sensors, (n,) each: `samples` (n,) of them from `first_s` every `step_s`."""

    first_s: Vector
    step_s: Vector
    samples: Vector


class PassMessages(NamedTuple):
    """Messages of n sensors about one pass of one target.

    `sensors` (n, 2) [m]; `profiles` (n, 3) holds a_max, t_max [s], width [s] (see `Profile`); an
    amplitude of 0 says that nothing was heard, which is worth something too. `models` are the
    sensors' own, which must agree in the exponent. `start_s` is the time at which a trajectory's
    position is told. `rounding` (n, 3, 3) is the covariance of what coding did to the numbers, of
    which a fading sensor is told enough by its noise. Units are whatever is consistent.
    """

    sensors: Matrix
    models: tuple[AmplitudeModel, ...]
    profiles: Matrix
    records: PassRecords
    start_s: float = 0.0
    rounding: Matrix | None = None


def common_records(n: int, t_s: Vector) -> PassRecords:
    """Make records of `n` sensors that all sampled at the evenly spaced times `t_s` (m,)."""
    times = np.atleast_1d(np.asarray(t_s, float))
    step = float(times[-1] - times[0]) / max(times.size - 1, 1)
    steps = np.diff(times)
    if not times.size or (np.abs(steps - step) > 1e-6 * step).any():
        raise InputError("sample times: expected some, evenly spaced")
    return PassRecords(np.full(n, times[0]), np.full(n, step or 1.0), np.full(n, float(times.size)))


def fishers(messages: PassMessages) -> Matrix:
    """Fisher matrices (n, 3, 3) of the messages at what they say, Berger (16), (42).

    With rounding (J^-1 + A)^-1. Zero for a message that heard nothing.
    """
    checked(messages)
    out = np.zeros((len(messages.profiles), 3, 3))
    for k, (psi, model) in enumerate(zip(messages.profiles, messages.models, strict=True)):
        first, step, count = (float(column[k]) for column in messages.records)
        if psi[0] > 0.0 and psi[2] > 0.0:
            t_s: Vector = first + step * np.arange(int(count), dtype=float)
            out[k] = information(Profile(*psi), t_s, model)
    if messages.rounding is None:
        return out
    return out @ np.linalg.inv(np.eye(3) + messages.rounding @ out)


def checked(messages: PassMessages) -> None:
    """Raise `InputError` if `messages` are none: shapes, numbers, exponents."""
    n = len(messages.models)
    shapes = [np.shape(part) for part in (messages.sensors, messages.profiles, *messages.records)]
    if shapes != [(n, 2), (n, 3), (n,), (n,), (n,)]:
        raise InputError(
            f"messages of {n} models with sensors, profiles, records of shapes {shapes}: "
            f"expected ({n}, 2), ({n}, 3) and 3 x ({n},)"
        )
    from_start = messages.profiles - np.array([0.0, messages.start_s, 0.0])
    for name, part in (("sensor", messages.sensors), ("message", from_start)):
        fine = np.abs(part) < _LARGEST
        if not fine.all():
            k = int(np.flatnonzero(~fine.all(axis=1))[0])
            raise InputError(f"{name} {k}: found {part[k].tolist()}, expected numbers below 1e9")
    if (messages.profiles[:, ::2] < 0.0).any():
        raise InputError("messages: found a negative amplitude or width, expected 0 or more")
    rounding = messages.rounding
    if rounding is not None and (rounding.shape != (n, 3, 3) or not np.isfinite(rounding).all()):
        raise InputError(f"rounding of shape {rounding.shape}: expected ({n}, 3, 3), finite")
    first, step, samples = messages.records
    early = np.abs(first - messages.start_s) < _LARGEST
    if not (early & (step > 0.0) & (step < np.inf) & (samples >= 1.0)).all():
        raise InputError(
            "records: expected first times near the start, steps > 0 and at least one sample"
        )
    if n and not samples.sum() <= MOST_SAMPLES:
        raise InputError(f"records: found {samples.sum():g} samples, at most {MOST_SAMPLES}")
    exponents = {model.exponent for model in messages.models}
    if len(exponents) > 1:
        raise InputError(f"exponents: found {sorted(exponents)}, expected one for all sensors")
