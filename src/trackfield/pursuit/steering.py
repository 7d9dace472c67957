"""Minimum-time steering of the double integrator, axis by axis: Oh (16)-(19), corrected.

A pursuer whose offset from its evader is xi, and whose velocity against it is xidot, is steered to
xi = xidot = 0 by thrusts of at most U on each axis; the evader goes on straight. Continuous time
gives the time to capture; the thrust that is held for a whole step is exact for that step, so that
it ends at rest instead of chattering about it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_SLACK = 1e-9  # of a number of steps: a state on the border of what so many steps reach is in


class Held(NamedTuple):
    """Thrust that is held for a step, and how many steps at least lead to rest, both (...)."""

    thrust_m_s2: Vector
    steps: Vector


def thrust(offset_m: ArrayLike, velocity_m_s: ArrayLike, *, limit_m_s2: ArrayLike) -> Vector:
    """Thrust u (...) [m/s^2] now: -U sign(s), s = 2 U xi + xidot |xidot|, Oh (17), corrected.

    On the switching curve s = 0 it brakes: -U sign(xidot); at rest 0.
    """
    x, v, u = _checked(offset_m, velocity_m_s, limit_m_s2)
    s = _side(x, v, u)
    return np.asarray(-u * np.where(s == 0.0, np.sign(v), np.sign(s)))


def time_to_rest(offset_m: ArrayLike, velocity_m_s: ArrayLike, *, limit_m_s2: ArrayLike) -> Vector:
    """Least time T (...) [s] to xi = xidot = 0 on one axis, Oh (18), corrected.

    s >= 0: (xidot + sqrt(2 xidot^2 + 4 U xi)) / U; else the same with signs turned.
    """
    x, v, u = _checked(offset_m, velocity_m_s, limit_m_s2)
    return _time(x, v, u)


def time_to_capture(
    offset_m: ArrayLike, velocity_m_s: ArrayLike, *, limit_m_s2: ArrayLike
) -> Vector:
    """Time T_c (...) [s] of the slowest axis, Oh (19); offsets and velocities (..., d)."""
    return time_to_rest(offset_m, velocity_m_s, limit_m_s2=limit_m_s2).max(axis=-1)


def trajectory(
    offset_m: float, velocity_m_s: float, *, limit_m_s2: float, after_s: Vector
) -> Matrix:
    """Offset and velocity (n, 2) on the way of least time, `after_s` (n,) [s] from now.

    Full thrust u until (T - xidot / u) / 2, then as much the other way, then rest.
    """
    x, v, limit = _checked(offset_m, velocity_m_s, limit_m_s2)
    total = float(_time(x, v, limit))
    first = float(thrust(offset_m, velocity_m_s, limit_m_s2=limit_m_s2))
    turn = 0.5 * (total - float(v) * np.sign(first) / float(limit)) if first else 0.0
    t = np.clip(np.asarray(after_s, np.float64), 0.0, total)
    before, since = np.minimum(t, turn), np.maximum(t - turn, 0.0)
    speed = float(v) + first * before
    place = float(x) + float(v) * before + 0.5 * first * before**2
    return np.column_stack([place + speed * since - 0.5 * first * since**2, speed - first * since])


def held_thrust(
    offset_m: ArrayLike, velocity_m_s: ArrayLike, *, limit_m_s2: ArrayLike, step_s: float
) -> Held:
    """Thrust held for `step_s` that begins a shortest sequence of steps to rest, exact.

    N steps lead to rest if thrusts within +-U have sum S = -xidot/step and moment
    sum (N - k - 1/2) u_k = P; for a sum, the moment is largest with all + first. N is the least
    number with P within these limits, and the sequence is the mixture of both extremes that has P.
    """
    if not (np.isfinite(step_s) and step_s > 0.0):
        raise InputError(f"step_s: found {step_s}, expected a finite number above 0")
    x, v, u = np.broadcast_arrays(*_checked(offset_m, velocity_m_s, limit_m_s2))
    place, sum_ = -x / step_s**2 / u, -v / step_s / u  # in units of full thrusts
    n = np.maximum(np.ceil(_time(x, v, u) / step_s - 1.0), 1.0)
    missing = ~_reached(place, sum_, n)
    while missing.any():
        n = np.where(missing, n + 1.0, n)
        missing = ~_reached(place, sum_, n)
    high, low = _extremes(place, sum_, n)
    span = high.moment - low.moment
    share = np.clip((_wanted(place, sum_, n) - low.moment) / np.where(span > 0.0, span, 1.0), 0, 1)
    first = low.first + share * (high.first - low.first)
    rest = (x == 0.0) & (v == 0.0)
    return Held(np.where(rest, 0.0, u * first), np.where(rest, 0.0, n))


class _Extreme(NamedTuple):
    """First thrust and moment of the sequence that goes one way as long as it may, in U."""

    first: Vector
    moment: Vector


def _extremes(place: Vector, sum_: Vector, n: Vector) -> tuple[_Extreme, _Extreme]:
    high, mirrored = _all_first(sum_, n), _all_first(-sum_, n)
    return high, _Extreme(-mirrored.first, -mirrored.moment)


def _all_first(sum_: Vector, n: Vector) -> _Extreme:
    """Sequence of n thrusts within +-1 of that sum with + first."""
    full = np.clip((sum_ + n) / 2.0, 0.0, n)
    whole = np.minimum(np.floor(full), n - 1.0)
    rest = full - whole
    weights = whole * (n - whole / 2.0) + rest * (n - whole - 0.5)
    return _Extreme(np.minimum(2.0 * full, 2.0) - 1.0, 2.0 * weights - n**2 / 2.0)


def _wanted(place: Vector, sum_: Vector, n: Vector) -> Vector:
    """Moment that n thrusts must have: sum (n - k - 1/2) u_k = -xi/step^2 - n xidot/step."""
    return place + n * sum_


def _reached(place: Vector, sum_: Vector, n: Vector) -> NDArray[np.bool_]:
    high, low = _extremes(place, sum_, n)
    moment, slack = _wanted(place, sum_, n), _SLACK * (1.0 + n**2)
    inside = (moment <= high.moment + slack) & (moment >= low.moment - slack)
    return inside & (np.abs(sum_) <= n * (1.0 + _SLACK))


def _side(x: Vector, v: Vector, u: Vector) -> Vector:
    return np.asarray(2.0 * u * x + v * np.abs(v))


def _time(x: Vector, v: Vector, u: Vector) -> Vector:
    sign = np.where(_side(x, v, u) >= 0.0, 1.0, -1.0)
    root = np.sqrt(np.maximum(2.0 * v**2 + 4.0 * u * sign * x, 0.0))
    return np.maximum((sign * v + root) / u, 0.0)


def _checked(
    offset_m: ArrayLike, velocity_m_s: ArrayLike, limit_m_s2: ArrayLike
) -> tuple[Vector, Vector, Vector]:
    x, v, u = (np.asarray(part, np.float64) for part in (offset_m, velocity_m_s, limit_m_s2))
    if not (np.isfinite(x).all() and np.isfinite(v).all()):
        raise InputError("offset and velocity: found a number that is not finite")
    if not (np.isfinite(u).all() and (u > 0.0).all()):
        raise InputError(f"limit_m_s2: found {np.min(u):g}, expected a finite thrust above 0")
    return x, v, u
