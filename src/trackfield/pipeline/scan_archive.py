"""Streams of scans as bytes, and back: a head of JSON, then the states that their filter packs."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Mapping
from typing import Any, cast

from trackfield.errors import StateError
from trackfield.filtering.scans import ScanFilter, State
from trackfield.pipeline.scan_stream import Said, ScanStream, StreamLife, StreamMoment

_Plain = list[Any]


def pack_stream(stream: ScanStream[State], model: ScanFilter[State]) -> bytes:
    """Write a stream; `unpack_into` makes one of it that goes on bit by bit."""
    lives = [stream.life, *(moment.life for moment in stream.history)]
    states = [b"" if life is None else model.pack(life.state) for life in lives]
    head = {
        "lives": [life and life[1:] for life in lives],  # numbers of JSON come back exactly
        "moments": [
            [moment.t_s, _plain_said(moment.said), moment.due] for moment in stream.history
        ],
        "open": [stream.open_s, _plain_said(stream.open)],
        "times": [stream.dirty_s, stream.told_s],
        "counts": dict(stream.counts),
        "sizes": [len(state) for state in states],
    }
    text = json.dumps(head).encode()
    return b"".join((struct.pack("<I", len(text)), text, *states))


def unpack_into(stream: ScanStream[State], data: bytes, model: ScanFilter[State]) -> None:
    """Put a stream into the state that was packed; `StateError` for other bytes."""
    try:
        (size,) = struct.unpack_from("<I", data)
        head = cast("Mapping[str, Any]", json.loads(data[4 : 4 + size]))
        at, lives = 4 + size, list[StreamLife[State] | None]()
        for plain, length in zip(head["lives"], head["sizes"], strict=True):
            state = data[at : at + length]
            lives.append(None if plain is None else StreamLife(model.unpack(state), *plain))
            at += length
        if at != len(data):
            raise StateError("found a snapshot that is longer or shorter than its contents")
        history = [
            StreamMoment(t_s, _said(plain), life, due)
            for (t_s, plain, due), life in zip(head["moments"], lives[1:], strict=True)
        ]
        stream.open_s, stream.open = head["open"][0], _said(head["open"][1])
        stream.dirty_s, stream.told_s = head["times"]
        stream.counts = Counter(head["counts"])
    except (ValueError, KeyError, TypeError, IndexError, struct.error) as error:
        raise StateError(f"found damaged scans in a snapshot: {error}") from error
    if lives[0] is None or history[0].life is None:
        raise StateError("found a history without a state to begin with")
    stream.life, stream.history = lives[0], history


def _plain_said(said: Mapping[int, Said]) -> _Plain:
    return [[sensor, *one] for sensor, one in said.items()]


def _said(plain: _Plain) -> dict[int, Said]:
    return {sensor: Said(value, sigma) for sensor, value, sigma in plain}
