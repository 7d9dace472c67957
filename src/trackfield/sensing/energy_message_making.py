"""From a sensor's samples of one pass to its message."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.sensing import amplitude
from trackfield.sensing.energy_message import (
    EnergyMessageModel,
    Words,
    amplitude_model,
    encode,
    sample_times,
)
from trackfield.sensing.profile_fit import ProfileFit, Quality, fit
from trackfield.types import Matrix


class MadeMessages(NamedTuple):
    """Code words (...) and the fits (...) they were made of, with times from the record's end."""

    word: Words
    fit: ProfileFit


class SimulatedMessages(NamedTuple):
    """Code words (..., n) of n sensors, the fits, and how far each one's clock is ahead [s].

    A sensor stamps its message with the end of the record + `ahead_s` (..., n).
    """

    word: Words
    fit: ProfileFit
    ahead_s: Matrix


def make(model: EnergyMessageModel, values: Matrix) -> MadeMessages:
    """Messages (...) of records `values` (..., m) sampled at `sample_times(model)`.

    The likeliest profile, encoded; `NOTHING` where it is empty or has too few samples.
    """
    found = fit(amplitude_model(model), sample_times(model), values)
    seen = found.quality < Quality.EMPTY
    return MadeMessages(encode(model, found.profile, end_s=0.0, seen=seen), found)


def simulate(
    model: EnergyMessageModel,
    sensors: Matrix,
    *,
    path: Matrix,
    power: float | Matrix,
    rng: np.random.Generator,
) -> SimulatedMessages:
    """Draw what `sensors` (n, d) say of a source of `power` that passes on `path` (..., m, d).

    A place for each of `sample_times(model)`; each leading index is a run of its own.
    """
    drawn = amplitude.simulate(amplitude_model(model), sensors, path=path, power=power, rng=rng)
    made = make(model, np.swapaxes(drawn.value, -1, -2))
    return SimulatedMessages(made.word, made.fit, drawn.ahead_s)
