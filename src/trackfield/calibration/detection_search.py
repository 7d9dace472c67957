"""Size, edge and clock of a binary field: the likelihood walked over a grid, the rates profiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackfield.calibration.detection_fit import RateFit
from trackfield.types import Matrix, Vector

_LEAST_SIZE, _LARGEST_SIZE = 0.4, 2.5  # of the told size
_SIZES = 15
_EDGES = np.array([0.02, 0.1, 0.2, 0.35, 0.6])  # of the radius
_WALKING_EDGE = 0.2  # soft enough that the likelihood has no steps
CLOCK_S = 3.0
"""Largest offset of a clock that is looked for."""


class Geometry(NamedTuple):
    """How large the regions are against what was told, how soft, and how wrong the clock is."""

    size: float
    edge: float  # of the radius as found
    offset_s: float


Profile = Callable[[Geometry, RateFit | None], RateFit]
"""The best rates for a geometry; the second argument is where to begin."""


class Found(NamedTuple):
    """Posterior mean of a geometry under flat priors, its errors, and the rates there.

    The error of `offset_s` is infinite where the run cannot tell it.
    """

    geometry: Geometry
    errors: Geometry
    rates: RateFit


def search(profile: Profile, *, clock: Profile | None) -> Found:
    """Find size and edge, and with `clock` the offset of the detections' clock from the truth's.

    `clock` is a `profile` over steps that have truth beside them at every offset up to `CLOCK_S`:
    likelihoods of different steps do not compare. An offset within three errors of 0 is 0.
    """
    offsets = np.zeros(1) if clock is None else np.arange(-CLOCK_S, CLOCK_S + 0.1, 0.75)
    sizes = np.geomspace(_LEAST_SIZE, _LARGEST_SIZE, _SIZES)
    best = _argmax(
        clock or profile,
        [Geometry(float(s), _WALKING_EDGE, float(o)) for s in sizes for o in offsets],
    )
    offset_error = np.inf
    if clock is not None:
        best, offset_error = _clock(clock, best)
        if abs(best.offset_s) <= 3.0 * offset_error:
            best = best._replace(offset_s=0.0)
    return _posterior(profile, best, offset_error)


def _clock(profile: Profile, near: Geometry) -> tuple[Geometry, float]:
    """Best offset and size in turns; the error from the curvature of the log-likelihood."""
    best = near
    for step in (0.25, 0.08):
        sizes = best.size * np.exp(0.6 * step * np.arange(-2, 3))
        best = _argmax(profile, [best._replace(size=float(s)) for s in sizes])
        offsets = best.offset_s + step * np.arange(-3, 4)
        best = _argmax(profile, [best._replace(offset_s=float(s)) for s in offsets])
    at = 0.16 * np.arange(-4, 5)
    values = _log_likelihoods(profile, [best._replace(offset_s=best.offset_s + s) for s in at])
    curve = np.polyfit(at, values, 2)
    if curve[0] >= 0.0:
        return best, np.inf
    peak = float(np.clip(-curve[1] / (2.0 * curve[0]), at[0], at[-1]))
    return best._replace(offset_s=best.offset_s + peak), float(np.sqrt(-0.5 / curve[0]))


def _posterior(profile: Profile, near: Geometry, offset_error: float) -> Found:
    """Mean and spread over a grid of sizes and edges, drawn closer once."""
    center, width = near.size, 0.15
    weights, grid = np.ones((1, 1)), np.ones(1)
    for closer in (False, True):
        grid = center * (1.0 + width * np.linspace(-1.0, 1.0, 11))
        values = np.array(
            [
                _log_likelihoods(
                    profile, [Geometry(float(s), float(e), near.offset_s) for s in grid]
                )
                for e in _EDGES
            ]
        )
        weights = np.exp(values - values.max()) * _cells(_EDGES)[:, None]
        weights /= weights.sum()
        center, spread = _moments(grid, weights.sum(axis=0))
        if not closer:
            width = float(np.clip(4.0 * spread / center, 0.01, 0.15))
    size, size_error = _moments(grid, weights.sum(axis=0))
    edge, edge_error = _moments(_EDGES, weights.sum(axis=1))
    found = Geometry(size, edge, near.offset_s)
    # Finer than the grid, a peak has at least the spread of a cell.
    least = size * width * 0.2 / np.sqrt(12.0)
    return Found(
        found,
        Geometry(float(np.hypot(size_error, least)), edge_error, offset_error),
        profile(found, None),
    )


def _moments(values: Vector, weights: Vector) -> tuple[float, float]:
    mean = float(values @ weights)
    return mean, float(np.sqrt(max((values - mean) ** 2 @ weights, 0.0)))


def _cells(values: Vector) -> Vector:
    """Widths of the cells around points of an uneven grid."""
    borders = np.concatenate([values[:1], (values[1:] + values[:-1]) / 2.0, values[-1:]])
    return np.diff(borders)


def _log_likelihoods(profile: Profile, places: list[Geometry]) -> Matrix:
    rates: RateFit | None = None
    values: list[float] = []
    for place in places:
        rates = profile(place, rates)
        values.append(rates.log_likelihood)
    return np.array(values)


def _argmax(profile: Profile, places: list[Geometry]) -> Geometry:
    return places[int(np.argmax(_log_likelihoods(profile, places)))]
