"""Updates from ranges of a target that is not known well: tangents with the curvature counted.

One range at a time leaves long, narrow beliefs. Where such a belief lies across the line of sight,
the tangent alone (`filtering.extended`) takes the range for sharper than it is, and a filter that
lives on one or two sensors a step soon believes what is not so.
"""

from __future__ import annotations

import numpy as np

from trackfield.filtering import kalman
from trackfield.filtering.matrices import apply
from trackfield.sensing.range import RangeModels
from trackfield.sensing.range_outlook import outlook, standing
from trackfield.types import Gaussian, Matrix, Vector


def update(
    prior: Gaussian, z: Vector, sensors: Matrix, *, models: RangeModels, iterations: int = 3
) -> kalman.Update:
    """Condition on ranges, bias tr(C P)/2 and variance tr(C P C P)/2 of their curvature counted.

    Linearized at the prior first, with the prior's P; then `iterations` times where the readings
    put the target, with what they leave of P. States begin with the position; z (..., m) [m] with
    NaN where no reading was made; `sensors` (..., m, d) [m], with the leading axes of the prior.
    """
    at = prior
    for _ in range(iterations):
        at = _shifted(prior, at, z, sensors=sensors, models=models)
    innovation, slope, variance = _linearized(prior, at, z, sensors=sensors, models=models)
    return kalman.assimilate(prior, innovation, slope, variance=variance)


def _shifted(
    prior: Gaussian, at: Gaussian, z: Vector, *, sensors: Matrix, models: RangeModels
) -> Gaussian:
    """Posterior with tangents at `at`, and nothing else of an update."""
    innovation, slope, variance = _linearized(prior, at, z, sensors=sensors, models=models)
    weight = np.where(np.isnan(z), 0.0, 1.0 / variance)
    e = np.nan_to_num(innovation)
    shift, covariance, _ = kalman.shifted(prior.covariance, e, slope, weight=weight)
    return Gaussian(prior.mean + shift, covariance)


def _linearized(
    prior: Gaussian, at: Gaussian, z: Vector, *, sensors: Matrix, models: RangeModels
) -> tuple[Vector, Matrix, Vector]:
    """Innovation at the prior (..., m), slopes (..., m, n) and variances, with tangents at `at`."""
    d = sensors.shape[-1]
    seen = outlook(models, sensors, position=standing(at, d))
    H = np.zeros((*seen.slope.shape[:-1], prior.mean.shape[-1]))
    H[..., :d] = seen.slope
    return z - seen.expected - apply(H, prior.mean - at.mean), H, seen.variance
