"""Pursuit as an operator: rows of tracks and where pursuers are in, orders out, step by step."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Iterable

from trackfield.errors import InputError
from trackfield.pipeline.sealing import fingerprint, seal, unseal
from trackfield.pursuit.coordinator import Coordinator
from trackfield.pursuit.coordinator_state import Orders, decode, encode
from trackfield.types import Matrix, Tracks

_COUNTS = ("steps", "holding", "braked", "changed", "troubled")


class Pursuit:
    """Sends pursuers after tracks: `process`, `snapshot`, `restore`.

    It stands beside a tracker, in a live run or a replay. What it orders depends on what it was
    told, on nothing else.
    """

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        self._state = coordinator.initial()
        self._t_s: float | None = None
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> dict[str, int]:
        """What was ordered so far.

        Steps, and of all orders to pursuers: to chase nobody (`holding`), those that had to brake
        (`braked`), assignments that `changed`; and steps in which something was in `trouble`.
        """
        return {**dict.fromkeys(_COUNTS, 0), **self._counts}

    def process(
        self, tracks: Tracks, pursuers: Matrix, *, t_s: float, dismissed: Iterable[int] = ()
    ) -> Orders:
        """Order pursuers (p, width) for the step from `t_s` on, knowing rows of tracks up to then.

        The evaders of `dismissed` tracks are caught. `InputError` for a time that is not after the
        last one, and as `Coordinator.step` says.
        """
        if self._t_s is not None and not t_s > self._t_s:
            raise InputError(f"found orders for {t_s} s after those for {self._t_s} s")
        before = self._state.chased
        self._state, orders = self._coordinator.step(
            self._state, t_s, tracks=tracks, pursuers=pursuers, dismissed=dismissed
        )
        self._t_s = t_s
        pairs = zip(before, self._state.chased, strict=False)
        self._counts.update(
            steps=1,
            holding=int((orders.track < 0).sum()),
            braked=int(orders.braked.sum()),
            changed=sum(a >= 0 and a != b for a, b in pairs),
            troubled=int(bool(orders.trouble)),
        )
        return orders

    def snapshot(self) -> bytes:
        """State of the run as bytes: a versioned header and the coordinator's own; not pickle."""
        head = json.dumps({"t_s": self._t_s, "counts": dict(self._counts)}).encode()
        body = struct.pack("<I", len(head)) + head + encode(self._state)
        return seal(body, self._digest())

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit.

        `StateError` for bytes that are none, damaged, or of another coordinator.
        """
        body = unseal(data, self._digest())
        (size,) = struct.unpack_from("<I", body)
        head = json.loads(body[4 : 4 + size])
        self._state = decode(body[4 + size :])
        self._t_s = head["t_s"]
        self._counts = Counter(head["counts"])

    def _digest(self) -> bytes:
        own = self._coordinator
        shapes = [part.corners.tolist() for part in own.planned.parts]
        return fingerprint(own.vehicle, own.settings, own.body, shapes)
