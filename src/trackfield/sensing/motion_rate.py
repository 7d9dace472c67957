"""Motion sensors: how fast a target moves across the line of sight, whichever way, Cheng (3)."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MotionRateModel:
    """Reading z = |v_perp| / r^falloff + n of a target at distance r, Cheng (3).

    v_perp is the part of its velocity that is perpendicular to the line of sight; n ~ N(0,
    sigma^2). With a falloff of 1 it is the size of the angular rate [rad/s]. Below `threshold` a
    sensor stays silent. `max_range_m` is how far it sees.
    """

    falloff: float = 1.0
    sigma: float = 0.01
    threshold: float = 0.0
    max_range_m: float = math.inf
