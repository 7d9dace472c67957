"""Products and solves for stacks of small matrices (..., n, n) and vectors (..., n)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Matrix, Vector

Floats = NDArray[np.floating[Any]]


def apply(matrix: Floats, vector: Floats) -> Vector:
    """Return the products (..., m) of matrices (..., m, n) and vectors (..., n)."""
    return np.asarray((matrix @ vector[..., None])[..., 0], dtype=np.float64)


def solve(matrix: Floats, vector: Floats) -> Vector:
    """Return matrix^-1 vector (..., n) of matrices (..., n, n) and vectors (..., n)."""
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0], dtype=np.float64)


def transposed(matrix: Floats) -> Matrix:
    """Swap the last two axes."""
    return np.asarray(np.swapaxes(matrix, -1, -2), dtype=np.float64)


def symmetric(matrix: Floats) -> Matrix:
    """Return the symmetric part, so that rounding does not accumulate."""
    return 0.5 * (np.asarray(matrix, dtype=np.float64) + transposed(matrix))


def form(vector: Floats, matrix: Floats) -> Vector:
    """Return the quadratic forms v' M v (...) of vectors (..., n) and matrices (..., n, n)."""
    return (vector * apply(matrix, vector)).sum(-1)
