"""Estimates made by hand, and a tracker that believes whatever it is told, for the hierarchy."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.association.contract import (
    Alternative,
    Estimates,
    Explanation,
    Info,
    ReportScan,
)

SPREAD = np.diag([0.04, 0.04, 0.01, 0.01])


def believed(
    t_s: float,
    rows: Sequence[tuple[int, float, float]],
    *,
    speed=(1.0, 0.0),
    first_s=0.0,
    **columns,
) -> Estimates:
    """Estimates of (identity, x, y), surely there and shown unless `columns` say otherwise."""
    n = len(rows)
    mean = np.array([[x, y, 1.0, 0.0] for _, x, y in rows], float).reshape(n, 4)
    whole = Estimates(
        t_s=t_s,
        track=np.array([row[0] for row in rows], np.int32),
        existence=np.full(n, 0.9),
        mean=mean,
        covariance=np.tile(SPREAD, (n, 1, 1)),
        first_s=np.broadcast_to(np.asarray(first_s, float), n).copy(),
        detected=np.ones(n, bool),
        shown=np.ones(n, bool),
    )
    return whole._replace(**{name: np.asarray(value) for name, value in columns.items()})


class Seen(NamedTuple):
    """State of `Believer`: time, and (track, x, y, first_s) of what it saw last."""

    t_s: float
    tracks: tuple[tuple[int, float, float, float], ...]
    numbers: int


class Believer:
    """Every report within 3 m of a track is that track's, any other begins one; no misses."""

    def initial(self) -> Seen:
        return Seen(-np.inf, (), 0)

    def step(self, state: Seen, scan: ReportScan, late: Sequence[ReportScan] = ()):
        rest, tracks, numbers = list(state.tracks), [], state.numbers
        for x, y in scan.position.tolist():
            near = [t for t in rest if np.hypot(t[1] + 1.0 - x, t[2] - y) < 3.0]
            if near:
                rest.remove(near[0])
                tracks.append((near[0][0], x, y, near[0][3]))
            else:
                numbers += 1
                tracks.append((numbers, x, y, scan.t_s))
        return Seen(scan.t_s, tuple(tracks), numbers), Info({"late": len(late)}, {"p": 0.5}, 1)

    def estimates(self, state: Seen, lag_steps: int = 0) -> Estimates:
        rows = [(n, x - lag_steps, y) for n, x, y, _ in state.tracks]
        return believed(state.t_s - lag_steps, rows, first_s=[t[3] for t in state.tracks])

    def explain(self, state: Seen, track: int) -> Explanation | None:
        for number, _, _, first_s in state.tracks:
            if number == track:
                return Explanation(track, 0.9, first_s, (Alternative(1.0, (track,)),))
        return None

    def encode(self, state: Seen) -> bytes:
        return json.dumps(state).encode()

    def decode(self, data: bytes) -> Seen:
        t_s, tracks, numbers = json.loads(data)
        return Seen(t_s, tuple(map(tuple, tracks)), numbers)
