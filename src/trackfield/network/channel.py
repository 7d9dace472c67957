"""What the radio network does to messages: loss, delay, nodes that are dead."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Channel:
    """How messages travel from a sensor to the leader of its group, Oh III.A and (2).

    Nodes within `hop_m` hear each other. A hop fails with `p_loss`; a message k hops away goes over
    k paths (`multipath`), else over one. Each of its hops is delayed by a step of `delay_step_s`
    again and again with `p_delay`.
    """

    hop_m: float = math.inf
    p_loss: float = 0.0
    p_delay: float = 0.0
    delay_step_s: float = 1.0
    multipath: bool = True
