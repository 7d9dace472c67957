"""Amplitudes: how strongly a source of unknown power is received, sample by sample, Berger (2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Fading = Literal["none", "rayleigh"]


@dataclass(frozen=True, slots=True)
class AmplitudeModel:
    """Amplitude a = sqrt(P) / r^exponent of a source of power P at distance r, Berger (2).

    P is unknown. Without `fading` a reading is a + n, n ~ N(0, sigma^2), Berger (4); with
    "rayleigh" it is |h a + w|, h and w complex Gaussian of variances 1 and sigma^2, Berger (37). A
    sensor shows nothing above `saturation`. Its clock is off by N(0, clock_sigma_s^2), once and for
    all.
    """

    exponent: float = 1.0
    sigma: float = 0.1
    fading: Fading = "none"
    saturation: float = math.inf
    clock_sigma_s: float = 0.0
    max_range_m: float = math.inf
