"""Belief about one beacon, as a value and as bytes."""

from __future__ import annotations

import json
import math
import struct
from typing import Any, NamedTuple

import numpy as np

from trackfield.errors import StateError
from trackfield.filtering.rssi_cloud import Cloud
from trackfield.types import Indices

_VERSION = 1


class RssiState(NamedTuple):
    """Belief about one beacon; nothing in it is ever written to."""

    t_s: float = -math.inf  # of the last scan
    moved_s: float = -math.inf  # for which the particles stand
    heard: int = 0  # readings since the particles were spread
    draws: int = 0  # random streams used
    born: int = 0  # `draws` when the particles were spread: the name of the track
    nis: float = math.nan
    cloud: Cloud | None = None
    parent: Indices | None = None  # of each particle in the state before, -1: none; None: itself


def pack(state: RssiState) -> bytes:
    """Write a state: a head of JSON, then its arrays."""
    named = {} if state.cloud is None else dict(state.cloud._asdict())
    if state.parent is not None:
        named["parent"] = state.parent
    head = {
        "version": _VERSION,
        "t_s": state.t_s.hex(),
        "moved_s": state.moved_s.hex(),
        "heard": state.heard,
        "draws": state.draws,
        "born": state.born,
        "nis": state.nis.hex(),
        "arrays": {name: [array.dtype.str, array.shape] for name, array in named.items()},
    }
    text = json.dumps(head).encode()
    body = b"".join(np.ascontiguousarray(array).tobytes() for array in named.values())
    return struct.pack("<I", len(text)) + text + body


def unpack(data: bytes) -> RssiState:
    """Read a state that `pack` wrote; `StateError` for other bytes."""
    try:
        (size,) = struct.unpack_from("<I", data)
        head: dict[str, Any] = json.loads(data[4 : 4 + size])
        if head["version"] != _VERSION:
            raise StateError(f"found version {head['version']} of a beacon, expected {_VERSION}")
        arrays: dict[str, Any] = {}
        at = 4 + size
        for name, (kind, shape) in head["arrays"].items():
            count = math.prod(shape)
            array = np.frombuffer(data, np.dtype(kind), count, at).reshape(shape)
            arrays[name] = array
            at += array.nbytes
        parent = arrays.pop("parent", None)
        return RssiState(
            float.fromhex(head["t_s"]),
            float.fromhex(head["moved_s"]),
            head["heard"],
            head["draws"],
            head["born"],
            float.fromhex(head["nis"]),
            Cloud(**arrays) if arrays else None,
            parent,
        )
    except (ValueError, KeyError, TypeError, AttributeError, struct.error) as error:
        raise StateError(f"found a damaged beacon in a snapshot: {error}") from error
