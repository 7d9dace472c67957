"""How well ranges can locate a target at best: Fisher information and Cramer-Rao bound."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import covariance_of
from trackfield.localization.range_likelihood import fisher_weight
from trackfield.sensing.range import RangeModels, constant_variance, directions
from trackfield.types import Matrix


class Bound(NamedTuple):
    """Least covariance (..., d, d) [m^2] of an unbiased position.

    `determined` (...) is false where the ranges leave a direction free; its variance is huge there.
    """

    covariance: Matrix
    determined: NDArray[np.bool_]


def range_information(
    sensors: Matrix,
    positions: Matrix,
    *,
    models: RangeModels,
    height_m: float | None = None,
) -> Matrix:
    """Fisher information J (..., d, d) [1/m^2] of one range from each sensor, exact for Wang (2).

    J = sum (a^2/v + (2 r var_g)^2/(2 v^2)) u u', a = 1 + scale, v = var_n + var_g r^2: the second
    term is what the size of the noise tells of the distance. `positions` (..., d) may be a map;
    sensors (n, d), or (n, 3) with `height_m` for positions (..., 2) at a known height. Sensors
    farther away than their `max_range_m` say nothing.
    """
    full = positions
    if height_m is not None:
        if positions.shape[-1] != 2:
            raise InputError(f"positions of shape {positions.shape}: a known height wants (..., 2)")
        above = np.full((*positions.shape[:-1], 1), height_m)
        full = np.concatenate([positions, above], axis=-1)
    r, units = directions(sensors, full)
    u = units[..., : positions.shape[-1]]
    a, constant, growth = (
        np.asarray(part)
        for part in (1.0 + models.scale, constant_variance(models), models.sigma_scale**2)
    )
    weight = fisher_weight(a, constant, growth, r) * (r <= models.max_range_m)
    return np.swapaxes(u, -1, -2) @ (u * weight[..., None])


def range_bound(
    sensors: Matrix,
    positions: Matrix,
    *,
    models: RangeModels,
    height_m: float | None = None,
) -> Bound:
    """Cramer-Rao bound J^-1 (..., d, d) [m^2] of positions from ranges, see `range_information`."""
    information = range_information(sensors, positions, models=models, height_m=height_m)
    return Bound(*covariance_of(information))
