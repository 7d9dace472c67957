"""How much each receiver's readings scatter in one place, shrunk to what all have in common."""

from __future__ import annotations

import numpy as np

from trackfield.types import Indices, Vector


def scatter_of_each(square: Vector, free: Vector, *, sensor: Indices, count: int) -> Vector | None:
    """Find standard deviations (count,) of the readings of each sensor; None where nothing tells.

    Each of m places brings a sum of squares about its mean, `square` (m,), of `free` (m,) degrees
    of freedom, heard by `sensor` (m,). The logarithm of a sensor's variance is as uncertain as its
    places disagree; what sensors differ by beyond that is theirs, and the rest is shared. A sensor
    of which no place tells has what all have.
    """
    if not free.sum() > 0.0:
        return None
    shared = float(square.sum() / free.sum())
    places = np.bincount(sensor, free > 0.0, minlength=count)
    told = places >= 2
    freedom = np.maximum(np.bincount(sensor, free, minlength=count), 1e-12)
    own = np.where(told, np.bincount(sensor, square, minlength=count) / freedom, shared)
    own = np.maximum(own, 1e-3 * shared)
    disagreement = np.bincount(sensor, (square - own[sensor] * free) ** 2, minlength=count)
    uncertain = disagreement / (own * freedom) ** 2
    logs = np.log(own / shared)
    spread = 0.0
    if told.sum() > 1:
        spread = max(float(np.mean(logs[told] ** 2 - uncertain[told])), 0.0)
    trust = spread / np.maximum(spread + uncertain, 1e-12)
    return np.sqrt(shared * np.exp(np.where(told, trust * logs, 0.0)))
