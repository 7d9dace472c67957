"""What a reading costs, by what a sensor has left and by how much it will be needed."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_RESERVE, _POWER = 0.99, 3.0  # measured: weights that keep all sensors alive longest
_LEAST = 0.2  # share of the mean: who is hardly needed is not for nothing either
_EDGE, _RAMP = (
    1.0,
    3.0,
)  # spreads inside the reach where a sensor begins to serve, and until it does


def shares(
    sensors: Matrix, places: Matrix, *, reach_m: float, spread_m: float, near: float = 3.0
) -> Vector:
    """Sum d_i = sum over places of [i can serve it] / number that can, the mean made 1; (n,).

    `places` (m, d) [m] are where targets have been, or are expected, each as often as it counts;
    `sensors` (n, d) [m] serve a target that is predicted with a standard deviation of `spread_m` an
    axis if it is `near` of these away and surely in reach: by a ramp from one to four of these
    inside. A sensor that stands where many pass and few serve is needed most.
    """
    if sensors.ndim != 2 or places.ndim != 2 or sensors.shape[1] != places.shape[1]:
        raise InputError(
            f"sensors of shape {sensors.shape} and places of shape {places.shape}: expected (n, d) "
            "and (m, d)"
        )
    r = cdist(places, sensors)
    inside = (reach_m - r) / spread_m - _EDGE
    serves = np.clip(inside / _RAMP, 0.0, 1.0) * (r >= near * spread_m)
    of_all = serves.sum(axis=1, keepdims=True)
    demand = np.divide(serves, of_all, out=np.zeros_like(serves), where=of_all > 0.0).sum(axis=0)
    mean = demand.mean() if demand.size else 1.0
    return np.maximum(demand / mean, _LEAST) if mean > 0.0 else np.ones(len(sensors))


def weights(readings: Matrix, demand: Matrix | float = 1.0) -> Matrix:
    """Cost d/(x - .99)^3 of a reading of sensors that have energy for x more, (..., n).

    Infinite where x < 1: nobody left to ask. `demand` d (..., n) is that of `shares`. `InputError`
    where an energy or a demand is negative or no number.
    """
    x = np.asarray(readings, np.float64)
    if not ((x >= 0.0).all() and (np.asarray(demand) >= 0.0).all()):
        raise InputError("found an energy or a demand that is negative or no number, expected 0 on")
    able = x >= 1.0
    return np.where(able, demand * np.where(able, x - _RESERVE, 1.0) ** -_POWER, np.inf)
