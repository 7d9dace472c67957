"""Nodes on one line with the target say the same of it: keep two of each chain, Pham 5.3.3.

Seen from the target, opposite directions are one line.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Indices, Matrix, Vector

ANGLE_RAD = math.radians(15.0)
"""Neighbours in bearing that are closer form a chain: leaves Pham's 6 of 24 nodes."""
KEPT = 2  # of a chain


def chains(directions: Matrix, *, angle_rad: float = ANGLE_RAD) -> Indices:
    """Find the chain (n,) of each direction (n, 2), -1 for a zero one, which has no line.

    Lines sorted by bearing in [0, pi); neighbours that differ by less than `angle_rad` are of one
    chain, and the last line is a neighbour of the first. `InputError` for directions that are not
    finite or not in the plane.
    """
    if not 0.0 < angle_rad < math.pi:
        raise InputError(f"angle_rad: found {angle_rad}, expected between 0 and pi")
    u = np.asarray(directions, np.float64)
    if u.ndim != 2 or u.shape[1] != 2 or not np.isfinite(u).all():
        raise InputError(f"directions of shape {u.shape}, expected finite ones of shape (n, 2)")
    numbers = np.full(len(u), -1, np.int32)
    lines = np.flatnonzero((u != 0.0).any(axis=1))
    if not lines.size:
        return numbers
    bearing = np.arctan2(u[lines, 1], u[lines, 0]) % math.pi
    bearing[bearing == math.pi] = 0.0  # a tiny negative angle rounds up to pi
    order = np.argsort(bearing, kind="stable")
    gaps = np.diff(bearing[order], append=bearing[order[0]] + math.pi)
    ends = np.flatnonzero(gaps >= angle_rad)
    if not ends.size:
        numbers[lines] = 0
        return numbers
    # What comes after the last end runs on through pi into the first chain.
    of_sorted = np.searchsorted(ends, np.arange(lines.size)) % ends.size
    numbers[lines[order]] = of_sorted
    return numbers


def eliminate_collinear(
    directions: Matrix, residual: Vector, *, angle_rad: float = ANGLE_RAD
) -> NDArray[np.intp]:
    """Keep the two nodes of each chain with the most residual energy; their numbers, rising.

    `directions` (n, 2) from the target to the nodes or back, or gains; `residual` (n,). Of equal
    nodes the first ones stay; a node at the target itself has no direction and goes. Pham 5.3.3,
    step 2.
    """
    energies = np.asarray(residual, np.float64)
    numbers = chains(directions, angle_rad=angle_rad)
    if energies.shape != numbers.shape:
        raise InputError(f"residual of shape {energies.shape}, expected {numbers.shape}")
    if not np.isfinite(energies).all() or (energies < 0.0).any():
        raise InputError("residual: expected energies of 0 or more")
    by_chain = np.lexsort((-energies, numbers))
    sorted_numbers = numbers[by_chain]
    rank = np.arange(len(numbers)) - np.searchsorted(sorted_numbers, sorted_numbers)
    return np.sort(by_chain[(rank < KEPT) & (sorted_numbers >= 0)])
