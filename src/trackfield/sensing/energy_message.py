"""Energy messages: what one sensor says of a whole pass of a target in one code word, Berger."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.sensing.amplitude import AmplitudeModel, Fading
from trackfield.sensing.profile import Profile
from trackfield.types import Matrix, Vector

Words = NDArray[np.int64]

MOST_BITS = 17  # of a number: three of them are whole numbers that a double holds
NOTHING = 0  # the word of a sensor that heard nothing
WEAKEST, STRONGEST = 0.1, 1e5  # ends of the amplitude's codes [sigmas]
EARLY, LATE = 1.1, 0.1  # ends of the time's codes: before and after the record's end [records]
NARROWEST, WIDEST = 0.02, 1.5  # ends of the width's codes: [times between samples], [records]


@dataclass(frozen=True, slots=True)
class EnergyMessageModel:
    """One integer of 3 x `bits` bits: largest amplitude, its time, and time to lose 6 dB of it.

    A sensor made it of amplitudes at `t_s` - `record_s`, ..., `t_s`, every `sample_s`, received as
    `exponent`, `sigma` and `fading` say (see `AmplitudeModel`): the fusion center must know them,
    because they say how good the three numbers are, Berger (16), (42). The sensor's clock is off by
    N(0, clock_sigma_s^2).
    """

    exponent: float = 1.0
    sigma: float = 0.1
    fading: Fading = "none"
    sample_s: float = 1.0
    record_s: float = 60.0
    bits: int = 12
    clock_sigma_s: float = 0.0


class DecodedMessages(NamedTuple):
    """What code words (...) say: a `profile` (...) and the `covariance` (..., 3, 3) of rounding.

    The covariance is that of errors spread evenly over a step, step^2 / 12. `seen` (...) is false
    for the word of nothing, whose profile is the weakest and widest there is; `at_limit` (...) says
    that a number stands at the end of its codes, and may be anything beyond: so does every time
    and width at which the search for the profile was stopped (`FitLimits`).
    """

    profile: Profile
    covariance: Matrix
    seen: NDArray[np.bool_]
    at_limit: NDArray[np.bool_]


class _Scale(NamedTuple):
    """Codes `first` to `last` stand for `low` to `high`, evenly, or evenly in the logarithm."""

    low: float
    high: float
    first: int
    last: int
    logarithmic: bool

    @property
    def step(self) -> float:
        return (self._at(self.high) - self._at(self.low)) / (self.last - self.first)

    def _at(self, value: float) -> float:
        return math.log(value) if self.logarithmic else value

    def code(self, value: Vector) -> Words:
        """Nearest code; what is beyond an end gets the code of the end."""
        inside = np.clip(value, self.low, self.high)
        places = np.log(inside) if self.logarithmic else inside
        return np.rint(self.first + (places - self._at(self.low)) / self.step).astype(np.int64)

    def value(self, code: Words) -> Vector:
        places = self._at(self.low) + self.step * (code - self.first)
        value = np.exp(places) if self.logarithmic else places
        return np.asarray(np.clip(value, self.low, self.high), np.float64)

    def variance(self, value: Vector) -> Vector:
        """Variance of what is rounded to a code of `value`."""
        size = self.step * value if self.logarithmic else np.full(value.shape, self.step)
        return np.square(size) / 12.0


def amplitude_model(model: EnergyMessageModel) -> AmplitudeModel:
    """Say how the samples behind a message were received."""
    return AmplitudeModel(
        model.exponent, model.sigma, model.fading, clock_sigma_s=model.clock_sigma_s
    )


def sample_times(model: EnergyMessageModel) -> Vector:
    """Give the times (m,) [s] of a record's samples, from its end: -record_s, ..., 0."""
    if not (0.0 < model.sample_s <= model.record_s < math.inf):
        raise InputError(
            f"a record of {model.record_s:g} s with a sample every {model.sample_s:g} s: "
            "expected at least one step"
        )
    steps = int(model.record_s / model.sample_s * (1.0 + 1e-12))
    return model.sample_s * np.arange(-steps, 1.0)


def encode(
    model: EnergyMessageModel,
    profile: Profile,
    *,
    end_s: float | Vector,
    seen: bool | NDArray[np.bool_] = True,
) -> Words:
    """Code words (...) of profiles (...) in records that end at `end_s` (...) [s].

    From the highest bits: amplitude, logarithmic from `WEAKEST` to `STRONGEST` times sigma; time,
    linear from `EARLY` records before the end to `LATE` records after it; width, logarithmic from
    `NARROWEST` times sample_s to `WIDEST` records. What is beyond an end gets the code of the end.
    Where nothing was `seen` the word is `NOTHING`, which no profile has.
    """
    numbers = np.stack(np.broadcast_arrays(*profile), axis=-1).astype(float)
    numbers[..., 1] -= end_s
    if np.isnan(numbers).any() or (numbers[..., ::2] < 0.0).any():
        raise InputError("profiles to encode: found one that is negative or NaN")
    word: Words = np.zeros(numbers.shape[:-1], np.int64)
    for k, scale in enumerate(_scales(model)):
        word = (word << model.bits) + scale.code(numbers[..., k])
    return np.where(seen, word, NOTHING)


def decode(
    model: EnergyMessageModel, words: NDArray[Any], *, end_s: float | Vector
) -> DecodedMessages:
    """Find what `words` (...) of records that end at `end_s` (...) [s] say; inverse of `encode`.

    `InputError` for numbers that are no code words.
    """
    scales, base = _scales(model), 1 << model.bits
    given = np.asarray(words, np.float64)
    whole = (given == np.floor(given)) & (given >= 0.0) & (given < float(base) ** 3)
    word = np.where(whole, given, 0.0).astype(np.int64)
    codes = [(word >> (model.bits * (2 - k))) % base for k in range(3)]
    seen = word != NOTHING
    bad = ~whole | (seen & (codes[0] < scales[0].first))
    if bad.any():
        found = given[bad].flat[0]
        raise InputError(
            f"code word {found:.17g}: expected 0, or a whole number from {base**2} to {base**3 - 1}"
        )
    codes = [
        np.where(seen, code, default)
        for code, default in zip(codes, (scales[0].first, base // 2, scales[2].last), strict=True)
    ]
    a, t, width = (scale.value(code) for scale, code in zip(scales, codes, strict=True))
    variances = [s.variance(v) for s, v in zip(scales, (a, t, width), strict=True)]
    ends = [(c == s.first) | (c == s.last) for s, c in zip(scales, codes, strict=True)]
    return DecodedMessages(
        Profile(a, t + np.asarray(end_s, float), width),
        np.stack(variances, axis=-1)[..., None] * np.eye(3),
        seen,
        seen & np.any(ends, axis=0),
    )


def _scales(model: EnergyMessageModel) -> tuple[_Scale, _Scale, _Scale]:
    """Codes of amplitude, time since the record's end, and width."""
    if not 2 <= model.bits <= MOST_BITS:
        raise InputError(f"bits: found {model.bits}, expected 2 to {MOST_BITS}")
    if not (model.sigma > 0.0 and 0.0 < model.sample_s <= model.record_s):
        raise InputError(f"energy messages: found {model}, expected numbers of more than 0")
    top, record = (1 << model.bits) - 1, model.record_s
    narrow = NARROWEST * model.sample_s
    return (
        _Scale(WEAKEST * model.sigma, STRONGEST * model.sigma, 1, top, logarithmic=True),
        _Scale(-EARLY * record, LATE * record, 0, top, logarithmic=False),
        _Scale(narrow, WIDEST * record, 0, top, logarithmic=True),
    )
