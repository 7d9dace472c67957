"""What a set of sensors leaves unknown: A, D and E of optimal design, and free directions.

What one reading of sensor i says of the target is the information g g', g its row of `gains`: slope
of the expected reading over the standard deviation of its noise. A set S and a prior P leave
M = P + sum_{i in S} g_i g_i'. The criteria are A, the trace of M^-1 (the mean squared error, the
less the better); D, log det M; E, the smallest eigenvalue of M (both the more the better).
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from trackfield._core import _selection
from trackfield.errors import InputError
from trackfield.types import Indices, Matrix, Vector

Criterion = Literal["A", "D", "E"]
CRITERIA: tuple[Criterion, ...] = ("A", "D", "E")
DIMENSIONS = 6  # at most
LARGEST, SILENT = 1e40, 1e-40  # gains: more is refused, less says nothing
FINE, COARSE = 1e-13, 1e-5
"""Information of free directions in a search, as share of the largest |g|^2: so little that it does
not count where something is known of all of them, and enough to compare sets where not."""


class Known(NamedTuple):
    """What a set knows: `covariance` (d, d) [m^2], `missing` (m, d) free directions, `value`."""

    covariance: Matrix
    missing: Matrix
    value: float


def known(gains: Matrix, *, prior: Matrix, criterion: Criterion = "A") -> Known:
    """Tell what readings with these `gains` (k, d) and the prior (d, d) leave, and its value.

    Directions without information have the variance `linalg.UNKNOWN_VARIANCE`, or 1e12 times the
    least one if that is less, as in `linalg.covariance_of`.
    """
    every = np.arange(len(gains), dtype=np.int32)
    return left(gains, every, prior=prior, code=criterion_code(criterion))


def left(gains: Matrix, rows: Indices, *, prior: Matrix, code: int) -> Known:
    """Tell what readings of `rows` (k,) of contiguous gains (n, d) leave; see `known`."""
    return Known(*_selection.left(gains[None], prior[None], rows, code))


class Scaled(NamedTuple):
    """Gains (n, d) of which the largest entry is 1, and the prior with them, in units of `length`.

    So that a search meets the same numbers whatever the unit; `length` is 0 where nobody says
    anything.
    """

    gains: Matrix
    prior: Matrix
    length: float


def scaled(gains: Matrix, prior: Matrix) -> Scaled:
    """Measure lengths in units in which the largest gain is 1."""
    largest = float(np.abs(gains).max(initial=0.0))
    if largest < SILENT:
        return Scaled(gains, prior, 0.0)
    return Scaled(gains / largest, prior / largest**2, 1.0 / largest)


def rescaled(value: float, length: float, *, criterion: Criterion, d: int) -> float:
    """Turn a value in other units of length into one in metres: A m^2, E 1/m^2, D log 1/m^(2 d)."""
    if criterion == "A":
        return value * length**2
    return value - 2.0 * d * math.log(length) if criterion == "D" else value / length**2


def ratio(value: float, bound: float, *, criterion: Criterion, d: int) -> float:
    """How many times the best a value is at most, >= 1: of variances, for D of their mean.

    A, value / bound; D, e^((bound - value) / d); E, bound / value.
    """
    if criterion == "A":
        return value / bound
    return math.exp((bound - value) / d) if criterion == "D" else bound / value


def criterion_code(criterion: Criterion) -> int:
    """Give the number of a criterion; `InputError` if there is none such."""
    if criterion not in CRITERIA:
        raise InputError(f"criterion: found {criterion!r}, expected one of A, D, E")
    return CRITERIA.index(criterion)


def checked(gains: Matrix, prior: Matrix | None) -> tuple[Matrix, Matrix]:
    """Gains (n, d) and prior (d, d), zero for None, contiguous; `InputError` if they are none."""
    g = np.ascontiguousarray(gains, float)
    if g.ndim != 2 or not 1 <= g.shape[1] <= DIMENSIONS:
        raise InputError(f"gains of shape {g.shape}: expected (n, d), d from 1 to {DIMENSIONS}")
    fine = np.abs(g) <= LARGEST
    if not fine.all():
        i = int(np.flatnonzero(~fine.all(axis=1))[0])
        raise InputError(f"gains of sensor {i}: found {g[i].tolist()}, expected finite numbers")
    d = g.shape[1]
    return g, np.zeros((d, d)) if prior is None else checked_prior(prior, d)


def checked_prior(prior: Matrix, d: int) -> Matrix:
    """Prior information (d, d), contiguous; `InputError` if it is none."""
    p = np.ascontiguousarray(prior, float)
    if p.shape != (d, d) or not (np.abs(p) <= LARGEST**2).all():
        raise InputError(f"prior of shape {p.shape}: expected finite numbers, ({d}, {d})")
    slack = 1e-9 * float(np.abs(p).max())
    if float(np.abs(p - p.T).max()) > slack or float(np.linalg.eigvalsh(p)[0]) < -slack:
        raise InputError(f"prior: found {p.tolist()}, expected symmetric, positive semidefinite")
    return p


def checked_costs(costs: Vector, n: int) -> Vector:
    """Costs (n,), finite and at least 0, contiguous; `InputError` if they are not."""
    c = np.ascontiguousarray(costs, float)
    if c.shape != (n,):
        raise InputError(f"costs of shape {c.shape}: expected ({n},)")
    fine = np.isfinite(c) & (c >= 0.0)
    if not fine.all():
        i = int(np.flatnonzero(~fine)[0])
        raise InputError(f"cost of sensor {i}: found {c[i]:g}, expected a number, at least 0")
    return c


def checked_number(k: int, what: str = "sensors to select") -> int:
    """Return k >= 1; `InputError` if it is less."""
    if k < 1:
        raise InputError(f"{what}: found {k}, expected at least 1")
    return k
