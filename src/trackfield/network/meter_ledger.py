"""The sums behind `network.meter`: closed over a stretch in which nobody is exhausted, else cut."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.network.energy import Energy, mode_powers
from trackfield.network.meter_events import END, Events, Messages, Orders
from trackfield.types import Indices, Matrix, Mode, Vector

_SENT, _RECEIVED = 4, 5  # columns of `spent_j`, after the four modes
_MODES = 4
_ALL = np.ones(6)  # sums over columns, faster than `sum` over so few


class Ledger(NamedTuple):
    """The part of a `Meter` that changes; columns as there."""

    t_s: float
    mode: Indices
    battery_j: Vector
    spent_j: Matrix
    sent_bits: Vector
    received_bits: Vector
    exhausted_s: Vector

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Nodes (n,) that are not exhausted."""
        return np.isinf(self.exhausted_s)

    @property
    def left_j(self) -> Vector:
        """What is left of each battery (n,) [J]; not above 0 where it could not be afforded."""
        return self.battery_j - self.spent_j @ _ALL


def advance(
    ledger: Ledger, until_s: float, events: Events, *, energy: Energy
) -> tuple[Ledger, list[int]]:
    """Count until `until_s`; also the numbers of the messages that were lost.

    First as if all batteries lasted. If one did not, the stretch is cut in two at the middle of its
    events, and so on until none are left in between: then deaths come one after the other.
    """
    after, lost = _closed(ledger, until_s, events, energy)
    if not (after.alive & (after.left_j <= 0.0)).any():
        return after, lost
    times = events.times()
    if not times.size:
        return _drained(ledger, until_s, energy), []
    if times[-1] == ledger.t_s:
        now, lost = _applied(ledger, events, energy)
        return _drained(now, until_s, energy), lost
    middle = float(times[times.size // 2])
    first, second = events.cut(middle)
    now, lost = advance(ledger, middle, first, energy=energy)
    end, more = advance(now, until_s, second, energy=energy)
    return end, lost + more


def _closed(
    ledger: Ledger, until_s: float, events: Events, energy: Energy
) -> tuple[Ledger, list[int]]:
    """Sum over a stretch as if nobody was exhausted in it."""
    alive = ledger.alive
    orders = events.orders.rows(alive[events.orders.node])
    mode, joules = _dwelt(ledger, until_s, orders, energy)
    spent = ledger.spent_j.copy()
    spent[:, :_MODES] += joules
    after = ledger._replace(t_s=until_s, mode=mode, spent_j=spent)
    if not len(events.messages.t_s):
        return after, []
    posted, sent, received, lost = _posted(events.messages, alive, energy)
    spent[:, _SENT:] += posted
    after = after._replace(
        sent_bits=ledger.sent_bits + sent, received_bits=ledger.received_bits + received
    )
    return after, events.number[lost].tolist()


def _fixed_watts(energy: Energy) -> Vector:
    """Power (4,) [W] of the modes without what a master receives."""
    return 1e-3 * mode_powers(energy, 0)


def _dwelt(
    ledger: Ledger, until_s: float, orders: Orders, energy: Energy
) -> tuple[Indices, Matrix]:
    """Modes at the end (n,), and what was spent in each (n, 4) [J].

    A stretch of a node begins with the ledger's mode or an order, and ends with its next order or
    at the end. Nodes that nobody tells anything have one, and are summed at once.
    """
    n, alive, watts = ledger.mode.size, ledger.alive, _fixed_watts(energy)
    told = np.unique(orders.node)
    order = np.concatenate([np.full(told.size, -1), np.arange(orders.t_s.size)])  # that began it
    node, mode = np.append(told, orders.node), np.append(ledger.mode[told], orders.mode)
    by_node = np.argsort(node, kind="stable")
    node, mode, order = node[by_node], mode[by_node], order[by_node]
    last = np.append(node[1:] != node[:-1], True)[: node.size]
    following = np.where(last, orders.t_s.size, np.append(order[1:], 0)[: node.size])

    came = np.empty(orders.t_s.size, np.int32)  # the mode that each order ends
    came[order[order >= 0]] = np.append(0, mode[:-1])[: node.size][order >= 0]
    times = np.concatenate([[ledger.t_s], orders.t_s, [until_s]])
    received = _received(ledger.mode[alive], came, orders.mode, times) * 1e-3 * energy.rx_mw

    joules = np.zeros((n, _MODES))
    whole = watts[ledger.mode] * (until_s - ledger.t_s)
    whole[ledger.mode == Mode.MASTER] += received[-1]
    joules[np.arange(n), ledger.mode] = np.where(alive, whole, 0.0)
    joules[told] = 0.0
    begin, end = order + 1, following + 1  # places in `times`
    parts = watts[mode] * (times[end] - times[begin])
    parts += np.where(mode == Mode.MASTER, received[end] - received[begin], 0.0)
    np.add.at(joules, (node, mode), parts)
    after = ledger.mode.copy()
    after[node[last]] = mode[last]
    return after, joules


def _received(first: Indices, came: Indices, went: Indices, times: Vector) -> Vector:
    """Sensing nodes a master hears, integrated over time, at each of `times` (c + 2,) [s]."""
    counts: list[NDArray[np.int64]] = []
    for which in (Mode.SENSING, Mode.MASTER):
        change = (went == which).astype(np.int64) - (came == which)
        started = np.count_nonzero(first == which)
        counts.append(started + np.append(0, np.cumsum(change)))
    sensing, masters = counts
    each = np.where(masters > 0, sensing / np.maximum(masters, 1), 0.0)
    return np.append(0.0, np.cumsum(each * np.diff(times)))


def _posted(
    messages: Messages, alive: NDArray[np.bool_], energy: Energy
) -> tuple[Matrix, Vector, Vector, NDArray[np.bool_]]:
    """Energies (n, 2) [J] of sending and receiving, bits of both (n,), and who was lost (m,)."""
    n = alive.size
    works = np.append(alive, True)  # the last stands for all sinks
    path = np.where(messages.path >= n, n, messages.path)
    going = works[path[:, 0]] if len(path) else np.zeros(0, np.bool_)
    lost = ~going | (path[:, 1:2] == END).all(axis=1)
    sent_j, sent, received = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    for sender, receiver in zip(path.T, path[:, 1:].T, strict=False):
        hop = going & (receiver != END)
        bits = messages.bits[hop]
        sent += np.bincount(sender[hop], bits, minlength=n + 1)
        cost = energy.hop_uj + bits * energy.tx_uj_per_bit
        sent_j += np.bincount(sender[hop], cost, minlength=n + 1)
        taken = hop & works[receiver]
        received += np.bincount(receiver[taken], messages.bits[taken], minlength=n + 1)
        lost |= hop & ~taken
        going = taken
    posted = 1e-6 * np.column_stack([sent_j, energy.rx_uj_per_bit * received])
    return posted[:n], sent[:n], received[:n], lost


def _drained(ledger: Ledger, until_s: float, energy: Energy) -> Ledger:
    """Count until `until_s` without events, each node to its own end if that comes sooner.

    Only the end of a sensing or a master node changes what others spend, and only while there is a
    master: the time is cut there.
    """
    while ledger.t_s < until_s:
        alive = ledger.alive
        power, left = watts_of(ledger.mode, alive, energy), np.maximum(ledger.left_j, 0.0)
        lasts = np.divide(left, power, out=np.full(left.size, math.inf), where=power > 0.0)
        tied = alive & (ledger.mode >= Mode.SENSING)
        if not (tied & (ledger.mode == Mode.MASTER)).any():
            tied[:] = False
        soonest = float(lasts[tied].min(initial=math.inf))
        span = min(soonest, until_s - ledger.t_s)
        t_s = until_s if span < soonest else min(ledger.t_s + span, until_s)
        spent = ledger.spent_j.copy()
        spent[np.arange(left.size), ledger.mode] += power * np.minimum(lasts, span)
        over = lasts <= span
        ends = np.minimum(ledger.t_s + np.where(over, lasts, 0.0), until_s)
        exhausted = np.where(over, ends, ledger.exhausted_s)
        ledger = _settled(ledger._replace(spent_j=spent, t_s=t_s, exhausted_s=exhausted), over)
    return ledger


def watts_of(mode: Indices, alive: NDArray[np.bool_], energy: Energy) -> Vector:
    """Power (n,) [W] of each node in these modes (n,); 0 of those that are not `alive` (n,)."""
    sensing, masters = (
        np.count_nonzero(alive & (mode == which)) for which in (Mode.SENSING, Mode.MASTER)
    )
    power = _fixed_watts(energy)[mode]
    power[mode == Mode.MASTER] += 1e-3 * energy.rx_mw * sensing / max(masters, 1)
    return np.where(alive, power, 0.0)


def _settled(ledger: Ledger, over: NDArray[np.bool_]) -> Ledger:
    """Let those that are `over` have spent exactly their batteries."""
    spent = ledger.spent_j.copy()
    spent[over, ledger.mode[over]] += ledger.left_j[over]
    return ledger._replace(spent_j=spent)


def _applied(ledger: Ledger, events: Events, energy: Energy) -> tuple[Ledger, list[int]]:
    """Let events of this moment happen one by one: who cannot afford one is exhausted by it."""
    mode, alive = ledger.mode.copy(), ledger.alive
    for node, new in zip(events.orders.node.tolist(), events.orders.mode.tolist(), strict=True):
        if alive[node]:
            mode[node] = new
    ledger = ledger._replace(
        mode=mode,
        spent_j=ledger.spent_j.copy(),
        sent_bits=ledger.sent_bits.copy(),
        received_bits=ledger.received_bits.copy(),
        exhausted_s=ledger.exhausted_s.copy(),
    )
    _, bits, paths = events.messages
    lost = [
        number
        for number, b, path in zip(
            events.number.tolist(), bits.tolist(), paths.tolist(), strict=True
        )
        if not _arrives(ledger, [node for node in path if node != END], b, energy)
    ]
    return ledger, lost


def _arrives(ledger: Ledger, path: list[int], bits: float, energy: Energy) -> bool:
    """Pass one message on; its costs are written into the ledger's own arrays."""
    send = 1e-6 * (energy.hop_uj + bits * energy.tx_uj_per_bit)
    take = 1e-6 * bits * energy.rx_uj_per_bit
    for sender, receiver in pairwise(path):
        if not _afforded(ledger, sender, send, post=_SENT):
            return False
        ledger.sent_bits[sender] += bits
        if receiver < ledger.mode.size:
            if not _afforded(ledger, receiver, take, post=_RECEIVED):
                return False
            ledger.received_bits[receiver] += bits
    return len(path) > 1


def _afforded(ledger: Ledger, node: int, joules: float, *, post: int) -> bool:
    """Spend, to the last joule if need be; false if that was not enough."""
    if math.isfinite(ledger.exhausted_s[node]):
        return False
    left = float(ledger.battery_j[node] - ledger.spent_j[node].sum())
    ledger.spent_j[node, post] += min(joules, left)
    if left <= joules:
        ledger.exhausted_s[node] = ledger.t_s
    return left >= joules
