"""A path as drift and oscillation, fitted to what was seen of it: what a target does next.

    p(t) = a + b s + c cos(w s) + d sin(w s),  s = t - now

with one rate w for both axes or one each: a straight line, a circle, a sinusoid across the field
and back. An autoregression of order two with a constant says the same without noise; with noise it
takes a slow wave for a faster or a dying one, as least squares in w does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.types import Matrix, Vector

FEWEST = 5  # samples: ten numbers for the nine of a wave
_PERIODS = np.concatenate([np.geomspace(0.1, 1.0, 9), np.arange(1.33, 14.1, 0.33)])
"""Periods within the samples that are tried: a third of one apart, so that none is missed."""
_FASTEST = 0.4  # periods from a sample to the next
_POLISH = 6  # steps of Gauss and Newton in the rate
_LARGEST = 3.0  # spreads of the samples: what a wave's amplitude is expected to be, about
_RIDGE = 1e-12  # a sample: keeps slow waves apart from drift, to rounding


class Waves(NamedTuple):
    """Fits (k,) made at `t_s` (k,): `rate` (k, 2) [rad/s] of each axis, `coefficients` (k, 4, 2).

    The rows of the coefficients are a, b, c, d [m], b in metres a second.
    """

    t_s: Vector
    rate: Matrix
    coefficients: Matrix


def fit_wave(t_s: Vector, positions: Matrix) -> Waves:
    """Fit w and (a, b, c, d) to places (m, 2) [m] at `t_s` (m,), rising; m >= `FEWEST`.

    Least squares plus |b, c, d|^2 s^2 / A^2, with the noise s^2 that is left over and a usual
    amplitude A: noise on a short way is not taken for a slow and huge wave, and without noise
    nothing is shrunk. w is searched from a tenth of a period in all to fourteen, and no faster than
    .4 periods a sample; then Gauss and Newton's way from the best on.
    """
    rate, coefficients = _fitted(t_s - t_s[-1], positions)
    return Waves(t_s[-1:], np.full((1, 2), rate), coefficients[None])


def fit_axes(t_s: Vector, positions: Matrix) -> Waves:
    """Fit each axis as `fit_wave` does, with a rate of its own."""
    fits = [_fitted(t_s - t_s[-1], axis[:, None]) for axis in positions.T]
    rates = np.array([[rate for rate, _ in fits]])
    return Waves(t_s[-1:], rates, np.hstack([coefficients for _, coefficients in fits])[None])


def fit_line(t_s: Vector, positions: Matrix) -> Waves:
    """Least squares of a line through the samples, seen at `t_s` (m,) rising; one fit, m >= 2."""
    s = t_s - t_s[-1]
    middle, y = s.mean(), positions.mean(axis=0)
    x = s - middle
    slope = x @ positions / (x @ x)
    flat = np.zeros(2)
    return Waves(t_s[-1:], np.zeros((1, 2)), np.array([[y - slope * middle, slope, flat, flat]]))


def at(waves: Waves, t_s: Vector) -> Matrix:
    """Where each of the fits (k,) expects the target at the times `t_s` (n,): (k, n, 2) [m]."""
    s = (t_s - waves.t_s[:, None])[..., None]
    turn = waves.rate[:, None] * s
    a, b, c, d = waves.coefficients.transpose(1, 0, 2)[:, :, None]
    return a + b * s + c * np.cos(turn) + d * np.sin(turn)


def join(fits: list[Waves]) -> Waves:
    """Put fits together, in their order."""
    return Waves(*(np.concatenate(part) for part in zip(*fits, strict=True)))


def _fitted(s: Vector, positions: Matrix) -> tuple[float, Matrix]:
    """Rate and coefficients (4, q) of places (m, q) at s (m,), the last of which is 0."""
    middle, (count, axes), span = positions.mean(axis=0), positions.shape, -float(s[0])
    y = positions - middle
    rates = 2.0 * math.pi / span * _PERIODS[_FASTEST * (count - 1) >= _PERIODS]
    bases = _bases(s, rates)
    rough = float(rates[_best(bases, y, 0.0)[0]])
    rate, coefficients, left_over = _polished(s, y, rough, 0.0)
    square = max(float(np.square(y).sum()) / count, np.finfo(float).tiny)
    free = max(1, axes * (count - 4) - 1)
    shrink = left_over / free / (_LARGEST**2 * square)
    if shrink > _RIDGE:
        rough = float(rates[_best(bases, y, shrink)[0]])
        rate, coefficients, _ = _polished(s, y, rough, shrink)
    coefficients[0] += middle
    coefficients[1] /= span
    return rate, coefficients


def _bases(s: Vector, rates: Vector) -> Matrix:
    """Rows of 1, s, cos(w s), sin(w s) for each of the rates (k,), (k, m, 4); s in whole spans."""
    turn = rates[:, None] * s
    drift = np.broadcast_to(s / -s[0], turn.shape)
    return np.stack([np.ones_like(turn), drift, np.cos(turn), np.sin(turn)], axis=-1)


def _best(bases: Matrix, y: Matrix, shrink: float) -> tuple[int, Matrix, float]:
    """Which of the bases (k, m, 4) fits best, its coefficients (4, q), and what is left over."""
    transposed = bases.transpose(0, 2, 1)
    coefficients = _solved(transposed @ bases + _penalty(y, shrink), transposed @ y)
    squares = np.square(y - bases @ coefficients).sum(axis=(1, 2))
    cost = squares + shrink * np.square(coefficients[:, 1:]).sum(axis=(1, 2))
    best = int(cost.argmin())
    return best, coefficients[best], float(squares[best])


def _polished(s: Vector, y: Matrix, rate: float, shrink: float) -> tuple[float, Matrix, float]:
    """Follow the slope in w of what is left over, the coefficients best at each w, to its end."""
    basis = _bases(s, np.array([rate]))
    _, coefficients, left_over = _best(basis, y, shrink)
    for _ in range(_POLISH):
        X = basis[0]
        slope = s[:, None] * (X[:, 2:3] * coefficients[3] - X[:, 3:4] * coefficients[2])
        fitted = _solved(X.T @ X + _penalty(y, shrink), X.T @ slope)
        rest = slope - X @ fitted  # what the coefficients cannot do as well
        step = float(np.sum(rest * (y - X @ coefficients)))
        tried = rate + step / max(float(np.sum(rest**2)), np.finfo(float).tiny)
        basis = _bases(s, np.array([tried]))
        _, found, less = _best(basis, y, shrink)
        if not (tried > 0.0 and less < left_over):
            break
        rate, coefficients, left_over = tried, found, less
    return rate, coefficients, left_over


def _solved(matrix: Matrix, right: Matrix) -> Matrix:
    return np.asarray(np.linalg.solve(matrix, right), np.float64)


def _penalty(y: Matrix, shrink: float) -> Matrix:
    return shrink * np.diag([0.0, 1.0, 1.0, 1.0]) + _RIDGE * len(y) * np.eye(4)
