"""A tracker of unknown targets that is as plain as can be: greedy nearest neighbour, all replayed.

The state is the list of the last scans and what was believed before them; every step begins there.
"""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np

from trackfield.association.contract import (
    Alternative,
    Estimates,
    Explanation,
    Info,
    ReportScan,
)
from trackfield.errors import InputError

GATE_M = 3.0
END_MISSES = 5


class Track(NamedTuple):
    number: int
    first_s: float
    t_s: float
    x: float
    y: float
    hits: int
    misses: int
    report: int


class Belief(NamedTuple):
    next_track: int
    tracks: tuple[Track, ...]
    t_s: float


class State(NamedTuple):
    after: Belief
    before: Belief
    scans: tuple[ReportScan, ...]
    dropped: int


def follow(belief: Belief, scan: ReportScan) -> Belief:
    free = list(range(len(scan.number)))
    tracks, next_track = [], belief.next_track
    for track in belief.tracks:
        place = min(
            free,
            key=lambda i: float(np.hypot(*(scan.position[i] - (track.x, track.y)))),
            default=None,
        )
        if place is not None:
            x, y = scan.position[place].tolist()
            if np.hypot(x - track.x, y - track.y) <= GATE_M:
                free.remove(place)
                number = int(scan.number[place])
                tracks.append(
                    track._replace(
                        t_s=scan.t_s, x=x, y=y, hits=track.hits + 1, misses=0, report=number
                    )
                )
                continue
        if track.misses < END_MISSES:
            tracks.append(track._replace(misses=track.misses + 1, report=-1))
    for i in free:
        x, y = scan.position[i].tolist()
        number = int(scan.number[i])
        tracks.append(Track(next_track, scan.t_s, scan.t_s, x, y, 1, 0, number))
        next_track += 1
    return Belief(next_track, tuple(tracks), scan.t_s)


class PlainAssociator:
    def __init__(self, window: int = 10) -> None:
        self.window = window
        self.steps = 0

    def initial(self) -> State:
        return State(Belief(1, (), -np.inf), Belief(1, (), -np.inf), (), 0)

    def step(self, state, scan, late=()):
        self.steps += 1
        if state.scans and scan.t_s <= state.scans[-1].t_s:
            raise InputError("scans out of order")
        scans, dropped = list(state.scans), state.dropped
        for one in late:
            for i, known in enumerate(scans):
                if known.t_s == one.t_s:
                    both = [np.concatenate(pair) for pair in zip(known[1:], one[1:], strict=True)]
                    order = np.lexsort((both[0][:, 1], both[0][:, 0]))
                    scans[i] = ReportScan(one.t_s, *(column[order] for column in both))
                    break
            else:
                dropped += len(one.number)
        scans.append(scan)
        before = state.before
        while len(scans) > self.window:
            before = follow(before, scans.pop(0))
        after = follow(state.after, scan)
        if late:
            after = before
            for one in scans:
                after = follow(after, one)
        return State(after, before, tuple(scans), dropped), Info({"scans": 1}, {"false": 0.5}, 1)

    def belief(self, state, lag_steps=0):
        if lag_steps == 0:
            return state.after
        belief = state.before
        for scan in state.scans[: len(state.scans) - lag_steps]:
            belief = follow(belief, scan)
        return belief

    def estimates(self, state, lag_steps=0):
        belief = self.belief(state, lag_steps)
        tracks = belief.tracks
        n = len(tracks)
        existence = np.array([1 - 0.5**t.hits * 0.7 for t in tracks]) * [
            0.8**t.misses for t in tracks
        ]
        return Estimates(
            belief.t_s,
            np.array([t.number for t in tracks], np.int32),
            existence,
            np.array([(t.x, t.y, 0.5, 0.0) for t in tracks]).reshape(n, 4),
            np.tile(np.eye(4), (n, 1, 1)),
            np.array([t.first_s for t in tracks]),
            np.array([t.misses == 0 for t in tracks], bool),
            np.array([t.hits >= 2 and t.misses <= 2 for t in tracks], bool),
        )

    def explain(self, state, track):
        for one in self.belief(state).tracks:
            if one.number == track:
                return Explanation(track, 1.0, one.first_s, (Alternative(1.0, (one.report,)),))
        return None

    def encode(self, state):
        scans = [[s.t_s, *(part.tolist() for part in s[1:])] for s in state.scans]
        return json.dumps([state.after, state.before, scans, state.dropped]).encode()

    def decode(self, data):
        after, before, scans, dropped = json.loads(data)
        made = [
            ReportScan(
                t,
                np.array(p, float).reshape(-1, 2),
                np.array(c, float).reshape(-1, 3),
                np.array(n, np.int32),
            )
            for t, p, c, n in scans
        ]
        return State(_belief(*after), _belief(*before), tuple(made), dropped)


def _belief(next_track, tracks, t_s):
    return Belief(next_track, tuple(Track(*t) for t in tracks), t_s)
