"""Distances between the set of targets and the set of shown tracks: OSPA and GOSPA."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.matching import cheapest
from trackfield.metrics.steps import Pairs, Steps, distances
from trackfield.types import Indices, Matrix, Vector

MOST_DIGITS = 100  # of cutoff^order: sums of it must stay numbers


class Gospa(NamedTuple):
    """GOSPA of two sets [m] and what it is made of.

    gospa_m^p = `localisation` + c^p / 2 (`missed` + `false`) for alpha = 2, p the order, c the
    cut-off: `localisation` is the sum of d^p [m^p] over assigned pairs less than c apart, `missed`
    the number of targets and `false` that of tracks outside of such pairs.
    """

    gospa_m: float
    localisation: float
    missed: int
    false: int


class SetDistances(NamedTuple):
    """OSPA and GOSPA at each step (T,), with the parts of `Gospa`."""

    ospa_m: Vector
    gospa_m: Vector
    localisation: Vector
    missed: Indices
    false: Indices


def ospa(truth: Matrix, shown: Matrix, *, cutoff_m: float = 5.0, order: float = 2.0) -> float:
    """OSPA = ((min_pi sum min(d, c)^p + c^p |n - m|) / max(n, m))^(1/p) [m]; 0 for empty sets.

    `truth` (n, d) and `shown` (m, d) are positions [m]; c is `cutoff_m` and p, at least 1, the
    `order`. `InputError` for others. Schuhmacher, Vo, Vo (2008).
    """
    return float(_of_sets(truth, shown, _checked(cutoff_m, order, 2.0)).ospa_m[0])


def gospa(
    truth: Matrix,
    shown: Matrix,
    *,
    cutoff_m: float = 5.0,
    order: float = 2.0,
    alpha: float = 2.0,
) -> Gospa:
    """GOSPA = (min_pi sum min(d, c)^p + c^p / alpha |n - m|)^(1/p) [m], 0 < alpha <= 2.

    `truth` (n, d) and `shown` (m, d) are positions [m]; c is `cutoff_m` and p, at least 1, the
    `order`. `InputError` for others. Rahmathullah, Garcia-Fernandez, Svensson (2017).
    """
    found = _of_sets(truth, shown, _checked(cutoff_m, order, alpha))
    return Gospa(
        float(found.gospa_m[0]),
        float(found.localisation[0]),
        int(found.missed[0]),
        int(found.false[0]),
    )


def set_distances(
    steps: Steps, near: Pairs, *, cutoff_m: float = 5.0, order: float = 2.0, alpha: float = 2.0
) -> SetDistances:
    """OSPA and GOSPA of all steps; `near` holds at least all pairs closer than `cutoff_m`."""
    count = steps.t_s.size
    sizes = steps.truth.counts(count), steps.shown.counts(count)
    return _distances(near, steps.truth.step, sizes, _checked(cutoff_m, order, alpha))


class _Parameters(NamedTuple):
    c: float
    p: float
    alpha: float


def _of_sets(truth: Matrix, shown: Matrix, parameters: _Parameters) -> SetDistances:
    one, other = np.asarray(truth, np.float64), np.asarray(shown, np.float64)
    for what, positions in (("truth", one), ("shown", other)):
        if not np.isfinite(positions).all():
            raise InputError(f"{what}: found positions that are no numbers, expected finite ones")
    n, m = len(one), len(other)
    size = (one if n else other).size // max(n or m, 1)
    distance = distances(one.reshape(n, size), other.reshape(m, size))
    i, j = np.nonzero(distance < parameters.c)
    near = Pairs(i.astype(np.int32), j.astype(np.int32), distance[i, j])
    sizes = np.array([n], np.int32), np.array([m], np.int32)
    return _distances(near, np.zeros(n, np.int32), sizes, parameters)


def _distances(
    near: Pairs, step: Indices, sizes: tuple[Indices, Indices], parameters: _Parameters
) -> SetDistances:
    """Distances by step; `step` is that of each target's row, `sizes` those of the two sets."""
    c, p, alpha = parameters
    n, m = sizes
    close = near.within(c)
    share = (close.distance / c) ** p  # of c^p
    # Assigned pairs beyond the cut-off cost c^p each, as much as their members alone: only pairs
    # within the cut-off decide, for every alpha.
    chosen = cheapest(close.truth, close.shown, share, alone=1.0)
    where = step[close.truth[chosen]]
    local = np.bincount(where, weights=share[chosen], minlength=n.size)
    matched = np.bincount(where, minlength=n.size)
    low, high = np.minimum(n, m), np.maximum(n, m)
    mean = (local + (high - matched)) / np.maximum(high, 1)
    total = local + (low - matched) + (high - low) / alpha
    return SetDistances(
        ospa_m=c * mean ** (1.0 / p),
        gospa_m=c * total ** (1.0 / p),
        localisation=c**p * local,
        missed=(n - matched).astype(np.int32),
        false=(m - matched).astype(np.int32),
    )


def _checked(cutoff_m: float, order: float, alpha: float) -> _Parameters:
    """Refuse parameters for which these are no distances."""
    if not 0.0 < cutoff_m < math.inf:
        raise InputError(f"found a cut-off of {cutoff_m:g} m, expected a finite one above 0")
    if not 1.0 <= order < math.inf or order * math.log10(max(cutoff_m, 1.0)) > MOST_DIGITS:
        raise InputError(
            f"found order {order:g}, expected at least 1 and cutoff^order below 1e{MOST_DIGITS}"
        )
    if not 0.0 < alpha <= 2.0:
        raise InputError(f"found alpha {alpha:g}, expected a number above 0, at most 2")
    return _Parameters(float(cutoff_m), float(order), float(alpha))
