"""One scan of a nearest-neighbour tracker: carry on, pair, update, begin and end tracks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import ReportScan
from trackfield.association.model import Scene, Targets
from trackfield.association.nearest_state import Held
from trackfield.filtering import kalman
from trackfield.matching import cheapest
from trackfield.types import Gaussian, Matrix, Vector

Pairing = Literal["optimal", "greedy"]
_SEEN = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])


@dataclass(frozen=True, slots=True)
class NearestSettings:
    """When a report may be a track's, and when tracks begin and end.

    `pairing` is "optimal" (GNN: the most and nearest pairs of a scan) or "greedy" (the nearest pair
    first). A report may be a track's within the squared Mahalanobis distance `gate_d2`. A track is
    confirmed when `confirm_hits` of its last `confirm_steps` steps brought a report, and ends after
    `drop_misses` in a row without, or `drop_tentative` before that. A scan may be `window_steps`
    late. `max_tracks` bounds a scan's work.
    """

    pairing: Pairing = "optimal"
    gate_d2: float = 12.0
    confirm_hits: int = 3
    confirm_steps: int = 4
    drop_misses: int = 4
    drop_tentative: int = 2
    window_steps: int = 10
    max_tracks: int = 1000


def advance(held: Held, scan: ReportScan, scene: Scene, settings: NearestSettings) -> Held:
    """Take a scan: predict, pair confirmed tracks first, then the others, update, begin, end."""
    belief = Gaussian(held.mean, held.covariance)
    if held.track.size:
        dt_s = scan.t_s - held.t_s
        belief = kalman.predict(belief, *motion(scene.targets, scene.reporting.step_s, dt_s=dt_s))
    noise = noise_of(scan, scene)
    report, pairs = _pair(belief, held.confirmed, scan, noise, settings)
    seen = np.flatnonzero(report >= 0)
    updated = kalman.update(
        Gaussian(belief.mean[seen], belief.covariance[seen]),
        scan.position[report[seen]],
        kalman.Linear(_SEEN, noise[report[seen]]),
    ).posterior
    mean, covariance = belief.mean.copy(), belief.covariance.copy()
    mean[seen], covariance[seen] = updated
    numbers = np.append(scan.number, np.int32(-1))[report]
    recent = np.column_stack([held.recent[:, 1:], numbers]).astype(np.int32)
    missed = np.where(report >= 0, 0, held.missed + 1).astype(np.int32)
    hits = np.count_nonzero(recent[:, -settings.confirm_steps :] >= 0, axis=1)
    confirmed = held.confirmed | (hits >= settings.confirm_hits)
    # A target that left gives no more reports; before that its prediction may stray a little.
    left = (missed > 0) & ~scene.reporting.region.contains(mean[:, :2])
    patience = np.where(confirmed, settings.drop_misses, settings.drop_tentative)
    stays = np.flatnonzero((missed < patience) & ~left)
    used = np.zeros(scan.number.size, bool)
    used[report[seen]] = True
    free = np.flatnonzero(~used)
    room = max(settings.max_tracks - stays.size, 0)
    begun = free[:room]
    fresh = _begin(scan, begun, noise[begun], scene.targets.velocity_sigma_m_s)
    start = np.full((begun.size, held.recent.shape[1]), -1, np.int32)
    start[:, -1] = scan.number[begun]
    zeros = np.zeros(begun.size, np.int32)
    return Held(
        t_s=scan.t_s,
        track=np.concatenate([held.track[stays], scan.number[begun] + 1]).astype(np.int32),
        mean=np.concatenate([mean[stays], fresh.mean]),
        covariance=np.concatenate([covariance[stays], fresh.covariance]),
        first_s=np.concatenate([held.first_s[stays], np.full(begun.size, scan.t_s)]),
        recent=np.concatenate([recent[stays], start]),
        age=np.concatenate([held.age[stays] + 1, zeros]).astype(np.int32),
        missed=np.concatenate([missed[stays], zeros]),
        confirmed=np.concatenate([confirmed[stays], zeros >= settings.confirm_hits - 1]),
        pairs=pairs,
        crowded=int(free.size - begun.size),
    )


def motion(targets: Targets, step_s: float, *, dt_s: float) -> tuple[Matrix, Matrix]:
    """F and Q (4, 4) of a time of n steps, in each of which the acceleration is constant, Oh (6).

    Per axis, with h = dt / n: Q = sigma^2 [[h^4 n (4 n^2 - 1) / 12, h^3 n^2 / 2], [., h^2 n]].
    """
    n = max(round(dt_s / step_s), 1)
    h = dt_s / n
    cross = h**3 * n**2 / 2.0
    noise = np.array([[h**4 * n * (4.0 * n**2 - 1.0) / 12.0, cross], [cross, h**2 * n]])
    F, Q = np.zeros((2, 4, 4))
    for axis in (slice(0, None, 2), slice(1, None, 2)):
        F[axis, axis] = [[1.0, dt_s], [0.0, 1.0]]
        Q[axis, axis] = targets.accel_sigma_m_s2**2 * noise
    return F, Q


def told_sigma_m(scene: Scene) -> float:
    """Noise of a report without a covariance: as told, or a guess; this tracker does not learn."""
    told = scene.reporting.sigma_m
    return math.sqrt(scene.reporting.region.area) / 100.0 if told is None else told


def noise_of(scan: ReportScan, scene: Scene) -> NDArray[np.float64]:
    """Covariances (m, 2, 2) of a scan's reports: their own, or the scene's."""
    xx, xy, yy = scan.covariance.T
    unknown = np.isnan(xx)
    own = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    return np.where(unknown[:, None, None], told_sigma_m(scene) ** 2 * np.eye(2), own)


def _pair(
    belief: Gaussian,
    confirmed: NDArray[np.bool_],
    scan: ReportScan,
    noise: NDArray[np.float64],
    settings: NearestSettings,
) -> tuple[NDArray[np.intp], int]:
    """Give each track (n,) a report of the scan, -1 for none, and count gated pairs."""
    report = np.full(confirmed.size, -1)
    if not (confirmed.size and scan.number.size):
        return report, 0
    d2 = _distances2(belief, scan.position, noise)
    total, free = 0, np.ones(scan.number.size, bool)
    for some in (np.flatnonzero(confirmed), np.flatnonzero(~confirmed)):
        i, j = np.nonzero((d2[some] < settings.gate_d2) & free)
        total += i.size
        i, near = some[i], d2[some[i], j]
        if settings.pairing == "optimal":
            chosen = cheapest(i, j, near, alone=settings.gate_d2)
        else:
            chosen = _greedy(i, j, near)
        report[i[chosen]] = j[chosen]
        free[j[chosen]] = False
    return report, total


def _distances2(belief: Gaussian, position: Matrix, noise: NDArray[np.float64]) -> Matrix:
    """Squared Mahalanobis distances (n, m) of reports from where tracks expect theirs."""
    S = belief.covariance[:, None, :2, :2] + noise
    x, y = np.moveaxis(position - belief.mean[:, None, :2], -1, 0)
    xx, xy, yy = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    return (yy * x**2 - 2.0 * xy * x * y + xx * y**2) / (xx * yy - xy**2)


def _greedy(i: NDArray[np.intp], j: NDArray[np.intp], distance: Vector) -> NDArray[np.bool_]:
    """Take the nearest pair, then the nearest of those left, and so on."""
    chosen = np.zeros(i.size, bool)
    tracks, reports = set[int](), set[int]()
    for k in np.argsort(distance, kind="stable").tolist():
        if int(i[k]) not in tracks and int(j[k]) not in reports:
            chosen[k] = True
            tracks.add(int(i[k]))
            reports.add(int(j[k]))
    return chosen


def _begin(
    scan: ReportScan, rows: NDArray[np.intp], noise: NDArray[np.float64], velocity_sigma_m_s: float
) -> Gaussian:
    """States of tracks that begin at reports: velocity unknown but for its size."""
    mean = np.zeros((rows.size, 4))
    mean[:, :2] = scan.position[rows]
    covariance = np.zeros((rows.size, 4, 4))
    covariance[:, :2, :2] = noise
    covariance[:, 2:, 2:] = velocity_sigma_m_s**2 * np.eye(2)
    return Gaussian(mean, covariance)
