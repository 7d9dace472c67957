"""Signal strength that falls with distance and adds up over targets, Oh (1)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SignalModel:
    """Strength near a target at distance r: z = amplitude / (1 + falloff r^exponent) + w, Oh (1).

    Beyond `max_range_m` there is nothing but the noise w ~ N(0, sigma^2). `sigma_gain` is the
    relative error of the amplitude, `placement_sigma_m` (per axis) that of the sensor's place: a
    model error that the variance does not know is what ruins fusion.
    """

    amplitude: float = 195.0  # 3 (1 + falloff max_range_m^exponent): three sigma at the edge
    falloff: float = 1.0  # [1/m^exponent]
    exponent: float = 2.0
    max_range_m: float = 8.0
    sigma: float = 1.0
    sigma_gain: float = 0.1
    placement_sigma_m: float = 0.0
