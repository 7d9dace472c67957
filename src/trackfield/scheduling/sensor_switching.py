"""Which sensors of angular rate take over as a target moves: the paper's rule, Cheng section 4.

The rule keeps E'E, by which the paper's tracker finds the velocity, as near as possible to what it
was. It asks nothing of what the readings are worth; `informative` does, and tracks better.
"""

from __future__ import annotations

import math
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.filtering.angle_observer import rows
from trackfield.localization.information import AnyModels, reading_gains
from trackfield.scheduling.selection import Selection, select
from trackfield.types import Indices, Matrix, Vector

SETS = 50_000
"""Sets that are compared, at most."""
_LEAST = 1e-5  # of the larger singular value of E, below which its rank is 1


class SwitchCost(NamedTuple):
    """Change |E'E(new) - E'E(old)| (Frobenius), and the rank of E(new)."""

    cost: float
    rank: int


class Switching(NamedTuple):
    """Sensors (k,) that take over, ascending; `found` is False where no set has rank 2."""

    sensors: Indices
    cost: float
    found: bool


def switching_cost(position: Vector, old: Matrix, new: Matrix) -> SwitchCost:
    """Cost of going from sensors at `old` (m, 2) to `new` (k, 2), a target at `position` (2,)."""
    before, after = (rows(position - places) for places in (old, new))
    change = after.T @ after - before.T @ before
    return SwitchCost(float(np.linalg.norm(change)), int(np.linalg.matrix_rank(after, rtol=_LEAST)))


def switch(
    position: Vector, sensors: Matrix, *, active: Indices, usable: Indices, k: int
) -> Switching:
    """Choose k of the `usable` sensors: least |E'E(new) - E'E(active)|, such that E has rank 2.

    `sensors` (n, 2) are all places, `active` the rows that have sensed so far, `usable` those that
    may sense now (the paper's range constraint). All sets are compared; `InputError` for more than
    `SETS`, and for positions that are not finite.
    """
    choices = math.comb(usable.size, k) if usable.size >= k >= 1 else 0
    if not 0 < choices <= SETS:
        raise InputError(
            f"found {choices} sets of {k} among {usable.size} sensors, expected 1 to {SETS}"
        )
    if not (np.isfinite(position).all() and np.isfinite(sensors).all()):
        raise InputError("found places that are not finite, expected finite numbers")
    E = rows(position - sensors)
    each = E[:, :, None] * E[:, None, :]
    wanted = each[active].sum(axis=0)
    sets = np.array(list(islice(combinations(np.sort(usable), k), SETS)), np.int32)
    square = each[sets].sum(axis=1)
    cost = np.linalg.norm(square - wanted, axis=(1, 2))
    observable = _full(square)
    best = int(np.argmin(np.where(observable, cost, np.inf)))
    if not observable[best]:
        best = int(np.argmin(cost))
    return Switching(sets[best], float(cost[best]), bool(observable[best]))


def informative(
    models: AnyModels,
    sensors: Matrix,
    state: Vector,
    *,
    prior: Matrix,
    usable: Indices,
    k: int,
) -> Selection:
    """Choose k of the `usable` sensors whose readings leave least variance of the place.

    `prior` (2 d, 2 d) is the information on the `state` before the readings. `Selection.sensors`
    are rows of `sensors`. The trace of the covariance is taken in units in which the prior's place
    and velocity count alike.
    """
    gains = reading_gains(models, sensors, state)[usable]
    scale = np.sqrt(np.diag(np.linalg.inv(prior)))
    found = select(gains * scale, k, prior=prior * scale[:, None] * scale)
    return found._replace(sensors=usable[found.sensors])


def _full(square: Matrix) -> NDArray[np.bool_]:
    """Whether E'E (..., 2, 2) has rank 2."""
    roots = np.linalg.eigvalsh(square)
    return np.asarray(roots[..., 0] > _LEAST**2 * roots[..., 1])
