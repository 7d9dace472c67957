"""Robust readings: weights that forgive what does not fit, and a gate that re-opens.

A weight takes residuals e ~ N(0, S), S the noise variance plus what the prediction does not know,
and the noise variance v; it returns the noise to assume instead. All arrays have shape (..., m).
They serve as `weigh` of `filtering.extended.iterate`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri  # pyright: ignore[reportUnknownVariableType] (a ufunc, untyped)

from trackfield.filtering.extended import Noise
from trackfield.types import Vector


class Component(NamedTuple):
    """One kind of reading: its share, its mean and its standard deviation.

    Mean and deviation are of what adds to the white noise, in standard deviations of that noise.
    """

    share: float
    shift: float
    spread: float


LINE_OF_SIGHT = Component(0.88, 0.0, 0.0)
BLOCKED = Component(0.10, 5.0, 5.0)
OUTLIER = Component(0.02, 0.0, 30.0)


@dataclass(frozen=True, slots=True)
class Mixture:
    """Line of sight, blocked (late, so too long) or outlier: noise as the moments of the mixture.

    p_j ~ share_j N(e; shift_j, S + spread_j^2); bias = sum p_j shift_j, variance = v +
    sum p_j (spread_j^2 + (shift_j - bias)^2). Never drops a reading; `trust` is p of the first.
    """

    components: tuple[Component, ...] = (LINE_OF_SIGHT, BLOCKED, OUTLIER)

    def __call__(self, residual: Vector, spread: Vector, variance: Vector) -> Noise:
        """Return the noise of readings with `residual`."""
        sigma = np.sqrt(variance)
        shares, shifts, spreads = np.array(self.components).T
        shift = shifts * sigma[..., None]
        extra = (spreads * sigma[..., None]) ** 2
        S = spread[..., None] + extra
        log_p = np.log(shares) - 0.5 * ((residual[..., None] - shift) ** 2 / S + np.log(S))
        p = np.exp(log_p - log_p.max(-1, keepdims=True))
        p /= p.sum(-1, keepdims=True)
        bias = (p * shift).sum(-1)
        wider = (p * (extra + (shift - bias[..., None]) ** 2)).sum(-1)
        return Noise(bias, variance + wider, p[..., 0])


@dataclass(frozen=True, slots=True)
class Huber:
    """Weight min(1, k/|e|), e in standard deviations of S: linear cost beyond k, Huber."""

    k: float = 1.345

    def __call__(self, residual: Vector, spread: Vector, variance: Vector) -> Noise:
        """Return the noise of readings with `residual`."""
        size = np.abs(residual) / np.sqrt(spread)
        weight = self.k / np.maximum(size, self.k)
        return Noise(np.zeros_like(residual), variance / weight, weight)


@dataclass(frozen=True, slots=True)
class Student:
    """Weight (nu + 1)/(nu + e^2), e in standard deviations of S, at most 1: Student's t noise."""

    degrees: float = 4.0

    def __call__(self, residual: Vector, spread: Vector, variance: Vector) -> Noise:
        """Return the noise of readings with `residual`."""
        weight = (self.degrees + 1.0) / (self.degrees + residual**2 / spread)
        weight = np.minimum(weight, 1.0)
        return Noise(np.zeros_like(residual), variance / weight, weight)


@dataclass(frozen=True, slots=True)
class Gate:
    """A chi-square gate that re-opens: it passes d^2 <= quantile(p) growth^refused.

    A gate that stays shut after an outage or a false start loses the target for good; here each
    refusal in a row widens it, and what passes closes it again.
    """

    probability: float = 0.99
    growth: float = 2.0

    def threshold(self, degrees: Vector, refused: Vector) -> Vector:
        """Greatest squared distance that passes, (...)."""
        quantile = np.asarray(chdtri(degrees, 1.0 - self.probability), dtype=np.float64)
        return quantile * self.growth ** np.minimum(refused, _MOST_REFUSALS)


def step(
    refused: Vector, distance2: Vector, *, degrees: Vector, gate: Gate
) -> tuple[Vector, NDArray[np.bool_]]:
    """Judge updates by `distance2` (...) with `degrees` of freedom; also count refusals in a row.

    `refused` (...) is the state, zero at first. Without readings (no degrees) nothing changes.
    """
    some = degrees > 0
    limit = gate.threshold(np.maximum(degrees, 1.0), refused)
    passes = some & (distance2 <= limit)
    count = np.where(passes, 0.0, refused + 1.0)
    return np.where(some, count, refused), passes


_MOST_REFUSALS = 100.0  # in a row; more would not fit a float
