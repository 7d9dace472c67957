"""Paper mode of one moment's sizes of motion: gradient steps and the generalized Newton method.

Cheng, Ghosh, Hu, 3.1, in n dimensions and for any falloff. Neither knows which of several solutions
it found, and both may stop far from any: `motion_snapshot` returns all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.motion_vector import scalar_residual, sighting
from trackfield.types import Matrix, Vector

_SHRINK, _ROUNDS = 0.01, 4  # "shrink, for example, dh/100 ... several times"
_STEPS = 600  # of a round
_NEWTON = 60
_RANK = 1e-10  # of the largest singular value


class SizeScan(NamedTuple):
    """One moment's readings `value` (N,) of `sensors` (N, n), which fall off with r^falloff."""

    sensors: Matrix
    value: Vector
    falloff: float = 1.0


class NewtonFix(NamedTuple):
    """Where a search ended: `state` (2 n,), Cheng's `square_error` E (11) there.

    `converged`: E was zero to rounding, or steps no longer changed the state. `rank` of the
    Jacobian: below 2 n the end is no answer.
    """

    state: Vector
    square_error: float
    iterations: int
    converged: bool
    rank: int


class SquareError(NamedTuple):
    """E (...) of Cheng (11) and its slope (..., 2 n), (12)."""

    value: Matrix
    slope: Matrix


def square_error(scan: SizeScan, states: Matrix) -> SquareError:
    """E = sum_i F_i^2 in `states` (..., 2 n), with its slope 2 sum_i F_i dF_i; Cheng (11), (12)."""
    F = scalar_residual(sighting(scan.sensors, states), scan.value, falloff=scan.falloff)
    J = np.concatenate([F.place, F.velocity], axis=-1)
    slope = 2.0 * np.sum(F.value[..., None] * J, axis=-2)
    return SquareError(np.sum(F.value**2, axis=-1), slope)


def gradient(scan: SizeScan, start: Vector) -> NewtonFix:
    """Step 1 of Cheng's algorithm: down the gradient (13), (14) from `start`, with shrinking steps.

    The step has a minus sign, corrected. The paper leaves its length open: the first is the longest
    that is stable at the start, one over the largest curvature of each half of the state; when E
    stops falling it shrinks to a hundredth, three times.
    """
    _check(scan, start)
    n = scan.sensors.shape[1]
    J = _jacobian(scan, start)[1]
    place, velocity = (_longest(half) for half in (J[:, :n], J[:, n:]))
    # at rest the velocity has no slope and no curvature: any length leaves it where it is
    h = np.repeat([place, min(velocity, 1e6 * place)], n)
    state, at, count = np.array(start, float), square_error(scan, start), 0
    for _ in range(_ROUNDS):
        for _ in range(_STEPS):
            trial = state - 0.5 * h * at.slope
            then = square_error(scan, trial)
            if not then.value < at.value:
                break
            state, at, count = trial, then, count + 1
        h = h * _SHRINK
    flat = np.linalg.norm(_scaled(state, at.slope)) <= 1e-6 * (float(at.value) + 1e-30)
    return _fix(scan, state, count, converged=bool(flat))


def newton(scan: SizeScan, start: Vector) -> NewtonFix:
    """Generalized Newton's method (23) from `start` (2 n,): x <- x - (J'J)^-1 J' F.

    Stops when E stops falling, step 2.2. Where J'J is singular, its pseudo-inverse.
    """
    _check(scan, start)
    state, at, count, converged = np.array(start, float), np.inf, 0, False
    while count < _NEWTON and not converged:
        F, J = _jacobian(scan, state)
        move = np.asarray(np.linalg.lstsq(J, F, rcond=_RANK)[0], np.float64)
        trial = state - move
        if not np.abs(trial).max() < 1e9:
            break
        then = float(square_error(scan, trial).value)
        short = np.abs(move).max() <= 1e-12 * (1e-3 + np.abs(trial).max())
        if not then < at:
            converged = bool(short) or at == 0.0
            break
        state, at, count, converged = trial, then, count + 1, bool(short)
    return _fix(scan, state, count, converged=converged)


def follow(scan: SizeScan, values: Matrix, start: Vector, *, step_s: float) -> list[NewtonFix]:
    """Step 2 of Cheng's algorithm: Newton from moment to moment of readings `values` (T, N).

    The first guess is `start`; then r + v dt with v; from the third moment on v gains
    (r_k-1 - 2 r_k-2 + r_k-3) / dt, corrected.
    """
    n = scan.sensors.shape[1]
    found: list[NewtonFix] = []
    guess = np.array(start, float)
    for value in values:
        found.append(newton(scan._replace(value=value), guess))
        last = found[-1].state
        r, v = last[:n], last[n:]
        if len(found) >= 3:
            before, first = found[-2].state[:n], found[-3].state[:n]
            v = v + (r - 2.0 * before + first) / step_s
        guess = np.concatenate([r + last[n:] * step_s, v])
    return found


def _longest(J: Matrix) -> float:
    """Length of the longest stable step of half the gradient."""
    return 1.0 / max(float(np.linalg.norm(J, 2)) ** 2, float(np.finfo(float).tiny))


def _jacobian(scan: SizeScan, state: Vector) -> tuple[Vector, Matrix]:
    F = scalar_residual(sighting(scan.sensors, state), scan.value, falloff=scan.falloff)
    return F.value, np.concatenate([F.place, F.velocity], axis=-1)


def _scaled(state: Vector, slope: Vector) -> Vector:
    """Slope of E per share of the state's own size."""
    n = state.size // 2
    size = [np.linalg.norm(state[:n]) + 1e-3, np.linalg.norm(state[n:]) + 1e-6]
    return np.repeat(size, n) * slope


def _fix(scan: SizeScan, state: Vector, count: int, *, converged: bool) -> NewtonFix:
    n = state.size // 2
    _, J = _jacobian(scan, state)
    unit = np.repeat([np.ptp(scan.sensors) + 1e-12, np.linalg.norm(state[n:]) + 1e-12], n)
    roots = np.linalg.svd(J * unit, compute_uv=False)
    rank = int(np.sum(roots > 1e-9 * max(roots[0], np.finfo(float).tiny)))
    value = float(square_error(scan, state).value)
    return NewtonFix(state, value, count, converged, rank)


def _check(scan: SizeScan, start: Vector) -> None:
    N, n = scan.sensors.shape
    if scan.value.shape != (N,) or start.shape != (2 * n,):
        raise InputError(
            f"found values of shape {scan.value.shape} and a start of shape {start.shape}, "
            f"expected ({N},) and ({2 * n},)"
        )
    if not (np.isfinite(scan.value).all() and (scan.value >= 0.0).all()):
        raise InputError("sizes of motion must be finite and not negative")
