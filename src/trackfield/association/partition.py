"""The posterior of a partition of reports into tracks and false alarms, Oh (5), corrected.

Relative to all reports being false alarms it is a product over tracks, so tracks are scored alone:
a birth where the first report is, misses, survival and detections up to the last one, the Kalman
marginal density of the reports, and an end. Plain NumPy over all tracks at once: the readable form
of what the compiled sampler keeps incrementally, and the source of what trackers tell.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from trackfield.raster import Region
from trackfield.types import Indices, Matrix, Vector

Partition = Sequence[Sequence[int]]  # tracks, each the numbers of its reports in the window


class Life(NamedTuple):
    """How targets move and end, in a window.

    `log_death` None sums over all the slots in which a silent track may have ended, and a target
    that leaves the region ends; a number is charged once for a track whose last report is not in
    the last slot, Oh (5), corrected.
    """

    accel_sigma_m_s2: float
    velocity_sigma_m_s: float
    step_s: float
    region: Region | None = None
    log_death: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Reports of the last T slots, in their order, and what is believed before any track.

    `survival` (T,) is the probability to go on living from the slot before; `p_detection` (T, n)
    that of a target near report i to be reported in slot t; `log_birth` and `log_false` (n,) are
    log densities [1/m^2] of targets first to be detected and of false alarms there. `covariance`
    (n, 3) is xx, xy, yy.
    """

    t_s: Vector
    survival: Vector
    slot: Indices
    position: Matrix
    covariance: Matrix
    log_birth: Vector
    log_false: Vector
    p_detection: Matrix
    life: Life

    def __len__(self) -> int:
        return int(self.slot.size)


class Followed(NamedTuple):
    """Tracks as the filter sees them; B of them, at one slot of the window.

    `log_ratio` (B,) is the log posterior of each track against its reports being false alarms;
    `existence` the probability that the target was there, given that the track is one; `mean`
    (B, 4) and `covariance` (B, 4, 4) are conditioned on all reports of the track, later ones too.
    """

    log_ratio: Vector
    existence: Vector
    mean: Matrix
    covariance: NDArray[np.float64]


def log_ratio(window: Window, partition: Partition) -> float:
    """Log P(partition | reports) - log P(all false alarms | reports), Oh (5), corrected."""
    tracks = track_table(window, partition)
    return float(follow(window, tracks, len(window.t_s) - 1).log_ratio.sum())


def track_table(window: Window, partition: Iterable[Iterable[int]]) -> Indices:
    """List the reports of tracks by slot, (B, T); -1 where a track has none."""
    tracks = [np.asarray(list(track), np.int32) for track in partition]
    table = np.full((len(tracks), window.t_s.size), -1, np.int32)
    for row, track in zip(table, tracks, strict=True):
        row[window.slot[track]] = track
    return table


def follow(window: Window, tracks: Indices, slot: int) -> Followed:
    """Score tracks (B, T), and say where their targets were in `slot`; each needs a report.

    From `slot` on the state is doubled, [now, then], so that later reports correct the copy too.
    """
    there = tracks >= 0
    T = window.t_s.size
    first, last = there.argmax(axis=1), T - 1 - there[:, ::-1].argmax(axis=1)
    mean, spread = np.zeros((len(tracks), 4)), np.zeros((len(tracks), 4, 4))
    score = np.zeros(len(tracks))
    ended, unseen = np.zeros(len(tracks)), np.ones(len(tracks))  # since the last report
    ended_then = ended
    nearest = tracks[np.arange(len(tracks)), first]  # the last report so far
    for t in range(T):
        if t:
            mean, spread = _predicted(mean, spread, _motion(window, t))
        inside, silent = (first < t) & (t <= last), t > last
        missed = np.log1p(-window.p_detection[t, nearest])
        score += inside * (np.log(window.survival[t]) + ~there[:, t] * missed)
        stay = window.survival[t] * _inside(window.life.region, mean, spread, silent)
        ended = ended + silent * unseen * (1.0 - stay)
        unseen = unseen * np.where(silent, stay * (1.0 - window.p_detection[t, nearest]), 1.0)
        nearest = np.where(there[:, t], tracks[:, t], nearest)
        score += _births(window, tracks, t=t, born=first == t, belief=(mean, spread))
        score += _updates(
            window, tracks, t=t, seen=there[:, t] & (first < t), belief=(mean, spread)
        )
        if t == slot:
            mean, spread = np.tile(mean, 2), np.tile(spread, (1, 2, 2))
            ended_then = ended
    total = ended + unseen
    existence = np.where(slot < first, 0.0, 1.0 - ended_then / total)
    return Followed(score + _end(window, last, total), existence, mean[:, 4:], spread[:, 4:, 4:])


def accumulated(
    dt_s: float, *, step_s: float, accel_sigma_m_s2: float
) -> tuple[float, float, float]:
    """Return pp, pv, vv of an axis: the covariance that the accelerations bring, Oh (6)."""
    m = max(1.0, dt_s / step_s)
    h = dt_s / m
    q = (accel_sigma_m_s2 * h) ** 2
    return q * h**2 * m * (m**2 / 3 - 1 / 12), q * h * m**2 / 2, q * m


def _motion(window: Window, t: int) -> tuple[Matrix, Matrix]:
    """F and Q (4, 4) from the slot before to slot t."""
    dt, life = float(window.t_s[t] - window.t_s[t - 1]), window.life
    pp, pv, vv = accumulated(dt, step_s=life.step_s, accel_sigma_m_s2=life.accel_sigma_m_s2)
    F, Q = np.eye(4), np.zeros((4, 4))
    F[:2, 2:] = dt * np.eye(2)
    Q[:2, :2], Q[2:, 2:] = pp * np.eye(2), vv * np.eye(2)
    Q[:2, 2:] = Q[2:, :2] = pv * np.eye(2)
    return F, Q


def _predicted(
    mean: Matrix, P: NDArray[np.float64], motion: tuple[Matrix, Matrix]
) -> tuple[Matrix, NDArray[np.float64]]:
    n = mean.shape[1]
    F, Q = np.eye(n), np.zeros((n, n))
    F[:4, :4], Q[:4, :4] = motion
    return mean @ F.T, F @ P @ F.T + Q


def _report_covariance(window: Window, reports: Indices) -> NDArray[np.float64]:
    """R (..., 2, 2) of reports."""
    return window.covariance[reports][..., [[0, 1], [1, 2]]]


def _births(
    window: Window,
    tracks: Indices,
    *,
    t: int,
    born: NDArray[np.bool_],
    belief: tuple[Matrix, NDArray[np.float64]],
) -> Vector:
    """Start beliefs in place where tracks have their first report; what that adds to the score."""
    mean, P = belief
    score = np.zeros(len(tracks))
    if not born.any():
        return score
    i = tracks[born, t]
    start = np.zeros((i.size, 4, 4))
    start[:, :2, :2] = _report_covariance(window, i)
    start[:, 2:, 2:] = window.life.velocity_sigma_m_s**2 * np.eye(2)
    begun = np.column_stack([window.position[i], np.zeros((i.size, 2))])
    copies = (
        mean.shape[1] // 4
    )  # a track that begins later than the slot asked for: never looked at
    mean[born], P[born] = np.tile(begun, copies), np.tile(start, (1, copies, copies))
    score[born] = window.log_birth[i] + np.log(window.p_detection[t, i]) - window.log_false[i]
    return score


def _updates(
    window: Window,
    tracks: Indices,
    *,
    t: int,
    seen: NDArray[np.bool_],
    belief: tuple[Matrix, NDArray[np.float64]],
) -> Vector:
    """Condition beliefs in place on reports of slot t; what that adds to the score."""
    mean, P = belief
    score = np.zeros(len(tracks))
    if not seen.any():
        return score
    i = tracks[seen, t]
    prior, crossed = P[seen], P[seen][:, :, :2]
    S = crossed[:, :2] + _report_covariance(window, i)
    residual = window.position[i] - mean[seen, :2]
    gain = np.linalg.solve(S, crossed.transpose(0, 2, 1)).transpose(0, 2, 1)
    mean[seen] += (gain @ residual[:, :, None])[:, :, 0]
    P[seen] = prior - gain @ crossed.transpose(0, 2, 1)
    distance2 = (residual * np.linalg.solve(S, residual[:, :, None])[:, :, 0]).sum(axis=1)
    density = -0.5 * (distance2 + np.log(np.linalg.det(S))) - np.log(2 * np.pi)
    score[seen] = density + np.log(window.p_detection[t, i]) - window.log_false[i]
    return score


def _inside(
    region: Region | None, mean: Matrix, P: NDArray[np.float64], which: NDArray[np.bool_]
) -> Vector:
    """Probability that targets are in the region, (B,); 1 where not asked."""
    out = np.ones(len(mean))
    if region is None or not which.any():
        return out
    centre, sigma = mean[which, :2], np.sqrt(P[which][:, [0, 1], [0, 1]])
    low, high = np.array(region[:2]), np.array(region[2:])
    out[which] = (ndtr((high - centre) / sigma) - ndtr((low - centre) / sigma)).prod(axis=1)
    return out


def _end(window: Window, last: NDArray[np.intp], total: Vector) -> Vector:
    """Log probability of how tracks end, (B,)."""
    if window.life.log_death is None:
        return np.log(np.maximum(total, 1e-300))
    return np.where(last < window.t_s.size - 1, window.life.log_death, 0.0)
