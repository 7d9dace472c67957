"""Received signal strength of a beacon in dBm, which falls with the logarithm of the distance."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RssiModel:
    """Strength z = power_dbm - 10 exponent log10(r) + n of a beacon at distance r [m].

    n ~ N(0, sigma_db^2).
    """

    power_dbm: float = -59.0  # at 1 m
    exponent: float = 2.0
    sigma_db: float = 5.0
    max_range_m: float = math.inf
