"""The room that a target is in: a hidden Markov chain over rooms that changes its mind slowly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.network.rooms import room_shares
from trackfield.network.site import Room
from trackfield.types import Columns, Indices, Names, Status, Tracks, Vector

_FLOOR = 0.02  # probability of any room, whatever a track says: no track is that sure


class RoomRules(NamedTuple):
    """How a room is told from positions.

    Errors of a track are alike for `settle_s`: so long it brings one piece of evidence. People stay
    `stay_s` in a room, in the mean. The room that is shown changes when another one is `sure`.
    """

    settle_s: float = 1.0
    stay_s: float = 60.0
    sure: float = 0.97


class RoomBelief(NamedTuple):
    """Which room a target is in: `probability` (k + 1,) of k rooms, last: of none, at `t_s`.

    `shown` is the number of the room that is told, -1: none.
    """

    t_s: float
    probability: Vector
    shown: int


@dataclass(frozen=True, slots=True, eq=False)
class RoomRows:
    """The rooms of targets, columns (n,), a row a row of the tracks that were shown.

    `room` indexes `room_ids`, -1: in none; `probability` is that of this room. `track` and `target`
    (in `target_ids`) are those of the tracks.
    """

    t_s: Vector
    track: Indices
    target: Indices
    room: Indices
    probability: Vector
    target_ids: tuple[str, ...]
    room_ids: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.t_s.size)

    def columns(self) -> Columns:
        """Columns as in a file; views, not copies."""
        return {
            "t_s": self.t_s,
            "track_id": self.track,
            "target_id": Names(self.target, self.target_ids),
            "room": Names(self.room, self.room_ids),
            "p": self.probability,
        }


Beliefs = Mapping[int, RoomBelief]
"""What is believed of each track, by its number."""


def first_belief(t_s: float, shares: Vector) -> RoomBelief:
    """Believe what a track says when it begins: `shares` (k + 1,) of rooms, last: of none."""
    p = shares + _FLOOR
    return RoomBelief(t_s, p / p.sum(), _number(int(shares.argmax()), shares.size))


def next_belief(
    belief: RoomBelief,
    t_s: float,
    shares: Vector,
    rules: RoomRules = RoomRules(),  # noqa: B008 - immutable
) -> RoomBelief:
    """Condition on a track's `shares` (k + 1,) of rooms at `t_s`.

    Over dt a target leaves its room with 1 - exp(-dt / stay_s), for any other alike; then
    p_k <- p_k share_k^min(dt / settle_s, 1), normalised. `InputError` for a time before the last.
    """
    dt = t_s - belief.t_s
    if not dt >= 0.0:
        raise InputError(f"found a time of {t_s} s, expected none before {belief.t_s} s")
    leaves = -np.expm1(-dt / rules.stay_s)
    p = belief.probability
    p = (1.0 - leaves) * p + leaves * (1.0 - p) / max(p.size - 1, 1)
    p = p * (shares + _FLOOR) ** min(dt / rules.settle_s, 1.0)
    p = p / p.sum()
    best = int(p.argmax())
    changes = p[best] >= rules.sure
    return RoomBelief(t_s, p, _number(best, p.size) if changes else belief.shown)


def follow_rooms(
    rooms: Sequence[Room],
    tracks: Tracks,
    beliefs: Beliefs | None = None,
    *,
    rules: RoomRules = RoomRules(),  # noqa: B008 - immutable
) -> tuple[RoomRows, Beliefs]:
    """Tell the room of every row of `tracks` that is shown, and what is believed then.

    `beliefs` are those that the tracks before these left, so that a run may be cut into pieces.
    `InputError` where there are no rooms.
    """
    if not rooms:
        raise InputError("found no rooms, expected [[rooms]] in the site")
    shown = np.flatnonzero((tracks.status == Status.CONFIRMED) | (tracks.status == Status.COASTING))
    shares = room_shares(rooms, tracks.position[shown, :2], tracks.covariance[shown])
    now = dict(beliefs or {})
    room = np.empty(shown.size, np.int32)
    probability = np.empty(shown.size)
    for i, row in enumerate(shown.tolist()):
        t, track = float(tracks.t_s[row]), int(tracks.track[row])
        last = now.get(track)
        one = first_belief(t, shares[i]) if last is None else next_belief(last, t, shares[i], rules)
        now[track] = one
        room[i], probability[i] = one.shown, one.probability[one.shown]
    rows = RoomRows(
        t_s=tracks.t_s[shown],
        track=tracks.track[shown],
        target=tracks.target[shown],
        room=room,
        probability=probability,
        target_ids=tracks.target_ids,
        room_ids=tuple(one.id for one in rooms),
    )
    return rows, now


def _number(place: int, size: int) -> int:
    """Find the number of a room by its place among the shares; the last is no room, -1."""
    return -1 if place == size - 1 else place
