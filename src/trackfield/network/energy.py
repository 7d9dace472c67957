"""What sensor nodes spend: powers of their modes, bits and hops, Pham 2.5.1 and 5.5."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from trackfield.errors import InputError
from trackfield.types import Vector


@dataclass(frozen=True, slots=True)
class Energy:
    """Powers [mW] of what a node does, energies [uJ] of what it sends, its battery [J].

    Transmitting, receiving, idling and sleeping as in Pham 2.5.1; Pham names powers of measuring
    and computing and gives no values: 100 mW each are assumed. A message of b bits costs who sends
    it `hop_uj` + b `tx_uj_per_bit`, and who receives it b `rx_uj_per_bit`, at every hop; the usual
    values are the powers over 250 kbit/s. `InputError` for what is below 0 or no number.
    """

    tx_mw: float = 1400.0
    rx_mw: float = 1000.0
    idle_mw: float = 830.0
    sleep_mw: float = 130.0
    sense_mw: float = 100.0
    compute_mw: float = 100.0
    tx_uj_per_bit: float = 5.6
    rx_uj_per_bit: float = 4.0
    hop_uj: float = 0.0
    battery_j: float = 20000.0  # two cells of the size AA
    reading_bits: int = 128  # who, when, what
    report_bits: int = 256  # position and covariance, to the sink
    state_bits: int = 512  # 4 states and 10 covariances of 32 bits, who and when

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            above = field.name == "battery_j"
            if not (math.isfinite(value) and (value > 0.0 if above else value >= 0.0)):
                expected = "a finite number above 0" if above else "a finite number, 0 or more"
                raise InputError(f"energy.{field.name}: found {value}, expected {expected}")


def mode_powers(energy: Energy, sensing: ArrayLike = 3) -> Vector:
    """Powers (..., 4) [mW] of the modes sleeping, active, sensing, master, Pham 5.5.

    s0 = sleep, s1 = rx + idle, s2 = rx + sense + tx + idle, s3 = tx + n rx + compute + idle, where
    the master hears n = `sensing` (...) nodes; what Pham calls active power is the idle one.
    """
    n = np.asarray(sensing, np.float64)
    if not (np.isfinite(n) & (n >= 0.0)).all():
        raise InputError(f"found {n.tolist()} sensing nodes, expected counts of 0 or more")
    listening = energy.rx_mw + energy.idle_mw
    master = energy.tx_mw + n * energy.rx_mw + energy.compute_mw + energy.idle_mw
    flat = (energy.sleep_mw, listening, listening + energy.sense_mw + energy.tx_mw)
    return np.stack([*(np.broadcast_to(power, n.shape) for power in flat), master], axis=-1)


def mode_energies(energy: Energy, interval_s: float, *, sensing: ArrayLike = 3) -> Vector:
    """Energies (..., 4) [J] of one interval in each mode; powers as `mode_powers`."""
    return mode_powers(energy, sensing) * (1e-3 * interval_s)


def network_power(
    energy: Energy,
    nodes: int,
    *,
    measuring: ArrayLike,
    warned: ArrayLike,
    watching: ArrayLike = 0,
    constant_mw: float = 0.0,
) -> Vector:
    """Power (...) [mW] of a field of `nodes` in one sampling cycle, Pham (2.27)-(2.31).

    n_a (tx + rx) + (n_a + n_i) rx + tx + (n_b + n_i) idle + (n - n_a - n_i - n_b) sleep + c, with
    n_a = `measuring` (...) nodes, n_i = `warned` ones in the region of activation that do not
    measure, and n_b = `watching` ones outside of it. Pham's Table 2.1 needs c = `constant_mw` of
    56 W, which the text does not explain. `InputError` if there are more of them than nodes.
    """
    n_a, n_i, n_b = (np.asarray(count, np.float64) for count in (measuring, warned, watching))
    asleep = nodes - n_a - n_i - n_b
    if not all((count >= 0.0).all() for count in (n_a, n_i, n_b, asleep)):
        raise InputError(
            f"found counts of nodes below 0, or more than there are ({nodes}), expected parts of it"
        )
    measured = n_a * (energy.tx_mw + energy.rx_mw)
    told = (n_a + n_i) * energy.rx_mw + energy.tx_mw
    resting = (n_b + n_i) * energy.idle_mw + asleep * energy.sleep_mw
    return np.asarray(measured + told + resting + constant_mw, np.float64)


def message_energy(energy: Energy, bits: ArrayLike, hops: ArrayLike) -> Vector:
    """Energy (...) [J] that all nodes together spend on messages of `bits` over `hops`."""
    b, k = np.asarray(bits, np.float64), np.asarray(hops, np.float64)
    if not ((b >= 0.0) & (k >= 0.0)).all():
        raise InputError("found bits or hops below 0, expected 0 or more of both")
    return 1e-6 * k * (energy.hop_uj + b * (energy.tx_uj_per_bit + energy.rx_uj_per_bit))
