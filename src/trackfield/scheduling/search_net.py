"""Few sensors that will find a target which may be anywhere in a wide ellipse."""

from __future__ import annotations

import numpy as np

from trackfield.linalg import square_root
from trackfield.raster import Region
from trackfield.types import Gaussian, Indices, Matrix, Vector

_DIRECTIONS, _RINGS = 12, (1.0, 2.0)  # of the places that the net covers, in standard deviations
_TIMES = 3  # each place is covered so often, if it can be: so many ranges fix a position


def places(position: Gaussian, field: Region | None = None) -> Matrix:
    """Middle of a belief and two rings about it, at one and two standard deviations (m, 2) [m].

    Those in the `field`, if any are.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    unit = np.concatenate([np.zeros((1, 2)), *(radius * ring for radius in _RINGS)])
    found = position.mean + unit @ square_root(position.covariance).T
    inside = np.ones(len(found), bool) if field is None else field.contains(found)
    return found[inside] if inside.any() else found


def cast(sensors: Matrix, wanted: Matrix, *, reach_m: float, able: Vector, most: int) -> Indices:
    """At most `most` of `sensors` (n, 2) [m], so that each of `wanted` (m, 2) is in reach of three.

    One by one, the sensor that covers most of what is still wanted, and of those about as good the
    one farther from the others: sensors side by side leave two places. `able` (n,) are those that
    can be asked; ends when everything is covered or nobody helps.
    """
    apart = np.linalg.norm(sensors[:, None, :] - wanted, axis=-1)
    covers = (apart <= reach_m) & np.asarray(able, bool)[:, None]
    need = np.full(len(wanted), float(_TIMES))
    far: Vector = np.ones(len(sensors))  # from the others, in reaches, at most 1
    chosen: list[int] = []
    while len(chosen) < most and need.any():
        help_ = (covers * np.minimum(need, 1.0)).sum(axis=1)
        help_[chosen] = 0.0
        if not help_.any():
            break
        best = int(np.argmax(np.where(help_ > 0.0, help_ + far, 0.0)))
        chosen.append(best)
        need = np.maximum(need - covers[best], 0.0)
        away = np.linalg.norm(sensors - sensors[best], axis=1) / reach_m
        far = np.minimum(far, away)
    return np.array(chosen, np.int32)
