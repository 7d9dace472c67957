"""What happens to nodes at a time: orders that change their modes, messages that pass them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackfield.errors import InputError
from trackfield.network.relays import Relays
from trackfield.types import Indices, Vector

END = -1  # after the last node of a path
Rows = NDArray[np.bool_] | NDArray[np.intp] | slice


class Messages(NamedTuple):
    """Messages sent at `t_s` (m,) with `bits` (m,) along `path` (m, l), nodes in their order.

    A path begins with who sends; every other entry is one hop, and -1 follows the last. Numbers
    from n on, the number of nodes, are sinks, which spend nothing that counts. A path of one node
    leads nowhere: the message costs nothing and does not arrive.
    """

    t_s: Vector
    bits: Vector
    path: Indices

    def rows(self, rows: Rows) -> Messages:
        """Messages by a mask (m,), numbers or a slice, in that order."""
        return Messages(self.t_s[rows], self.bits[rows], self.path[rows])


class Orders(NamedTuple):
    """Changes of modes: at `t_s` (c,) `node` (c,) goes into `mode` (c,)."""

    t_s: Vector
    node: Indices
    mode: Indices

    def rows(self, rows: Rows) -> Orders:
        """Orders by a mask (c,), numbers or a slice, in that order."""
        return Orders(self.t_s[rows], self.node[rows], self.mode[rows])


class Events(NamedTuple):
    """Orders and messages, each in order of time; `number` (m,) is the message's place as told."""

    orders: Orders
    messages: Messages
    number: NDArray[np.intp]

    def times(self) -> Vector:
        """Give the different times at which something happens, rising."""
        return np.unique(np.concatenate([self.orders.t_s, self.messages.t_s]))

    def cut(self, t_s: float) -> tuple[Events, Events]:
        """Split into what happens before `t_s` and what happens from then on."""
        c = int(np.searchsorted(self.orders.t_s, t_s))
        m = int(np.searchsorted(self.messages.t_s, t_s))
        before = Events(self.orders.rows(slice(c)), self.messages.rows(slice(m)), self.number[:m])
        rest = slice(c, None), slice(m, None)
        after = Events(self.orders.rows(rest[0]), self.messages.rows(rest[1]), self.number[m:])
        return before, after


def no_messages() -> Messages:
    """Make a table of no messages."""
    return Messages(np.zeros(0), np.zeros(0), np.zeros((0, 1), np.int32))


def messages_along(t_s: ArrayLike, bits: ArrayLike, paths: list[list[int]]) -> Messages:
    """Make messages that take these `paths`, of `trackfield.network.relays` or any other."""
    longest = max(map(len, paths), default=1)
    path = np.full((len(paths), longest), END, np.int32)
    for row, nodes in zip(path, paths, strict=True):
        row[: len(nodes)] = nodes
    return _checked(t_s, bits, path)


def messages_to_sinks(t_s: ArrayLike, bits: ArrayLike, *, senders: Indices, way: Relays
) -> Messages:  # fmt: skip
    """Make messages of `senders` (m,) that go to the sinks on the relays' way."""
    n = way.next_node.size
    onward = np.append(way.next_node, END)  # the last entry stands for sinks and for the end
    columns = [np.asarray(senders, np.int32)]
    while True:
        here = columns[-1]
        there = onward[np.where((here >= 0) & (here < n), here, n)]
        if not (there != END).any():
            return _checked(t_s, bits, np.stack(columns, axis=1))
        columns.append(there)


def check_paths(messages: Messages, nodes: int) -> None:
    """Refuse paths that do not begin with a node, go on from a sink, or have gaps."""
    path = messages.path
    goes_on = path[:, 1:] != END
    sends = (path[:, :-1] >= 0) & (path[:, :-1] < nodes)
    sound = (~goes_on | sends).all(axis=1) & (path >= END).all(axis=1)
    sound &= (path[:, 0] >= 0) & (path[:, 0] < nodes)
    if not sound.all():
        wrong = path[int(np.argmin(sound))]
        raise InputError(
            f"messages: found the path {wrong.tolist()}, expected nodes below {nodes}, then at "
            "most one sink, and -1 at the end only"
        )


def events_of(orders: Orders, messages: Messages) -> Events:
    """Bring orders and messages into the order of time; equal times stay as they are."""
    by_time = np.argsort(orders.t_s, kind="stable")
    number = np.argsort(messages.t_s, kind="stable")
    return Events(orders.rows(by_time), messages.rows(number), number)


def _checked(t_s: ArrayLike, bits: ArrayLike, path: Indices) -> Messages:
    t, b = (np.broadcast_to(np.asarray(x, np.float64), len(path)).copy() for x in (t_s, bits))
    if not (np.isfinite(t).all() and np.isfinite(b).all() and (b >= 0.0).all()):
        raise InputError("messages: found times or bits that are no number, or bits below 0")
    return Messages(t, b, path)
