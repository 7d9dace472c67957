"""The paper's randomized assignment by determinants, Oh (25) and Algorithm 5, corrected.

A matrix with random numbers where c_ij <= c* is singular, almost surely, unless these pairs make an
assignment. Kept to compare with: where costs tie, the pair that it fixes at a threshold need not be
one of an assignment there, and the last capture comes later than it must; `assignment` is exact.
"""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.types import Indices, Matrix

_SINGULAR = 1e-12  # reciprocal condition number of a matrix that is taken for singular
_TRIALS = 3


def assign_by_determinants(costs: Matrix, *, rng: np.random.Generator) -> Indices:
    """Evader (n,) of each pursuer by Algorithm 5; square, finite costs (n, n) [s]."""
    c = np.array(costs, np.float64)
    if c.ndim != 2 or c.shape[0] != c.shape[1] or not np.isfinite(c).all():
        raise InputError(f"costs of shape {c.shape}: expected finite ones, (n, n)")
    evader = np.full(len(c), -1, np.int32)
    rows, columns = np.arange(len(c)), np.arange(len(c))
    while rows.size:
        i, j = _first_at_threshold(c, rng)
        evader[rows[i]] = columns[j]
        c = np.delete(np.delete(c, i, axis=0), j, axis=1)
        rows, columns = np.delete(rows, i), np.delete(columns, j)
    return evader


def _first_at_threshold(c: Matrix, rng: np.random.Generator) -> tuple[int, int]:
    """Pair (i*, j*) of the least cost whose matrix is not singular: the first in the table."""
    values = np.unique(c)
    low, high = 0, values.size - 1
    while low < high:
        middle = (low + high) // 2
        regular = any(_regular(c <= values[middle], rng) for _ in range(_TRIALS))
        low, high = (low, middle) if regular else (middle + 1, high)
    i, j = np.argwhere(c == values[low])[0]
    return int(i), int(j)


def _regular(kept: Matrix, rng: np.random.Generator) -> bool:
    """Test Tutte's matrix [[0, C], [-C', 0]] of random numbers: det = det(C)^2."""
    random = np.where(kept, rng.uniform(size=kept.shape), 0.0)
    singular = np.linalg.svd(random, compute_uv=False)
    return bool(singular[-1] > _SINGULAR * singular[0])
