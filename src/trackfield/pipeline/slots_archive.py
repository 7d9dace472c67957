"""Steps of a run as bytes, and back."""

from __future__ import annotations

import json
import struct
from collections import Counter
from typing import Any

import numpy as np

from trackfield.errors import StateError
from trackfield.pipeline.slots import Rules, Slot, Slots, row_keys


def pack(slots: Slots) -> bytes:
    """Write the steps: a head of JSON, then the rows of each as doubles."""
    waiting = [] if slots.waiting is None else [slots.waiting]
    every = [*slots.kept.items(), *waiting]
    head = {
        "width": slots.width,
        "phase_s": None if slots.phase_s is None else slots.phase_s.hex(),
        "closed": slots.closed,
        "slots": [[number, one.count, one.given] for number, one in every],
        "waits": len(waiting),
        "counts": dict(slots.counts),
    }
    rows = b"".join(one.rows(slots.width).astype("<f8").tobytes() for _, one in every)
    text = json.dumps(head).encode()
    return struct.pack("<I", len(text)) + text + rows


def unpack(data: bytes, rules: Rules) -> Slots:
    """Read steps that `pack` wrote; `StateError` for other bytes."""
    try:
        (size,) = struct.unpack_from("<I", data)
        head: dict[str, Any] = json.loads(data[4 : 4 + size])
        numbers = np.frombuffer(data[4 + size :], "<f8").astype(np.float64)
        rows = numbers.reshape(-1, head["width"])
        every: list[tuple[int, Slot]] = []
        start = 0
        for number, count, given in head["slots"]:
            own = rows[start : start + count]
            every.append((number, Slot([own], count, given, set(row_keys(own, rules.keys)))))
            start += count
        kept = every[: len(every) - head["waits"]]
        return Slots(
            rules,
            head["width"],
            phase_s=None if head["phase_s"] is None else float.fromhex(head["phase_s"]),
            closed=head["closed"],
            kept=dict(kept),
            waiting=every[-1] if head["waits"] else None,
            counts=Counter(head["counts"]),
        )
    except (ValueError, KeyError, TypeError, struct.error) as error:
        raise StateError(f"found damaged steps in a snapshot: {error}") from error
