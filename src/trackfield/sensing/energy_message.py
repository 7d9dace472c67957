"""Energy messages: what one sensor says of a whole pass of a target in one code word, Berger."""

from __future__ import annotations

from dataclasses import dataclass

from trackfield.sensing.amplitude import Fading


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
