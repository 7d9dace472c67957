"""What the radio network does to messages: loss, delay, garbled contents, Oh III.A and (2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc, gammaln, xlogy

from trackfield.errors import InputError
from trackfield.types import Vector

_STEP_SLACK = 1e-9  # of a delay step: an age of three steps is three steps, however it was computed


@dataclass(frozen=True, slots=True)
class Channel:
    """How messages travel from a sensor to the leader of its group, Oh III.A and (2).

    Nodes within `hop_m` hear each other. A hop fails with `p_loss`; a message k hops away goes over
    k paths (`multipath`), else over one. Each of its hops is delayed by a step of `delay_step_s`
    again and again with `p_delay`. A message that arrives has wrong contents with `p_garbled`. A
    sensor belongs to the nearest leader, or with `fewest_links` to the one that is the fewest hops
    away. `InputError` for probabilities outside [0, 1] and lengths that are not above 0.
    """

    hop_m: float = math.inf
    p_loss: float = 0.0
    p_delay: float = 0.0
    delay_step_s: float = 1.0
    multipath: bool = True
    p_garbled: float = 0.0
    fewest_links: bool = False

    def __post_init__(self) -> None:
        for name in ("p_loss", "p_delay", "p_garbled"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InputError(f"{name}: found {value}, expected a probability from 0 to 1")
        if not self.hop_m > 0.0:
            raise InputError(f"hop_m: found {self.hop_m}, expected a length above 0")
        if not 0.0 < self.delay_step_s < math.inf:
            raise InputError(f"delay_step_s: found {self.delay_step_s}, expected a time above 0")


class Delivery(NamedTuple):
    """What became of messages, all (n,): `arrival_s` is infinite for one that never arrives."""

    arrival_s: Vector
    garbled: NDArray[np.bool_]  # arrives, with wrong contents

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Whether it arrives at all, (n,)."""
        return np.isfinite(self.arrival_s)


def delivery_probability(channel: Channel, hops: ArrayLike, *, printed: bool = False) -> Vector:
    """p_cs = 1 - (1 - (1 - p_loss)^k)^k of messages k hops away, Oh III.A, corrected.

    One path only, (1 - p_loss)^k, where the channel is not `multipath`. `hops` (...) of -1 means no
    way at all: 0; of 0, at the leader itself: 1. `printed` gives Oh's 1 - (1 - p_loss)^k instead,
    which grows with loss.
    """
    k = _hops(hops)
    whole_path = (1.0 - channel.p_loss) ** np.maximum(k, 0)
    if printed:
        p = 1.0 - whole_path
    elif channel.multipath:
        p = 1.0 - (1.0 - whole_path) ** np.maximum(k, 1)
    else:
        p = whole_path
    return np.where(k < 0, 0.0, np.where(k == 0, 1.0, p))


def delay_probability(p_delay: float, hops: ArrayLike, delays: ArrayLike) -> Vector:
    """P(d) = C(k + d - 1, d) (1 - p_delay)^k p_delay^d: d delays over k hops, Oh (2)."""
    k, d = np.broadcast_arrays(_hops(hops), np.asarray(delays))
    some, whole = np.maximum(k, 1), np.maximum(d, 0)
    log_ways = gammaln(some + whole) - gammaln(whole + 1.0) - gammaln(some)
    p = np.exp(log_ways + xlogy(some, 1.0 - p_delay) + xlogy(whole, p_delay))
    return np.where(d < 0, 0.0, np.where(k == 0, np.asarray(d == 0, np.float64), p))


def delayed_at_most(p_delay: float, hops: ArrayLike, delays: ArrayLike) -> Vector:
    """P(d <= delays) of Oh (2), in closed form: I_{1 - p_delay}(k, delays + 1)."""
    k, d = np.broadcast_arrays(_hops(hops), np.asarray(delays))
    p = betainc(np.maximum(k, 1), np.maximum(d, 0) + 1.0, 1.0 - p_delay)
    return np.where(d < 0, 0.0, np.where(k == 0, 1.0, p))


def arrived_within(channel: Channel, hops: ArrayLike, elapsed_s: ArrayLike) -> Vector:
    """P(a message sent `elapsed_s` ago has been delivered and has arrived by now)."""
    delays = np.floor(np.asarray(elapsed_s) / channel.delay_step_s + _STEP_SLACK)
    waited = delayed_at_most(channel.p_delay, hops, delays)
    return delivery_probability(channel, hops) * waited


def transmit(
    channel: Channel, rng: np.random.Generator, *, t_s: Vector, hops: NDArray[np.int32]
) -> Delivery:
    """Draw what becomes of messages sent at `t_s` (n,) from nodes `hops` (n,) away."""
    arrives = rng.random(t_s.size) < delivery_probability(channel, hops)
    delayed = np.zeros(t_s.size)
    if channel.p_delay == 1.0:  # every hop is put off for ever
        delayed[hops > 0] = math.inf
    elif channel.p_delay > 0.0:
        delays = rng.negative_binomial(np.maximum(hops, 1), 1.0 - channel.p_delay)
        delayed = np.where(hops > 0, channel.delay_step_s * delays, 0.0)
    arrival_s = np.where(arrives, t_s + delayed, math.inf)
    wrong = rng.random(t_s.size) < channel.p_garbled
    return Delivery(arrival_s, wrong & np.isfinite(arrival_s))


def _hops(hops: ArrayLike) -> NDArray[np.int64]:
    return np.asarray(hops, np.int64)
