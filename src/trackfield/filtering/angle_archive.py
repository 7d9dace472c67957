"""States of the tracker of angles as bytes: JSON, whose numbers come back exactly."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from trackfield.errors import StateError
from trackfield.filtering.angle_state import AngleState, AngleTrack
from trackfield.filtering.interacting import Modes
from trackfield.filtering.scans import Scan
from trackfield.types import Gaussian

_MAGIC = b"TFANGLE1"


def packed(state: AngleState) -> bytes:
    """Bytes of a state."""
    track = state.track
    plain = {
        "recent": [[s.t_s, *(column.tolist() for column in s[1:])] for s in state.recent],
        "waited": state.waited,
        "number": state.number,
        "alive": state.alive,
        "track": None if track is None else _plain(track),
    }
    return _MAGIC + json.dumps(plain).encode()


def unpacked(data: bytes) -> AngleState:
    """Return the state that was packed; `StateError` for other bytes."""
    if data[: len(_MAGIC)] != _MAGIC:
        raise StateError("found bytes that are not a state of the tracker of angles")
    try:
        plain = json.loads(data[len(_MAGIC) :])
        recent = tuple(
            Scan(t_s, np.array(sensor, np.int32), np.array(value, float), np.array(sigma, float))
            for t_s, sensor, value, sigma in plain["recent"]
        )
        track = None if plain["track"] is None else _track(plain["track"])
        alive = tuple(plain["alive"])
        return AngleState(recent, int(plain["waited"]), int(plain["number"]), track, alive)
    except (ValueError, KeyError, TypeError):
        raise StateError("found a damaged state of the tracker of angles") from None


def _plain(track: AngleTrack) -> dict[str, Any]:
    return {
        **track._asdict(),
        "weights": track.weights.tolist(),
        "evidence": track.evidence.tolist(),
        "modes": [track.modes.weights.tolist(), *_lists(track.modes.beliefs)],
        "prior": _lists(track.prior),
        "whole": _lists(track.whole),
    }


def _track(plain: dict[str, Any]) -> AngleTrack:
    shares, *beliefs = (np.array(column, float) for column in plain["modes"])
    return AngleTrack(
        t_s=float(plain["t_s"]),
        names=tuple(plain["names"]),
        weights=np.array(plain["weights"], float),
        modes=Modes(shares, Gaussian(*beliefs)),
        prior=Gaussian(*(np.array(column, float) for column in plain["prior"])),
        whole=Gaussian(*(np.array(column, float) for column in plain["whole"])),
        nis=float(plain["nis"]),
        misfits=tuple(plain["misfits"]),
        evidence=np.array(plain["evidence"], float),
        confirmed=bool(plain["confirmed"]),
    )


def _lists(belief: Gaussian) -> list[Any]:
    return [belief.mean.tolist(), belief.covariance.tolist()]
