"""States of a hierarchy as bytes: a JSON head, then the bytes of each group's tracker."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, cast

import numpy as np

from trackfield.association.contract import Estimates
from trackfield.errors import StateError
from trackfield.hierarchy.handover import Handover

_MAGIC = b"TFFIELD1"
_Head = Mapping[str, Any]


def packed(head: _Head, parts: Sequence[bytes]) -> bytes:
    """Join a head, ready for JSON, and parts; numbers come back exactly."""
    text = json.dumps({**head, "sizes": [len(part) for part in parts]}).encode()
    return b"".join((_MAGIC, struct.pack("<Q", len(text)), text, *parts))


def unpacked(data: bytes, *, parts: int) -> tuple[_Head, list[bytes]]:
    """Take apart what `packed` joined; `StateError` for other bytes, or another number of parts."""
    start = len(_MAGIC) + 8
    if data[: len(_MAGIC)] != _MAGIC or len(data) < start:
        raise StateError("found bytes that are not the state of a hierarchy")
    (size,) = struct.unpack_from("<Q", data, len(_MAGIC))
    try:
        head = cast("_Head", json.loads(data[start : start + size]))
        sizes: list[int] = head["sizes"]
    except (ValueError, KeyError, TypeError):
        raise StateError("found a damaged state of a hierarchy") from None
    if len(sizes) != parts or start + size + sum(sizes) != len(data):
        raise StateError("found the state of a hierarchy of other groups, or half of one")
    ends: list[int] = np.cumsum([start + size, *sizes]).tolist()
    return head, [data[a:b] for a, b in pairwise(ends)]


def plain_messages(messages: Sequence[Handover]) -> list[list[Any]]:
    """Write hand-overs as lists of numbers."""
    return [[m.sender, m.target, m.t_s, m.existence, *_lists(m), m.first_s] for m in messages]


def messages_from(plain: Sequence[Sequence[Any]]) -> tuple[Handover, ...]:
    """Read what `plain_messages` wrote."""
    return tuple(
        Handover(sender, target, t_s, existence, np.array(mean), np.array(covariance), first_s)
        for sender, target, t_s, existence, mean, covariance, first_s in plain
    )


def plain_estimates(known: Estimates) -> list[Any]:
    """Write estimates as lists of numbers."""
    return [known.t_s, *(column.tolist() for column in known[1:])]


def estimates_from(plain: Sequence[Any]) -> Estimates:
    """Read what `plain_estimates` wrote."""
    t_s, track, existence, mean, covariance, first_s, detected, shown = plain
    n = len(track)
    return Estimates(
        t_s,
        np.array(track, np.int32),
        np.array(existence, float),
        np.array(mean, float).reshape(n, 4),
        np.array(covariance, float).reshape(n, 4, 4),
        np.array(first_s, float),
        np.array(detected, bool),
        np.array(shown, bool),
    )


def _lists(message: Handover) -> tuple[list[float], list[list[float]]]:
    return message.mean.tolist(), message.covariance.tolist()
