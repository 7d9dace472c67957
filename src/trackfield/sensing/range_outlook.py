"""What a range will say of a target whose place is not known exactly: moments to second order.

A range is the more curved the nearer the target: whoever is believed to stand near, and anywhere
across the line of sight, is farther away on the average than the belief's middle, and his range
scatters, noise or not. What curves tells a linear filter nothing: it is noise to it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.range import RangeModels, expected, variance
from trackfield.types import Gaussian, Matrix, Vector

_AT_SENSOR = 1e-9  # [m] a target that near has no direction


class Outlook(NamedTuple):
    """Ranges of a target at N(mean, P), a column a sensor; (..., n) each.

    `distance` [m] from the sensor to the mean, `unit` (..., n, d) the direction; `expected` [m] and
    `variance` [m^2] of the reading; `slope` (..., n, d) of its mean. `along` and `across` [m] are
    the standard deviations of the place in the line of sight and square to it (in 3-D both of these
    together). At the sensor itself there is no direction: unit and slope are zero.
    """

    distance: Matrix
    unit: Matrix
    expected: Matrix
    variance: Matrix
    slope: Matrix
    along: Matrix
    across: Matrix


def outlook(models: RangeModels, sensors: Matrix, *, position: Gaussian) -> Outlook:
    """Moments of z = (1 + scale) |p - c| + v with p ~ N(mean, P), to second order.

    E z = h(mean) + tr(C P)/2 and var z = u' P u (its linear part, not counted here) + noise +
    tr(C P C P)/2, where C = (1 + scale)(I - u u')/r is the curvature: in the plane noise +
    (P_across/r)^2/2. `sensors` (..., n, d) [m], `position` of mean (..., d) and covariance
    (..., d, d) [m^2].
    """
    mean, P = position
    d = mean.shape[-1]
    if sensors.ndim < 2 or sensors.shape[-1] != d or P.shape[-2:] != (d, d):
        raise InputError(
            f"sensors of shape {sensors.shape} for a position of shape {mean.shape}, covariance "
            f"of shape {P.shape}: expected (..., n, {d}), (..., {d}) and (..., {d}, {d})"
        )
    offset = mean[..., None, :] - sensors
    r = np.sqrt(_dot(offset, offset))
    far = np.maximum(r, _AT_SENSOR)
    u = offset / far[..., None]
    Pu = u @ P
    along2 = _dot(u, Pu)
    across2 = np.maximum(np.trace(P, axis1=-2, axis2=-1)[..., None] - along2, 0.0)
    squared = across2**2
    if d > 2:  # tr((I - uu') P (I - uu') P), which in the plane is across2 squared
        whole = (P * P).sum((-2, -1))[..., None]
        squared = np.maximum(whole - 2.0 * _dot(Pu, Pu) + along2**2, 0.0)
    stretch = 1.0 + np.asarray(models.scale)
    curved = 0.5 * stretch**2 * squared / far**2
    return Outlook(
        distance=r,
        unit=u,
        expected=expected(models, r) + 0.5 * stretch * across2 / far,
        variance=variance(models, r) + curved,
        slope=np.asarray(stretch)[..., None] * u,
        along=np.sqrt(np.maximum(along2, 0.0)),
        across=np.sqrt(across2),
    )


def standing(position: Gaussian, dimensions: int) -> Gaussian:
    """Marginal of the position of a state that begins with it."""
    d = dimensions
    return Gaussian(position.mean[..., :d], position.covariance[..., :d, :d])


def gains(seen: Outlook) -> Matrix:
    """Slope over standard deviation (..., n, d) [1/m]: the information of a reading is g g'."""
    return seen.slope / np.sqrt(seen.variance)[..., None]


def nearness(seen: Outlook) -> Vector:
    """Distance over the spread across (..., n): below about 2.5 a range cannot tell two sides."""
    return seen.distance / np.maximum(seen.across, _AT_SENSOR)


def _dot(a: Matrix, b: Matrix) -> Matrix:
    return np.einsum("...d,...d->...", a, b)
