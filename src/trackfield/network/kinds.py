"""The kinds of sensors: each one's parameters, what is believed untold, and what it may say.

A kind that is added is a line in `KINDS` (and bounds of its keys in `bounds`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import UNCALIBRATED, RangeModel
from trackfield.sensing.rssi import UNSURVEYED, RssiModel
from trackfield.sensing.signal import SignalModel

SensorModel = (
    RangeModel
    | SignalModel
    | DetectionModel
    | BearingModel
    | AngularRateModel
    | MotionRateModel
    | RssiModel
    | AmplitudeModel
    | EnergyMessageModel
)
"""Parameters of one sensor, of any kind."""


Family = Literal["range", "signal", "detection", "angle", "rssi", "amplitude", "energy_message"]
"""Kinds whose readings are tracked together."""


class Values(NamedTuple):
    """What a reading of a kind may be: `least` to `most`; 0 or 1 only, if `binary`."""

    expected: str
    least: float = -math.inf
    binary: bool = False
    most: float = math.inf


class Kind(NamedTuple):
    """A kind of sensor: its parameters, those believed where nothing is told, and its readings.

    What a person tells of a parameter settles the doubts that `doubts` names for it. `tagged` kinds
    name their target, so that a target may have parameters of its own. Kinds of one `family` are
    tracked together.
    """

    parameters: type[SensorModel]
    usual: SensorModel
    values: Values
    family: Family
    doubts: Mapping[str, tuple[str, ...]] = {}
    tagged: bool = False


_NOISE = ("correlated_sigma_m", "learn_noise")
KINDS: Mapping[str, Kind] = {
    "range": Kind(
        RangeModel,
        UNCALIBRATED,
        Values("a range of 0 or more", least=0.0),
        "range",
        doubts={
            "bias_m": ("bias_sigma_m", "common_bias_sigma_m"),
            "scale": ("scale_sigma",),
            "sigma_m": _NOISE,
            "sigma_scale": _NOISE,
        },
        tagged=True,
    ),
    "signal": Kind(SignalModel, SignalModel(), Values("a finite number"), "signal"),
    "detection": Kind(DetectionModel, DetectionModel(), Values("0 or 1", binary=True), "detection"),
    "bearing": Kind(
        BearingModel,
        BearingModel(),
        Values("an angle in radians, -2 pi to 2 pi", least=-2.0 * math.pi, most=2.0 * math.pi),
        "angle",
        tagged=True,
    ),
    "angular_rate": Kind(
        AngularRateModel,
        AngularRateModel(),
        Values("a finite number"),
        "angle",
        tagged=True,
    ),
    "motion": Kind(
        MotionRateModel,
        MotionRateModel(),
        Values("a finite number"),
        "angle",
        tagged=True,
    ),
    "rssi": Kind(
        RssiModel,
        UNSURVEYED,
        Values("a strength in dBm, -200 to 100", least=-200.0, most=100.0),
        "rssi",
        doubts={
            "sigma_db": ("shadow_db", "fading_db", "p_blocked", "p_outlier"),
            "p_blocked": ("p_outlier",),
        },
        tagged=True,
    ),
    "amplitude": Kind(
        AmplitudeModel,
        AmplitudeModel(),
        Values("a finite number"),
        "amplitude",
    ),
    "energy_message": Kind(
        EnergyMessageModel,
        EnergyMessageModel(),
        Values("a code word, a whole number of 0 or more", least=0.0, most=2.0**51),
        "energy_message",
    ),
}


def kind_of(model: SensorModel) -> str:
    """Name the kind of a model."""
    return next(name for name, kind in KINDS.items() if isinstance(model, kind.parameters))


def families(models: Iterable[SensorModel]) -> tuple[Family, ...]:
    """Name the families of kinds among `models`, in order of appearance."""
    return tuple(dict.fromkeys(KINDS[kind_of(model)].family for model in models))
