"""What a coordinator knows and says: tracks that may be chased, orders, and its state as bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import StateError
from trackfield.hierarchy.archive import packed, unpacked
from trackfield.pursuit.separation import Fleet
from trackfield.types import Indices, Matrix, Status, Tracks, Vector

NOBODY = -1
_VERSION = 1


class Quarry(NamedTuple):
    """A track that may be chased: its state (4,) x, y, vx, vy at `t_s` and variances (4,)."""

    t_s: float
    mean: Vector
    variance: Vector


class State(NamedTuple):
    """What a coordinator knows between orders.

    `quarries` by track; `chased` (p,) is the track that each pursuer was assigned, -1 for none;
    `dismissed` tracks are not chased until the time that stands there [s]; `fleet` is where
    pursuers that keep clear should be.
    """

    quarries: Mapping[int, Quarry]
    chased: tuple[int, ...]
    dismissed: Mapping[int, float]
    fleet: Fleet | None


class Orders(NamedTuple):
    """What pursuers are to do in the step from `t_s` on; all (p, ...).

    `commands` (p, 2) are the vehicle's: thrust, velocity or place to go for. `track` is whom each
    chases, -1: nobody. That is at `evader` (p, 2) [m] now, and to be met at `meeting` (p, 2) [m]
    after `expected_s`; NaN and inf without one. Who chases nobody holds: it brakes and stays.
    `braked` ones had to, to keep clear. Nobody can catch `out_of_reach` tracks; `unchased` ones
    wait for a pursuer. `trouble` says what was left out or could not be had.
    """

    t_s: float
    commands: Matrix
    track: Indices
    evader: Matrix
    meeting: Matrix
    expected_s: Vector
    braked: NDArray[np.bool_]
    out_of_reach: tuple[int, ...]
    unchased: tuple[int, ...]
    trouble: tuple[str, ...]


def learned(
    known: Mapping[int, Quarry], tracks: Tracks, *, until_s: float, density: float
) -> tuple[dict[int, Quarry], list[str]]:
    """Take rows of tracks: who may be chased now, and which rows say nothing.

    An ended track is none to chase, a tentative one only if it was shown before. Rows do not say
    how well a velocity is known: its variance is taken as that of a steady filter of constant
    velocity, driven by white acceleration of `density` q [m^2/s^3], whose position has the row's
    variance P: (2 q^2 P)^(1/3). Rows that are no numbers, or of a later time than `until_s`, are
    left out and said.
    """
    now, doubts = dict(known), list[str]()
    mean = np.column_stack([tracks.position[:, :2], tracks.velocity[:, :2]])
    spread = tracks.covariance[:, [0, 2]]
    variance = np.column_stack([spread, np.cbrt(2.0 * density**2 * np.maximum(spread, 0.0))])
    sound = np.isfinite(tracks.t_s) & np.isfinite(mean).all(axis=1)
    sound &= np.isfinite(variance).all(axis=1) & (spread >= 0.0).all(axis=1)
    for i, name in enumerate(tracks.track.tolist()):
        status, t_s = int(tracks.status[i]), float(tracks.t_s[i])
        before = now.get(name)
        if status == Status.ENDED:
            now.pop(name, None)
        elif not sound[i]:
            doubts.append(f"track {name}: found a row that is not finite, and left it out")
        elif t_s > until_s:
            doubts.append(f"track {name}: found a row of {t_s:g} s, after {until_s:g} s")
        elif status == Status.TENTATIVE and before is None:
            continue
        elif before is None or t_s >= before.t_s:
            now[name] = Quarry(t_s, mean[i], variance[i])
    return now, doubts


def encode(state: State) -> bytes:
    """Write a state as bytes, versioned, not pickle."""
    fleet = None if state.fleet is None else [part.tolist() for part in state.fleet]
    head = {
        "version": _VERSION,
        "quarries": [[k, q.t_s, *q.mean, *q.variance] for k, q in state.quarries.items()],
        "chased": list(state.chased),
        "dismissed": [[name, until_s] for name, until_s in state.dismissed.items()],
        "fleet": fleet,
    }
    return packed(head, [])


def decode(data: bytes) -> State:
    """Read a state that `encode` wrote; `StateError` for other bytes."""
    head, _ = unpacked(data, parts=0)
    if head.get("version") != _VERSION:
        raise StateError("found the state of another version of a coordinator, or of another thing")
    fleet: Any = head["fleet"]
    return State(
        {row[0]: Quarry(row[1], np.array(row[2:6]), np.array(row[6:])) for row in head["quarries"]},
        tuple(head["chased"]),
        dict(head["dismissed"]),
        None if fleet is None else Fleet(*(np.array(p, float).reshape(-1, 2) for p in fleet)),
    )
