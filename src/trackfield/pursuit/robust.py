"""Robust minimum-time steering: the least worst time to capture, Oh (20)-(23)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackfield.errors import InputError
from trackfield.pursuit.steering import time_to_rest
from trackfield.types import Vector

_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
_ROUNDS = 26  # of a golden section: the last bracket is 4e-6 of the first


class Doubt(NamedTuple):
    """Bounds of what is not known of one axis: offset V, velocity Vdot, the evader's thrust U_e."""

    offset_m: ArrayLike
    velocity_m_s: ArrayLike
    thrust_m_s2: ArrayLike


class Robust(NamedTuple):
    """Thrust (...) [m/s^2] for a step and the worst time to capture (...) [s] after it."""

    thrust_m_s2: Vector
    worst_s: Vector


def robust_thrust(
    offset_m: ArrayLike,
    velocity_m_s: ArrayLike,
    *,
    limit_m_s2: ArrayLike,
    doubt: Doubt,
    step_s: float,
) -> Robust:
    """Thrust that minimises the largest time to capture a step later, Oh (22) as (23).

    Of all states that the doubt allows the two corners are the worst. Sets of states that are
    captured within a time are convex, so the larger of the two times has one valley in the thrust,
    which a golden section finds.
    """
    given = (offset_m, velocity_m_s, *doubt)
    x, v, dx, dv, du = (np.asarray(part, np.float64) for part in given)
    if not all(np.isfinite(part).all() for part in (x, v, dx, dv, du)):
        raise InputError("offset, velocity and their doubts: found a number that is not finite")
    if any((part < 0.0).any() for part in (dx, dv, du)):
        raise InputError("doubts: found one below 0, expected bounds of 0 or more")
    if not (np.isfinite(step_s) and step_s > 0.0):
        raise InputError(f"step_s: found {step_s}, expected a finite number above 0")
    wide = dx + step_s * dv + 0.5 * step_s**2 * du
    fast = dv + step_s * du

    shape = np.broadcast_shapes(x.shape, v.shape, wide.shape, np.shape(limit_m_s2))
    sides = np.array([1.0, -1.0]).reshape(2, *(1 for _ in shape))

    places, speeds = x + step_s * v + sides * wide, v + sides * fast

    def worst(u: Vector) -> Vector:
        both = places + 0.5 * step_s**2 * u, speeds + step_s * u
        return time_to_rest(*both, limit_m_s2=limit_m_s2).max(axis=0)

    high = np.broadcast_to(np.asarray(limit_m_s2, np.float64), shape)
    return _valley(worst, -high, high)


def _valley(worst: Callable[[Vector], Vector], low: Vector, high: Vector) -> Robust:
    """Golden section over many valleys at once."""
    a, b = low, high
    c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_c, at_d = worst(c), worst(d)
    for _ in range(_ROUNDS):
        left = at_c <= at_d
        a, b = _either(left, a, c), _either(left, d, b)
        inner = _either(left, b - _GOLDEN * (b - a), a + _GOLDEN * (b - a))
        value = worst(inner)
        c, d = _either(left, inner, d), _either(left, c, inner)
        at_c, at_d = _either(left, value, at_d), _either(left, at_c, value)
    tried = np.stack([low, high, 0.5 * (a + b)])  # a limit is hit exactly
    times = np.stack([worst(u) for u in tried])
    best = times.argmin(axis=0)[None]
    pick = (np.take_along_axis(part, best, axis=0)[0] for part in (tried, times))
    return Robust(*pick)


def _either(first: NDArray[np.bool_], one: Vector, other: Vector) -> Vector:
    return np.where(first, one, other)
