"""What trajectories need of a site, and messages of readings."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np

from trackfield.errors import ConfigurationError, InputError
from trackfield.localization.pass_fusion import LEAST_SENSORS
from trackfield.localization.pass_stream import SensorMessage
from trackfield.network.kinds import SensorModel, kind_of
from trackfield.network.site import Site
from trackfield.pipeline.live_passes import PassRules
from trackfield.pipeline.pass_book import Ears, PassBook
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.energy_message import (
    EnergyMessageModel,
    amplitude_model,
    decode,
    sample_times,
)
from trackfield.sensing.profile import Profile

LOUD = 6.0  # standard deviations of noise that are something else: a source, or a wrong model
_WANTS = "a pass that at least 3 sensors, not in a line, heard clearly above their noise"
_APART = 0.5  # widths by which two messages of one pass may differ in time
_LOUDER = 2.0  # times that one may be as loud


class Decoded(NamedTuple):
    """What a code word says: a message, and whether anything was heard."""

    message: SensorMessage
    seen: bool


def ears(site: Site) -> dict[int, Ears]:
    """Sensors by number, without samples; `ConfigurationError` if they cannot be fused."""
    problems: list[str] = []
    found: dict[int, Ears] = {}
    for number, (name, model) in enumerate(zip(site.sensor_ids, site.models, strict=True)):
        if isinstance(model, EnergyMessageModel):
            model = amplitude_model(model)
        if not isinstance(model, AmplitudeModel):
            problems.append(
                f"site {site.name}: found sensor {name!r} of kind {kind_of(model)!r}, expected "
                "'amplitude' or 'energy_message' of all: trajectories are made of what passes"
            )
            continue
        x_m, y_m = site.positions[number, :2].tolist()
        found[number] = Ears(x_m, y_m, model, [], [])
    exponents = {own.model.exponent for own in found.values()}
    if len(exponents) > 1:
        told = ", ".join(f"{one:g}" for one in sorted(exponents))
        problems.append(f"site {site.name}: found exponents {told}, expected one for all sensors")
    if problems:
        raise ConfigurationError(problems)
    return found


def pass_rules(site: Site, *, lag_s: float, every_s: float) -> PassRules:
    """Rules of a site's passes; its middle is that of the sensors."""
    place = site.positions[:, :2]
    middle = place.mean(axis=0) if len(place) else np.zeros(2)
    radius = float(np.linalg.norm(place - middle, axis=1).max(initial=0.0))
    x, y = middle.tolist()
    records = [m.record_s for m in site.models if isinstance(m, EnergyMessageModel)]
    patience_s = max(records, default=0.0)
    return PassRules(site.tracker.drop_s, lag_s, every_s, (x, y), radius, patience_s)


def wants(loud: int) -> str:
    """Say what it takes to start a track, where `loud` sensors heard something clearly."""
    if loud < LEAST_SENSORS:
        return _WANTS
    return (
        f"{_WANTS}: {loud} heard something so loud, but nothing that fits a pass; are sigma, "
        "exponent and fading of their models wrong, or are there several sources at once?"
    )


def fades(model: SensorModel) -> bool:
    """Tell whether a model's amplitudes are envelopes, which are never negative."""
    return isinstance(model, AmplitudeModel) and model.fading == "rayleigh"


def alike(one: SensorMessage, other: SensorMessage) -> bool:
    """Tell whether two messages of a sensor, of other records that overlap, tell one pass."""
    if one.first_s == other.first_s:
        return False
    ends = [m.first_s + m.step_s * (m.samples - 1) for m in (one, other)]
    if max(one.first_s, other.first_s) > min(ends):
        return False
    a, b = one.profile, other.profile
    if min(a.a_max, b.a_max) <= 0.0:
        return False
    width = max(cast("float", a.width_s), cast("float", b.width_s))
    apart = abs(cast("float", a.t_max_s) - cast("float", b.t_max_s))
    louder = abs(math.log(cast("float", a.a_max) / cast("float", b.a_max)))
    return apart < _APART * width and louder < math.log(_LOUDER)


def pass_number(book: PassBook, message: SensorMessage) -> int:
    """Find which of its passes a sensor tells: one that it told of another record, or a new one."""
    own = {key[1]: known for key, known in book.messages.items() if key[0] == message.sensor}
    again = [number for number, known in own.items() if alike(known, message)]
    return again[0] if again else max(own, default=-1) + 1


def decoded(site: Site, own: Ears, sensor: int, *, t_s: float, word: float) -> Decoded:
    """Message of a code word of one of a site's sensors, whose record ends at `t_s`.

    `InputError` if it is no code word.
    """
    model = cast("EnergyMessageModel", site.models[sensor])
    try:
        found = decode(model, np.array(word), end_s=t_s)
    except InputError as error:
        name = site.sensor_ids[sensor]
        raise InputError(f"message of {name!r} at {t_s:g} s: found {error}") from None
    seen = bool(found.seen)
    numbers = [float(number) for number in found.profile] if seen else [0.0, t_s, 0.0]
    times = sample_times(model)
    about = sensor, own.x_m, own.y_m, own.model, Profile(*numbers)
    record = t_s + float(times[0]), model.sample_s, int(times.size)
    return Decoded(SensorMessage(*about, *record), seen)
