"""The default tracker of a tagged target from bearings, angular rates and scalar motion.

Iterated EKF under an IMM of straight and manoeuvring motion, with readings that do not fit believed
less. It starts from a fit of constant velocity to a window of readings. Where several answers
explain the window (mirror images about a line of sensors; motion sensors do not tell v from -v) all
are carried along as hypotheses until the readings choose; until then the track is tentative.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.errors import ConfigurationError, InputError
from trackfield.filtering import angle_start, extended, interacting, kalman
from trackfield.filtering.angle_archive import packed, unpacked
from trackfield.filtering.angle_hypotheses import shown, smoothed, thinned, weight_of
from trackfield.filtering.angle_readings import (
    AngleReadings,
    AngleSensors,
    Says,
    chosen,
    of_site,
    require_readings,
)
from trackfield.filtering.angle_start import Search
from trackfield.filtering.angle_state import AngleState, AngleTrack
from trackfield.filtering.extended import Iteration
from trackfield.filtering.interacting import Bank
from trackfield.filtering.robust import Component, Mixture
from trackfield.filtering.scans import Scan, Shown
from trackfield.motion import ConstantVelocity
from trackfield.network.site import Site
from trackfield.types import Gaussian, Status, Vector

_STRAIGHT = 0.0003  # density of acceleration [m^2/s^3] of targets that go straight
_MANOEUVRING = 0.5  # and of others
_STAYS_S = (10.0, 2.0)  # how long each lasts
_FIELD_M = 10.0  # in smaller fields targets are slower too: densities fall with the square
_CROSSING_S = 2.0  # a usual target takes so long to cross the field, or longer
_WEIGH = Mixture((Component(0.95, 0.0, 0.0), Component(0.04, 0.0, 5.0), Component(0.01, 0.0, 30.0)))
_ITERATION = Iteration(steps=6, rounds=2, halvings=4, tolerance=1e-3)
_KEPT_SCANS = 32  # for a start
_KEPT_READINGS = 160
_LEAST_SCANS = 4
_JUDGED = 8  # scans by which a track is judged lost
_MISFIT = 9.0  # squared innovation per reading that counts as one
_SURE = 0.95  # weight of the first hypothesis from which on it is the answer
_PROVED = 3  # scans after a start before its track is confirmed
_TEMPERED = 0.5  # of the log likelihood of a window counts: targets seldom go quite straight
_CLEARLY = 0.5  # a fresh fit costs so much of the track's own, or less


class AngleSettings(NamedTuple):
    """What a tracker of angles starts from.

    `search` says where to look for targets and how fast they are; a track of which nothing was
    heard for `drop_s` ends.
    """

    bank: Bank
    search: Search
    drop_s: float


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
        recent = _kept((*state.recent, scan))
        track = state.track
        if track is not None:
            track = self._updated(track, scan)
            if not _lost(track):
                return AngleState(recent, 0, state.number, track)
        waited = state.waited + 1
        if waited < max(1, len(recent) // 4):
            return AngleState(recent, waited, state.number, track)
        fresh = self._started(recent, track)
        number = state.number + (fresh is not None)
        return AngleState(recent, 0, number, track if fresh is None else fresh)

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
        modes = track.modes
        if ahead > 0.0:
            modes = interacting.predict(modes, self._settings.bank, dt_s=ahead)
        nis = track.nis if ahead <= 0.0 else math.nan
        return shown(t_s, track.weights, interacting.combined(modes), status=status, nis=nis)

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
        status = Status.CONFIRMED if now.confirmed else Status.TENTATIVE
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

    def _updated(self, track: AngleTrack, scan: Scan) -> AngleTrack:
        sensor = AngleReadings(chosen(self._sensors, scan.sensor, scan.sigma), scan.value)
        prior = interacting.predict(track.modes, self._settings.bank, dt_s=scan.t_s - track.t_s)
        whole = interacting.combined(prior)

        def rule(belief: Gaussian, z: Vector) -> kalman.Update:
            found = extended.iterate(belief, z, sensor, weigh=_WEIGH, iteration=_ITERATION)
            doubt = _doubt(found.noise.trust)
            return found.update._replace(log_likelihood=found.update.log_likelihood - doubt)

        modes, info = interacting.update(prior, np.tile(scan.value, (len(track.names), 1)), rule)
        log_weight = np.log(track.weights) + info.log_likelihood
        weights = np.exp(log_weight - log_weight.max())
        weights /= weights.sum()
        best = int(np.argmax(weights))
        e = sensor.value - sensor.predict(whole.mean[best])
        judged = kalman.assimilate(
            Gaussian(whole.mean[best], whole.covariance[best]),
            e,
            sensor.jacobian(whole.mean[best]),
            variance=sensor.variance(e),
        )
        nis = float(judged.distance2) / max(e.size, 1)
        misfits = (*track.misfits, nis > _MISFIT)[-_JUDGED:]
        updated = AngleTrack(
            scan.t_s, track.names, weights, modes, whole, nis, misfits, track.confirmed
        )
        return self._settled(thinned(updated))

    def _settled(self, track: AngleTrack) -> AngleTrack:
        """Tell whether the track may be shown: one answer, within a part of the field."""
        best = int(np.argmax(track.weights))
        d = track.prior.mean.shape[-1] // 2
        P = interacting.combined(track.modes).covariance[best, :d, :d]
        sigma = math.sqrt(max(float(np.linalg.eigvalsh(P)[-1]), 0.0))
        limit = (0.5 if track.confirmed else 0.1) * self._settings.search.size_m
        sure = track.weights[best] >= _SURE and len(track.misfits) >= _PROVED
        return track._replace(confirmed=bool(sure and sigma <= limit))

    def _started(self, recent: Sequence[Scan], track: AngleTrack | None) -> AngleTrack | None:
        """Fit the window, or its last part where it does not fit; None if it says too little."""
        for part in (1, 2, 4, 8):
            scans = recent[-max(len(recent) // part, 1) :]
            window = self._window(scans)
            d = self._settings.search.lower.size
            if len(scans) < _LEAST_SCANS or window.value.size < 6 * d:
                return None
            found = angle_start.fit(window, self._settings.search)
            if found.determined and found.fits:
                if track is not None and not _better(window, found.beliefs.mean[0], track):
                    return None
                span = scans[-1].t_s - scans[0].t_s
                bank = self._settings.bank
                return self._settled(_fresh(found, bank, t_s=scans[-1].t_s, span_s=span))
        return None

    def _window(self, scans: Sequence[Scan]) -> AngleReadings:
        after = np.repeat([s.t_s - scans[-1].t_s for s in scans], [s.value.size for s in scans])
        rows = np.concatenate([s.sensor for s in scans])
        sigma = np.concatenate([s.sigma for s in scans])
        value = np.concatenate([s.value for s in scans])
        return AngleReadings(chosen(self._sensors, rows, sigma), value, after)


def create(site: Site) -> AngleFilter:
    """Make the filter of a tagged target on a site of bearings, angular rates and motion.

    `ConfigurationError` for sensors of other kinds, sensors all at one place (angles from one place
    tell no distance), and targets in space where no sensor tells their height.
    """
    sensors = of_site(site)
    return AngleFilter(sensors, settings(site, sensors))


def settings(site: Site, sensors: AngleSensors) -> AngleSettings:
    """Settle what the tracker of a site starts from, see `create`."""
    d = site.target.dimensions
    place = site.positions[:, :d] if d == 2 else sensors.place
    size = float(np.ptp(place, axis=0).max()) if len(place) else 0.0
    if not size > 0.0:
        raise ConfigurationError(
            [f"site {site.name}: found sensors at one place, which tells angles no distance"]
        )
    if d == 3 and not np.any(sensors.says == Says.MOTION):
        raise ConfigurationError(
            [
                f"site {site.name}: found target.dimensions 3 and no sensor of kind 'motion', "
                "expected 2: bearings and angular rates are about the vertical and tell no height"
            ]
        )
    margin = 0.5 * size
    speed = min(site.target.max_speed_m_s, size / _CROSSING_S)
    search = Search(place.min(axis=0) - margin, place.max(axis=0) + margin, speed)
    return AngleSettings(_bank(site, size), search, site.tracker.drop_s)


def _bank(site: Site, size_m: float) -> Bank:
    told = site.target.accel_sigma_m_s2
    small = min(1.0, size_m / _FIELD_M) ** 2
    manoeuvring = small * _MANOEUVRING if told is None else told**2
    d = site.target.dimensions
    if site.target.motion == "cv":
        return Bank((ConstantVelocity(manoeuvring, d),), (1.0,))
    straight = min(small * _STRAIGHT, manoeuvring)
    return Bank((ConstantVelocity(straight, d), ConstantVelocity(manoeuvring, d)), _STAYS_S)


def _doubt(trust: Vector) -> Vector:
    """Divergence (...) of what readings (..., m) are taken for from what is usual.

    It keeps a way of moving from explaining a turn by outliers in every reading.
    """
    usual = _WEIGH.components[0].share
    t = np.clip(trust, 1e-12, 1.0 - 1e-12)
    return (t * np.log(t / usual) + (1.0 - t) * np.log((1.0 - t) / (1.0 - usual))).sum(-1)


def _kept(scans: tuple[Scan, ...]) -> tuple[Scan, ...]:
    scans = scans[-_KEPT_SCANS:]
    while len(scans) > _LEAST_SCANS and sum(s.value.size for s in scans) > _KEPT_READINGS:
        scans = scans[1:]
    return scans


def _lost(track: AngleTrack) -> bool:
    return len(track.misfits) == _JUDGED and sum(track.misfits) > _JUDGED // 2


def _better(window: AngleReadings, state: Vector, track: AngleTrack) -> bool:
    """Whether a fresh answer explains the window clearly better than the track does."""
    best = int(np.argmax(track.weights))
    old = interacting.combined(track.modes).mean[best]
    return angle_start.misfit(window, state) < _CLEARLY * angle_start.misfit(window, old)


def _fresh(found: angle_start.AngleStart, bank: Bank, *, t_s: float, span_s: float) -> AngleTrack:
    """Make a track of what a window of `span_s` says.

    The fit knows nothing of turns: what they may do in half the window is added.
    """
    mean, covariance = found.beliefs
    beliefs = Gaussian(mean, covariance + bank.motions[-1].noise(0.5 * span_s))
    shares = np.ones(len(bank.motions))
    modes = interacting.init(beliefs, shares.tolist())
    names = tuple(range(len(found.weights)))
    weights = found.weights**_TEMPERED
    return AngleTrack(
        t_s, names, weights / weights.sum(), modes, beliefs, math.nan, (), confirmed=False
    )
