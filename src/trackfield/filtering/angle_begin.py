"""How a track of angles begins, or begins anew: a window of scans is fitted, then filtered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfield.filtering import angle_start
from trackfield.filtering.angle_hypotheses import fresh, thinned
from trackfield.filtering.angle_readings import AngleReadings, AngleSensors, chosen
from trackfield.filtering.angle_settings import AngleSettings
from trackfield.filtering.angle_state import AngleTrack
from trackfield.filtering.angle_step import advance, spoken
from trackfield.filtering.matrices import apply, transposed
from trackfield.filtering.scans import Scan
from trackfield.motion import ConstantVelocity
from trackfield.types import Gaussian, Vector

LEAST_SCANS = 4
_PER_NUMBER = 3  # readings for each number of the state, at least
_PARTS = (1, 2, 4, 8)  # of the window, where targets turn
_WIDE = 0.03  # a fit is doubted by this part of the box,
_WIDE_SPEED = 0.3  # of the speed,
_WIDER = 4.0  # and so many times its own covariance
_CLEARLY = 0.5  # a fresh answer costs so much of what the old one does, or less
_REFUTES = 12.0  # a first answer may cost so much more than one of all scans since


def begin(
    recent: Sequence[Scan], sensors: AngleSensors, settings: AngleSettings
) -> AngleTrack | None:
    """Make a track of the last scans; None where they say too little, or nothing fits.

    Of the whole window, its half, quarter and eighth the first is taken that goes straight.
    """
    for part in _PARTS:
        scans = recent[-max(len(recent) // part, 1) :]
        window = _window(scans, sensors)
        if len(scans) < LEAST_SCANS or window.value.size < _PER_NUMBER * 2 * settings.dimensions:
            return None
        found = angle_start.fit(window, settings.search)
        if not found.determined:
            return None
        if found.fits:
            return _replayed(scans, found.beliefs, sensors=sensors, settings=settings)
    return None


def better(new: AngleTrack, old: AngleTrack, recent: Sequence[Scan], sensors: AngleSensors) -> bool:
    """Whether a new track explains the last quarter of the scans clearly better than the old."""
    last = recent[-max(len(recent) // 4, LEAST_SCANS) :]
    costs = _costs(new, old, last, sensors)
    return costs[0] < _CLEARLY * costs[1]


def refuted(
    old: AngleTrack, new: AngleTrack, recent: Sequence[Scan], sensors: AngleSensors
) -> bool:
    """Whether a track that began on few scans explains all of them worse than one of now."""
    costs = _costs(new, old, recent, sensors)
    return costs[0] + _REFUTES < costs[1]


def _costs(
    new: AngleTrack, old: AngleTrack, scans: Sequence[Scan], sensors: AngleSensors
) -> list[float]:
    window = _window(scans, sensors)
    return [
        angle_start.misfit(window, track.whole.mean[int(track.weights.argmax())])
        for track in (new, old)
    ]


def _replayed(
    scans: Sequence[Scan], fitted: Gaussian, *, sensors: AngleSensors, settings: AngleSettings
) -> AngleTrack:
    """Filter a window from wide beliefs about the answers to it.

    The fit knows of no turns, so its covariance and its choice between answers are too sure.
    """
    d = settings.dimensions
    back = ConstantVelocity(0.0, d).transition(scans[0].t_s - scans[-1].t_s)
    covariance = back @ fitted.covariance @ transposed(back)
    doubt = np.full(fitted.mean.shape, _WIDE * settings.search.size_m)
    doubt[:, d:] = _WIDE_SPEED * np.linalg.norm(fitted.mean[:, d:], axis=-1, keepdims=True)
    wide = _WIDER * covariance + doubt[..., None] ** 2 * np.eye(2 * d)
    beliefs = Gaussian(apply(back, fitted.mean), wide)
    track = fresh(beliefs, t_s=scans[0].t_s, modes=len(settings.motions.densities))
    for scan in scans:
        heard = spoken(chosen(sensors, scan.sensor, scan.sigma), scan.value)
        track = thinned(advance(track, heard, t_s=scan.t_s, motions=settings.motions).track)
    return track._replace(misfits=())


def _window(scans: Sequence[Scan], sensors: AngleSensors) -> AngleReadings:
    after: Vector = np.repeat(
        [scan.t_s - scans[-1].t_s for scan in scans], [scan.value.size for scan in scans]
    )
    rows, value, sigma = (np.concatenate([scan[k] for scan in scans]) for k in (1, 2, 3))
    return AngleReadings(chosen(sensors, rows, sigma), value, after)
