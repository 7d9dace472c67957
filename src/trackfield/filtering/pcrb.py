"""The least error any filter can have: the posterior Cramer-Rao bound, Tichavsky et al. 1998.

The bound is carried as a covariance; it needs the truth, so it belongs to simulations. Leading
axes are runs.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trackfield.filtering.kalman import predict
from trackfield.filtering.matrices import symmetric
from trackfield.localization import bounds
from trackfield.motion import Motion
from trackfield.sensing.range import RangeModels
from trackfield.types import Gaussian, Matrix, Vector


def range_information(sensors: Matrix, states: Vector, *, models: RangeModels) -> Matrix:
    """Fisher information (..., n, n) on states (..., n) of one range from each sensor in range.

    That of `localization.bounds.range_information`; velocities get none.
    """
    d = sensors.shape[1]
    information = np.zeros((*states.shape, states.shape[-1]))
    information[..., :d, :d] = bounds.range_information(sensors, states[..., :d], models=models)
    return information


def step(bound: Matrix, motion: Motion, *, dt_s: float, information: Matrix) -> Matrix:
    """Carry the bound (..., n, n) by `dt_s`, then add information (..., n, n) of readings.

    J' = (F J^-1 F' + Q)^-1 + I, written so that neither bound nor Q must be invertible. For a
    bound over many truths, `information` is its mean over them.
    """
    nowhere = np.zeros(bound.shape[-1])
    prior = predict(Gaussian(nowhere, bound), motion.transition(dt_s), motion.noise(dt_s))
    spread = np.eye(bound.shape[-1]) + prior.covariance @ information
    return symmetric(np.linalg.solve(spread, prior.covariance))


def recursion(
    bound: Matrix, motion: Motion, *, dt_s: float, information: Iterable[Matrix]
) -> Matrix:
    """Return the bounds (K, ..., n, n) after each of K steps from the initial `bound`."""
    bounds: list[Matrix] = []
    for one in information:
        bound = step(bound, motion, dt_s=dt_s, information=one)
        bounds.append(bound)
    return np.array(bounds)
