"""The cheapest few sensors that leave little enough uncertainty: all sets considered, exactly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _soft
from trackfield.errors import InputError
from trackfield.types import Indices, Matrix, Vector

MOST = 3
"""Sensors of a set, at most."""


class Choice(NamedTuple):
    """Sensors that were chosen, with the leading axes of the prior.

    `sensors` (..., 3) are rows of the gains, -1 where fewer are enough; `trace` (...) of the
    covariance that their readings will leave [m^2], infinite where a direction stays open; `cost`
    (...) the sum of their weights. Where no set keeps the bound `feasible` is false, and the choice
    is the best that can be reached.
    """

    sensors: Indices
    trace: Vector
    cost: Vector
    feasible: NDArray[np.bool_]


def cheapest(
    information: Matrix,
    gains: Matrix,
    *,
    weights: Vector,
    bound: float | Vector,
    worth: float | Vector = 0.0,
    limits: tuple[int, int] = (0, MOST),
) -> Choice:
    """Least sum of `weights` over sets S with tr (prior + sum_{i in S} g_i g_i')^-1 <= bound.

    `information` (..., d, d) [1/m^2] of the prior, `gains` (..., n, d) [1/m], `weights` (..., n) at
    least 0, infinite for a sensor that cannot be asked; d is 2 or 3; `limits` are the fewest and
    the most sensors, at most 3. A sharper result may have a `worth` (...) [1/m^2]: then sum of
    weights + worth x trace is least. Of sets that cost the same the sharpest is taken. Pham (5.4),
    with the prior counted.

    Raises `InputError` for other shapes, weights that are negative or no numbers, and gains or
    information that are not finite.
    """
    J, g, w = (np.asarray(part, np.float64) for part in (information, gains, weights))
    _check(J, g, w)
    fewest, most = limits
    if not 0 <= fewest <= most <= MOST or most == 0:
        raise InputError(
            f"found {fewest} to {most} sensors, expected 0 <= fewest <= most <= {MOST}"
        )
    if not (np.asarray(worth) >= 0.0).all():
        raise InputError("found a worth that is negative or no number, expected 0 or more")
    lead = np.broadcast_shapes(
        J.shape[:-2], g.shape[:-2], w.shape[:-1], np.shape(bound), np.shape(worth)
    )
    n, d = g.shape[-2:]
    sensors, cost, trace = _soft.cheapest(
        _stacked(J, lead, (d, d)),
        _stacked(g, lead, (n, d)),
        _stacked(w, lead, (n,)),
        _stacked(np.asarray(bound, np.float64), lead, ()),
        _stacked(np.asarray(worth, np.float64), lead, ()),
        fewest,
        most,
    )
    kept = trace.reshape(lead) <= bound
    none = np.isinf(cost).reshape(lead)
    return Choice(
        sensors.reshape(*lead, MOST),
        trace.reshape(lead),
        np.where(none, 0.0, cost.reshape(lead)),
        np.asarray(kept),
    )


def _stacked(part: Matrix, lead: tuple[int, ...], own: tuple[int, ...]) -> Matrix:
    """Give `part` all the leading axes, as one."""
    return np.ascontiguousarray(np.broadcast_to(part, lead + own)).reshape(math.prod(lead), *own)


def _check(J: Matrix, g: Matrix, w: Vector) -> None:
    d = g.shape[-1] if g.ndim >= 2 else 0
    if d not in (2, 3) or J.shape[-2:] != (d, d) or w.shape[-1:] != g.shape[-2:-1]:
        raise InputError(
            f"information of shape {J.shape}, gains of shape {g.shape} and weights of shape "
            f"{w.shape}: expected (..., d, d), (..., n, d) and (..., n) with d 2 or 3"
        )
    if not (np.isfinite(g).all() and np.isfinite(J).all()):
        raise InputError("found gains or information that are no numbers, expected finite ones")
    if not (w >= 0.0).all():
        raise InputError("found a weight that is negative or no number, expected 0 to infinity")
