"""Particles of a beacon: places and velocities drawn, the shadow of each receiver exact in each.

A Rao-Blackwellised particle filter: given the way a particle went, what walls and bodies take from
each receiver is a scalar Gauss-Markov process over the distance travelled, so each particle keeps
its mean and variance, receiver by receiver, and conditions them as a Kalman filter would.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.raster import Region
from trackfield.types import Indices, Matrix, Vector


class Walk(NamedTuple):
    """How a beacon is carried: it stands, or moves with a velocity that is forgotten.

    Velocity is an Ornstein-Uhlenbeck process, N(0, pace^2) per axis, correlation exp(-t / tau).
    Height keeps to N(height, height_sigma^2), forgotten over `height_time_s`.
    """

    pace_m_s: float = 0.45
    velocity_time_s: float = 6.0
    stops_per_s: float = 0.05
    goes_per_s: float = 0.1
    sway_m: float = 0.05  # of one that stands, in a second
    height_m: float = 0.0
    height_sigma_m: float = 0.0  # 0: the height is known
    height_time_s: float = 10.0


class Fading(NamedTuple):
    """How long errors last: shadows in a place for `shadow_s`; the beacon's power for `offset_s`.

    The power differs from the calibrated one by N(0, offset_db^2).
    """

    shadow_s: float = 300.0
    offset_db: float = 1.0
    offset_s: float = 100.0


class Cloud(NamedTuple):
    """N weighted particles and the shadows of S receivers in each; arrays are never written to."""

    position: Matrix  # (3, N) [m]
    velocity: Matrix  # (3, N) [m/s]; of one that stands: with which it would go on
    moves: NDArray[np.bool_]  # (N,)
    offset_db: Vector  # (N,) power of the beacon over the calibrated one
    log_weight: Vector  # (N,), the largest is 0
    receiver: Indices  # (S,) counts in the site, the last heard last
    shadow_db: Matrix  # (S, N) mean
    shadow_var: Matrix  # (S, N) [dB^2]
    blocked: Matrix  # (S, N) probability that a body or a wall stands in the way


class Moments(NamedTuple):
    """Mean (3,) and covariance (3, 3) of the position, mean and covariance of the velocity."""

    position: Vector
    covariance: Matrix
    velocity: Vector
    velocity_covariance: Matrix
    cross: Matrix  # (3, 3) of position and velocity


def weights(cloud: Cloud) -> Vector:
    """Probabilities (N,) of the particles."""
    w = np.exp(cloud.log_weight)
    return w / w.sum()


def moments(position: Matrix, velocity: Matrix, w: Vector) -> Moments:
    """Moments of particles (3, N) with probabilities `w` (N,)."""
    mean, pace = position @ w, velocity @ w
    off, v = position - mean[:, None], velocity - pace[:, None]
    return Moments(mean, (off * w) @ off.T, pace, (v * w) @ v.T, (off * w) @ v.T)


def going(cloud: Cloud) -> Matrix:
    """Velocities (3, N) [m/s] of the particles, 0 for those that stand."""
    return cloud.velocity * cloud.moves


def move(
    cloud: Cloud, dt: float, rng: np.random.Generator, *, walk: Walk, fading: Fading
) -> tuple[Cloud, Vector]:
    """Move the particles for `dt` [s]; also tell how far (N,) [m] each walked in the plane.

    The velocity's process is integrated exactly. One that stands sways, which is no way walked: its
    shadows stay. Shadows fade by `fade`, which must know what is usual in the new place.
    """
    n = cloud.moves.size
    tau, a = walk.velocity_time_s, math.exp(-dt / walk.velocity_time_s)
    noise = rng.standard_normal((6, n))
    rates = np.where(cloud.moves, walk.stops_per_s, walk.goes_per_s)
    both = walk.stops_per_s + walk.goes_per_s
    switched = rng.random(n) < rates / both * -math.expm1(-both * dt)
    moves = cloud.moves ^ switched
    x_var = max(2.0 * dt / tau - 3.0 + 4.0 * a - a * a, 0.0) * tau * tau
    xv = tau * (1.0 - a) ** 2
    v_sigma = math.sqrt(1.0 - a * a)
    gain = xv / v_sigma
    rest = math.sqrt(max(x_var - gain * gain, 0.0))
    flown = tau * (1.0 - a) * cloud.velocity + walk.pace_m_s * (gain * noise[:3] + rest * noise[3:])
    velocity = a * cloud.velocity + walk.pace_m_s * v_sigma * noise[:3]
    step = np.where(moves, flown, walk.sway_m * math.sqrt(dt) * noise[3:])
    velocity[2] = 0.0
    h = math.exp(-dt / walk.height_time_s)
    step[2] = (1.0 - h) * (walk.height_m - cloud.position[2]) + (
        walk.height_sigma_m * math.sqrt(1.0 - h * h) * noise[5]
    )
    o = math.exp(-dt / fading.offset_s)
    offset = o * cloud.offset_db + fading.offset_db * math.sqrt(1.0 - o * o) * rng.standard_normal(
        n
    )
    moved = cloud._replace(
        position=cloud.position + step, velocity=velocity, moves=moves, offset_db=offset
    )
    return moved, np.hypot(step[0], step[1]) * moves


class UsualPaths(NamedTuple):
    """What is believed of S receivers that are not heard: their shadows, and blocked paths.

    A shadow keeps the share exp(-d / `shadow_m`) over d metres; a path stays blocked or clear with
    exp(-dt / `block_s`).
    """

    shadow_var: Matrix  # (S, N) [dB^2]
    shadow_m: Vector  # (S,)
    blocked: Matrix  # (S, N) probability
    block_s: Vector  # (S,), 0: each reading by itself


def fade(cloud: Cloud, far: Vector, dt: float, *, usual: UsualPaths, fading: Fading) -> Cloud:
    """Let shadows and what is in the way become usual over `far` (N,) [m] and `dt` [s]."""
    lengths = usual.shadow_m[:, None]
    if np.ptp(lengths) == 0.0:
        lengths = lengths[:1]
    rho = np.exp(-far / lengths - dt / fading.shadow_s)
    square = rho * rho
    stays = np.exp(-dt / np.maximum(usual.block_s, 1e-9))[:, None]
    return cloud._replace(
        shadow_db=cloud.shadow_db * rho,
        shadow_var=usual.shadow_var + square * (cloud.shadow_var - usual.shadow_var),
        blocked=usual.blocked + stays * (cloud.blocked - usual.blocked),
    )


def resampled(cloud: Cloud, u: float, count: int) -> tuple[Cloud, Indices]:
    """Draw `count` particles of equal weight by `u` in [0, 1), and tell whose copies they are.

    Systematic: particle i of probability w_i is taken floor or ceil of count w_i times.
    """
    edges: Vector = np.cumsum(weights(cloud))
    wanted: Vector = (u + np.arange(count)) * (edges[-1] / count)
    parent = np.minimum(np.searchsorted(edges, wanted, side="right"), edges.size - 1).astype(
        np.int32
    )
    return Cloud(
        cloud.position[:, parent],
        cloud.velocity[:, parent],
        cloud.moves[parent],
        cloud.offset_db[parent],
        np.zeros(count),
        cloud.receiver,
        cloud.shadow_db[:, parent],
        cloud.shadow_var[:, parent],
        cloud.blocked[:, parent],
    ), parent


def effective(cloud: Cloud) -> float:
    """Count the particles of equal weight that would be worth as much, 1 / sum w^2."""
    w = np.exp(cloud.log_weight)
    return float(w.sum() ** 2 / (w @ w))


def joined(first: Cloud, second: Cloud) -> Cloud:
    """Particles of both, which follow the same receivers."""
    return Cloud(
        np.concatenate([first.position, second.position], axis=1),
        np.concatenate([first.velocity, second.velocity], axis=1),
        np.concatenate([first.moves, second.moves]),
        np.concatenate([first.offset_db, second.offset_db]),
        np.concatenate([first.log_weight, second.log_weight]),
        first.receiver,
        np.concatenate([first.shadow_db, second.shadow_db], axis=1),
        np.concatenate([first.shadow_var, second.shadow_var], axis=1),
        np.concatenate([first.blocked, second.blocked], axis=1),
    )


def confined(cloud: Cloud, area: Region) -> Cloud:
    """Particles that left the area are at its border, and turn back."""
    low = np.array([[area.x_min], [area.y_min]])
    high = np.array([[area.x_max], [area.y_max]])
    place = cloud.position[:2]
    out = (place < low) | (place > high)
    if not out.any():
        return cloud
    position, velocity = cloud.position.copy(), cloud.velocity.copy()
    position[:2] = np.clip(place, low, high)
    velocity[:2][out] *= -1.0
    return cloud._replace(position=position, velocity=velocity)


def carried(now: Moments, dt: float, walk: Walk) -> Moments:
    """Moments after `dt` [s] as if all went on moving, or for a negative one as they came."""
    tau = walk.velocity_time_s
    if dt <= 0.0:
        return now._replace(position=now.position + dt * now.velocity)
    a = math.exp(-dt / tau)
    k = tau * (1.0 - a)
    grown = walk.pace_m_s**2 * max(2.0 * dt / tau - 3.0 + 4.0 * a - a * a, 0.0) * tau * tau
    added = np.diag([grown, grown, 0.0])
    covariance = now.covariance + k * (now.cross + now.cross.T) + k * k * now.velocity_covariance
    return now._replace(
        position=now.position + k * now.velocity,
        covariance=covariance + added,
        velocity=a * now.velocity,
    )
