"""What every node has spent, and when it is exhausted: a meter for simulations and live runs.

Modes spend power for as long as they last, messages spend energy at every hop. `step` is exact
however time is cut: powers are constant between events, so that energies are sums, and a battery
that ends within a step ends at its own time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.energy import Energy
from trackfield.network.meter_events import (
    Messages,
    Orders,
    check_paths,
    events_of,
    no_messages,
)
from trackfield.network.meter_ledger import Ledger, advance, watts_of
from trackfield.types import Commands, Indices, Matrix, Mode, Vector

POSTS = ("sleeping", "active", "sensing", "master", "sent", "received")
"""What is spent on, in the columns of `Meter.spent_j`: the modes, then messages."""


class Meter(NamedTuple):
    """What nodes `sensor_ids` have spent until `t_s`: `spent_j` (n, 6) [J], by `POSTS`.

    `mode` (n,) is what each does now, `battery_j` (n,) what it could spend, `exhausted_s` (n,) when
    it had, infinite for those that live; `sent_bits` and `received_bits` (n,) count messages.
    """

    energy: Energy
    sensor_ids: tuple[str, ...]
    t_s: float
    mode: Indices
    battery_j: Vector
    spent_j: Matrix
    sent_bits: Vector
    received_bits: Vector
    exhausted_s: Vector

    @property
    def residual_j(self) -> Vector:
        """What is left of each battery (n,) [J]."""
        return np.where(self.alive, self.battery_j - self.spent_j @ np.ones(len(POSTS)), 0.0)

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Nodes (n,) that are not exhausted."""
        return np.isinf(self.exhausted_s)

    @property
    def totals_j(self) -> dict[str, float]:
        """What all nodes together have spent [J], by `POSTS`."""
        return dict(zip(POSTS, self.spent_j.sum(axis=0).tolist(), strict=True))

    @property
    def per_bit_and_hop_j(self) -> float:
        """Energy of messages over the bits sent, each counted at every hop; 0 without any."""
        bits = float(self.sent_bits.sum())
        return float(self.spent_j[:, 4:].sum()) / bits if bits > 0.0 else 0.0

    @property
    def lasts_s(self) -> Vector:
        """For how long each node (n,) would last if all did on what they do now; 0 of exhausted."""
        watts = watts_of(self.mode, self.alive, self.energy)
        forever = np.full(watts.size, math.inf)
        lasting = np.divide(self.residual_j, watts, out=forever, where=watts > 0.0)
        return np.where(self.alive, lasting, 0.0)


class Spent(NamedTuple):
    """What a step spent: `joules` (n,), who was `exhausted` in it, in order of time.

    `undelivered` (m,) tells which of its messages did not arrive: their path leads nowhere, or a
    node on it was exhausted.
    """

    joules: Vector
    exhausted: NDArray[np.intp]
    undelivered: NDArray[np.bool_]


def init(
    energy: Energy,
    sensor_ids: Sequence[str],
    *,
    battery_j: float | Vector | None = None,
    t_s: float = 0.0,
) -> Meter:
    """Begin at `t_s` with all nodes asleep; batteries are those of `energy` if not said."""
    n = len(sensor_ids)
    battery = np.broadcast_to(
        np.asarray(energy.battery_j if battery_j is None else battery_j, np.float64), (n,)
    ).copy()
    if not (battery > 0.0).all():
        raise InputError(f"found a battery of {battery.min()} J, expected batteries above 0")
    nothing = np.zeros(n)
    sleeping = np.full(n, Mode.SLEEPING, np.int32)
    lives = np.full(n, math.inf)
    return Meter(
        energy, tuple(sensor_ids), t_s, sleeping, battery,
        np.zeros((n, len(POSTS))), nothing, nothing.copy(), lives,
    )  # fmt: skip


def step(
    meter: Meter,
    until_s: float,
    *,
    commands: Commands | None = None,
    messages: Messages | None = None,
) -> tuple[Meter, Spent]:
    """Count until `until_s`: powers of modes (`network.energy`), and messages hop by hop.

    Events have times from `meter.t_s` to `until_s`, both included; at one time commands come before
    messages, and messages in their order. Masters share what the sensing nodes send: with n sensing
    and m masters each receives n / m. Exhausted nodes do nothing, and cost nobody anything but who
    sends to them. `InputError` for events of other times, commands to unknown nodes, and paths that
    are none.
    """
    messages = no_messages() if messages is None else messages
    orders = _orders(meter, commands)
    check_paths(messages, len(meter.sensor_ids))
    if not (math.isfinite(until_s) and until_s >= meter.t_s):
        raise InputError(f"until_s: found {until_s}, expected a time from {meter.t_s} s on")
    for name, t_s in (("commands", orders.t_s), ("messages", messages.t_s)):
        if not ((t_s >= meter.t_s) & (t_s <= until_s)).all():
            raise InputError(
                f"{name}: found times outside of {meter.t_s} to {until_s} s, expected them in it"
            )
    ledger = Ledger(
        meter.t_s, meter.mode, meter.battery_j, meter.spent_j,
        meter.sent_bits, meter.received_bits, meter.exhausted_s,
    )  # fmt: skip
    after, lost = advance(ledger, until_s, events_of(orders, messages), energy=meter.energy)
    died = np.flatnonzero(meter.alive & np.isfinite(after.exhausted_s))
    undelivered = np.zeros(len(messages.t_s), np.bool_)
    undelivered[lost] = True
    spent = Spent(
        (after.spent_j - meter.spent_j) @ np.ones(len(POSTS)),
        died[np.argsort(after.exhausted_s[died], kind="stable")],
        undelivered,
    )
    return Meter(meter.energy, meter.sensor_ids, *after), spent


def _orders(meter: Meter, commands: Commands | None) -> Orders:
    """Commands in the meter's own numbers of nodes."""
    if commands is None:
        nothing = np.zeros(0, np.int32)
        return Orders(np.zeros(0), nothing, nothing)
    node = commands.sensor
    if commands.sensor_ids is not meter.sensor_ids and commands.sensor_ids != meter.sensor_ids:
        places = {name: place for place, name in enumerate(meter.sensor_ids)}
        known = np.array([places.get(name, -1) for name in commands.sensor_ids], np.int32)
        node = known[commands.sensor]
        if (node < 0).any():
            name = commands.sensor_ids[int(commands.sensor[int(np.argmax(node < 0))])]
            raise InputError(f"commands: found {name!r}, expected a node of the meter")
    return Orders(commands.t_s, node, commands.mode)
