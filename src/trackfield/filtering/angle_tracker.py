"""The default tracker of a tagged target from bearings, angular rates and scalar motion.

Iterated EKF under an IMM of straight and manoeuvring motion, with readings that do not fit believed
less. It starts from a fit of constant velocity to a window of readings. Where several answers
explain the window (mirror images about a line of sensors; places along a valley; motion sensors do
not tell v from -v) all are carried along as hypotheses until the readings choose; until then the
track is tentative. Now and then other answers are looked for again. What rest explains too starts
nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trackfield.errors import InputError
from trackfield.filtering.angle_archive import packed, unpacked
from trackfield.filtering.angle_begin import LEAST_SCANS, begin, better, refuted
from trackfield.filtering.angle_hypotheses import shown, smoothed, thinned, together, weight_of
from trackfield.filtering.angle_readings import (
    AngleSensors,
    chosen,
    of_site,
    require_readings,
)
from trackfield.filtering.angle_rest import rests
from trackfield.filtering.angle_rivals import joined
from trackfield.filtering.angle_settings import AngleSettings, settings
from trackfield.filtering.angle_state import AngleState, AngleTrack
from trackfield.filtering.angle_step import JUDGED, HeardAngles, advance, spoken
from trackfield.filtering.scans import Scan, Shown
from trackfield.network.site import Site
from trackfield.types import Gaussian, Status

_KEPT_SCANS = 32  # for a start
_KEPT_READINGS = 160
_SURE = 0.95  # weight of the first hypothesis from which on it is the answer
_TIGHT, _LOOSE = 0.03, 0.2  # of the box: the sigma within which a track is confirmed, and stays so
_PROVED = 3  # scans after a start before its track is confirmed
_WORKS = 0.99  # chance that a sensor works that has just spoken
_BROKEN = 0.02  # below this chance its silence says nothing


class AngleFilter:
    """A `ScanFilter` of one target on `sensors`; states are values, so this holds no state."""

    def __init__(self, sensors: AngleSensors, settings: AngleSettings) -> None:
        self._sensors = sensors
        self._settings = settings

    def start(self) -> AngleState:
        """Return the state of a target of which nothing was heard."""
        return AngleState()

    def step(self, state: AngleState, scan: Scan) -> AngleState:
        """Condition on a scan no earlier than the last one.

        `InputError` for readings that are no numbers, unknown sensors or a time that goes back.
        """
        self._require(state, scan)
        gap = scan.t_s - state.recent[-1].t_s if state.recent else 0.0
        if gap > self._settings.drop_s:
            state = AngleState(number=state.number)
        state = state._replace(recent=_kept((*state.recent, scan)), waited=state.waited + 1)
        if self._settings.silence:
            state = state._replace(alive=self._heard(state, scan))
        if state.track is not None:
            before = state.track
            state = self._updated(state, before, scan)
            if state.track is not None and not _lost(state.track):
                track = state.track
                if track.confirmed and not before.confirmed:
                    track = self._proved(state, track)
                return self._compared(state._replace(track=track), track)
        if state.waited < max(1, len(state.recent) // 3):
            return state
        state = state._replace(waited=0)
        new, old = begin(state.recent, self._sensors, self._settings), state.track
        if new is None or (old is not None and not better(new, old, state.recent, self._sensors)):
            return state
        return state._replace(number=state.number + 1, track=new)

    def shown(self, state: AngleState, t_s: float) -> Shown | None:
        """Carry the belief to `t_s`, at or after the last scan; None before a track has started.

        The place is that of the likeliest hypothesis, the covariance, about it, that of all.
        """
        track = state.track
        if track is None:
            return None
        ahead = t_s - track.t_s
        if ahead > self._settings.drop_s:
            status = Status.ENDED
        elif not track.confirmed:
            status = Status.TENTATIVE
        else:
            status = Status.COASTING if ahead > 0.0 else Status.CONFIRMED
        nis = track.nis if ahead <= 0.0 else math.nan
        if ahead > 0.0:
            none = spoken(chosen(self._sensors, ()), np.empty(0))
            track = advance(track, none, t_s=t_s, motions=self._settings.motions).track
        return shown(t_s, track.weights, track.whole, status=status, nis=nis)

    def hindsight(self, states: Sequence[AngleState]) -> Shown | None:
        """Smooth the likeliest hypothesis of the last state back to the time of the first. RTS."""
        first = states[0]
        track = first.track
        if track is None:
            return None
        tracks = [s.track for s in states if s.track is not None and s.number == first.number]
        now = tracks[-1]
        weights = np.array([weight_of(now, name) for name in track.names])
        if not weights.any():
            return self.shown(first, track.t_s)
        beliefs = [smoothed([t for t in tracks if name in t.names], name) for name in track.names]
        mean = np.array([belief.mean for belief in beliefs])
        covariance = np.array([belief.covariance for belief in beliefs])
        known = now.names[int(now.weights.argmax())] in track.names
        status = Status.CONFIRMED if now.confirmed and known else Status.TENTATIVE
        whole = Gaussian(mean, covariance)
        return shown(track.t_s, weights / weights.sum(), whole, status=status, nis=track.nis)

    def pack(self, state: AngleState) -> bytes:
        """Bytes that `unpack` makes the very same state of; not pickle."""
        return packed(state)

    def unpack(self, data: bytes) -> AngleState:
        """Return the state that was packed; `StateError` for other bytes."""
        return unpacked(data)

    def _require(self, state: AngleState, scan: Scan) -> None:
        last = state.recent[-1].t_s if state.recent else -math.inf
        if not last <= scan.t_s < math.inf:
            raise InputError(f"found a scan at {scan.t_s} s after one at {last} s")
        known = self._sensors.says.size
        if scan.sensor.size and not (scan.sensor.min() >= 0 and scan.sensor.max() < known):
            raise InputError(f"found sensors {scan.sensor.tolist()}, expected 0 to {known - 1}")
        require_readings(chosen(self._sensors, scan.sensor, scan.sigma), scan.value)

    def _proved(self, state: AngleState, track: AngleTrack) -> AngleTrack:
        """Give a track that is about to be shown, or what all scans say in its place."""
        new = begin(state.recent, self._sensors, self._settings)
        if new is None or not refuted(track, new, state.recent, self._sensors):
            return track
        return new

    def _updated(self, state: AngleState, track: AngleTrack, scan: Scan) -> AngleState:
        """Advance the track; sensors that could have spoken and did not have a say too."""
        if not state.alive:
            sensors = chosen(self._sensors, scan.sensor, scan.sigma)
            heard = spoken(sensors, scan.value)
            advanced = advance(track, heard, t_s=scan.t_s, motions=self._settings.motions)
            return state._replace(track=self._judged(state, advanced.track))
        alive = np.array(state.alive)
        alive[scan.sensor] = 0.0
        silent = np.flatnonzero((self._sensors.threshold > 0.0) & (alive > _BROKEN))
        rows = np.concatenate([scan.sensor, silent])
        value, sigma, works = (
            np.concatenate([one, other])
            for one, other in (
                (scan.value, np.zeros(silent.size)),
                (scan.sigma, np.full(silent.size, np.nan)),
                (np.full(scan.value.size, np.nan), alive[silent]),
            )
        )
        heard = HeardAngles(chosen(self._sensors, rows, sigma), value, works)
        advanced = advance(track, heard, t_s=scan.t_s, motions=self._settings.motions)
        chance = advanced.silence[scan.value.size :] * alive[silent]
        alive[silent] = chance / (chance + 1.0 - alive[silent])
        alive[scan.sensor] = _WORKS
        track = self._judged(state, advanced.track)
        return state._replace(track=track, alive=tuple(alive.tolist()))

    def _judged(self, state: AngleState, after: AngleTrack) -> AngleTrack:
        """Thin a track and settle whether it is confirmed: not while motion sensors see rest."""
        if rests(state.recent, self._sensors):
            return thinned(after)._replace(confirmed=False, misfits=())
        return _settled(thinned(after), self._settings)

    def _compared(self, state: AngleState, track: AngleTrack) -> AngleState:
        """Look, now and then, for other answers to the last scans."""
        every = _KEPT_SCANS if track.confirmed else max(1, len(state.recent) // 3)
        if state.waited < every:
            return state
        new = begin(state.recent, self._sensors, self._settings)
        if new is None:
            return state._replace(waited=0)
        both = thinned(joined(track, new))
        return state._replace(waited=0, track=_settled(both, self._settings))

    def _heard(self, state: AngleState, scan: Scan) -> tuple[float, ...]:
        """Chances that sensors work, before the silence of this scan: those that speak do."""
        alive = np.array(state.alive or (0.0,) * self._sensors.says.size)
        alive[scan.sensor] = _WORKS
        return tuple(alive.tolist())


def create(site: Site) -> AngleFilter:
    """Make the filter of a tagged target on a site of bearings, angular rates and motion.

    `ConfigurationError` for sensors of other kinds, sensors all at one place (angles from one place
    tell no distance), and targets in space where no sensor tells their height.
    """
    sensors = of_site(site)
    return AngleFilter(sensors, settings(site, sensors))


def _kept(scans: tuple[Scan, ...]) -> tuple[Scan, ...]:
    scans = scans[-_KEPT_SCANS:]
    while len(scans) > LEAST_SCANS and sum(s.value.size for s in scans) > _KEPT_READINGS:
        scans = scans[1:]
    return scans


def _lost(track: AngleTrack) -> bool:
    return len(track.misfits) == JUDGED and sum(track.misfits) > JUDGED // 2


def _settled(track: AngleTrack, settings: AngleSettings) -> AngleTrack:
    """Tell whether the track may be shown: one answer, within a part of the field."""
    P = together(track.weights, track.whole)
    sigma = math.sqrt(max(float(np.linalg.eigvalsh(P)[-1]), 0.0))
    limit = (_LOOSE if track.confirmed else _TIGHT) * settings.search.size_m
    sure = track.weights.max() >= _SURE and len(track.misfits) >= _PROVED
    return track._replace(confirmed=bool(sure and sigma <= limit))
