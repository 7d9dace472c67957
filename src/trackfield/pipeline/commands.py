"""Tracks in, commands out: what each sensor node is to do next, as an operator.

It stands beside a tracker, in a live run or a replay: rows of tracks go in as they are shown, and
changes of the nodes' modes come out, time by time.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.site import Site
from trackfield.pipeline.scene import network_of
from trackfield.pipeline.scheduled import accel_density, scheduler_of
from trackfield.pipeline.sealing import fingerprint, seal, unseal
from trackfield.scheduling.scheduler_state import (
    Told,
    decode,
    encode,
    joined,
    nobody,
    sighted_from,
    sighted_rows,
)
from trackfield.types import Commands, Tracks, Vector, join_rows, select_rows

_EARLY = 1e-9  # of an interval: times that differ by rounding are the same
_COUNTS = ("intervals", "commands", "handovers", "late", "lost")
_MOST_IDLE = 2000  # intervals without a track that are commanded one by one


class Commander:
    """Tells the sensor nodes of a site what to do: `process`, `snapshot`, `restore`.

    Commands are told at multiples of `interval_s`, from what rows of tracks said before; all nodes
    sleep until the first. Those for a time are settled when a row of that time or a later one
    comes, for who measured it had been told by then, or when a watermark says that no earlier one
    will: so they do not depend on how rows were cut into tables. A row that comes late counts from
    the next commands on. Nodes whose messages reach nobody, by the site's `[network]`, are told
    nothing.
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._scheduler = scheduler_of(site)
        self._density = accel_density(site.target)
        self._interval_s = site.scheduling.interval_s
        self._connected: NDArray[np.bool_] = np.ones(len(site.sensor_ids), np.bool_)
        network = network_of(site)
        if network is not None:
            self._connected[network.cut_off] = False
        self._residual: Vector = np.ones(len(site.sensor_ids))
        self._state = self._scheduler.initial()
        self._waiting = nobody()  # what was sighted since the last commands
        self._next: int | None = None  # number of the interval that is commanded next
        self._newest_s = -math.inf
        self._told: tuple[Told, ...] = ()
        self._counts: dict[str, int] = dict.fromkeys(_COUNTS, 0)

    @property
    def modes(self) -> NDArray[np.int8]:
        """Modes (n,) that the nodes were told last, by `Mode`."""
        return self._state.modes

    @property
    def told(self) -> tuple[Told, ...]:
        """What the last call settled, interval by interval: who serves which track, how well."""
        return self._told

    @property
    def counts(self) -> dict[str, int]:
        """Intervals, changes of modes, hand-overs, nodes that woke late, and tracks lost."""
        return dict(self._counts)

    def tell_energy(self, residual: Vector) -> None:
        """Tell which share (n,) of its energy each node has left: it holds from now on.

        `InputError` for what is no share.
        """
        told = np.asarray(residual, np.float64)
        if told.shape != self._residual.shape or not ((told >= 0.0) & (told <= 1.0)).all():
            raise InputError(
                f"residuals of shape {told.shape}: expected ({self._residual.size},) from 0 to 1"
            )
        self._residual = told

    def process(self, tracks: Tracks, *, watermark_s: float | None = None) -> Commands:
        """Take rows, in the order in which they were shown; return the commands settled by now.

        No row with a time up to `watermark_s` may follow, but for late ones.
        """
        self._told, found = (), [self._nothing()]
        for rows, t_s in self._by_time(tracks):
            if self._next is None:
                self._next = math.floor(t_s / self._interval_s + _EARLY)
            found += self._settled(math.floor(t_s / self._interval_s + _EARLY))
            self._waiting = joined(self._waiting, sighted_rows(rows, self._density))
            self._newest_s = t_s
        if watermark_s is not None:
            last = math.floor(watermark_s / self._interval_s + _EARLY)
            self._next = last if self._next is None else self._next
            found += self._settled(last)
        return join_rows(found)

    def snapshot(self) -> bytes:
        """State of the run as bytes: a versioned header and the scheduler's own; not pickle."""
        head = json.dumps(
            {
                "next": self._next,
                "newest_s": None if self._next is None else self._newest_s,
                "counts": self._counts,
                "residual": self._residual.tolist(),
                "waiting": [column.tolist() for column in self._waiting],
            }
        ).encode()
        body = struct.pack("<I", len(head)) + head + encode(self._state)
        return seal(body, self._digest())

    def restore(self, data: bytes) -> None:
        """Take up the run where `snapshot` left it: all that follows is the same bit by bit."""
        body = unseal(data, self._digest())
        (size,) = struct.unpack_from("<I", body)
        head = json.loads(body[4 : 4 + size])
        self._state = decode(body[4 + size :], nodes=len(self._site.sensor_ids))
        self._next, self._counts = head["next"], head["counts"]
        self._newest_s = -math.inf if head["newest_s"] is None else head["newest_s"]
        self._residual = np.array(head["residual"])
        self._waiting = sighted_from(head["waiting"])
        self._told = ()

    def _by_time(self, tracks: Tracks) -> Iterator[tuple[Tracks, float]]:
        """Rows that count at one time together: their own, or that of an earlier row if later."""
        own = np.where(np.isfinite(tracks.t_s), tracks.t_s, -np.inf)
        times = np.maximum.accumulate(np.concatenate([[self._newest_s], own]))
        news = times[1:] > times[:-1]
        news[:1] = times[1:2] > -np.inf  # before any time is known, a row without one says nothing
        starts = np.flatnonzero(news).tolist()
        for start, stop in zip(starts, [*starts, len(tracks)][1:], strict=True):
            yield select_rows(tracks, slice(start, stop)), float(times[start + 1])

    def _settled(self, last: int) -> list[Commands]:
        """Command all intervals up to number `last`."""
        found: list[Commands] = []
        while self._next is not None and self._next <= last:
            state = self._state
            if not state.tracks and not self._waiting.track.size and state.t_s is not None:
                self._next = max(self._next, last - _MOST_IDLE)  # of an absurd pause, the rest
            t_s = self._next * self._interval_s
            residual = np.where(self._connected, self._residual, 0.0)
            self._state, told = self._scheduler.step(
                state, t_s, sighted=self._waiting, residual=residual
            )
            self._waiting, self._next = nobody(), self._next + 1
            self._told = (*self._told, told)
            self._counts = {
                "intervals": self._counts["intervals"] + 1,
                "commands": self._counts["commands"] + told.changed.size,
                "handovers": self._counts["handovers"] + told.handovers,
                "late": self._counts["late"] + told.late,
                "lost": self._counts["lost"] + len(told.lost),
            }
            found.append(
                Commands(
                    np.full(told.changed.size, t_s),
                    told.changed,
                    told.modes[told.changed].astype(np.int32),
                    self._site.sensor_ids,
                )
            )
        return found

    def _nothing(self) -> Commands:
        nothing = np.empty(0, np.int32)
        return Commands(np.empty(0), nothing, nothing, self._site.sensor_ids)

    def _digest(self) -> bytes:
        """Fingerprint of all that commands depend on."""
        site = self._site
        return fingerprint(
            site.sensor_ids,
            site.positions.tolist(),
            site.models,
            site.scheduling,
            site.target,
            site.reports,
            site.network,
            site.groups,
        )
