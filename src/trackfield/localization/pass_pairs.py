"""The four passes that two sensors would have told alike: Berger (20)-(36), without 0/0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.sensing.profile import Profile, steepness
from trackfield.types import Matrix

SIDES = np.array([[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0]])
"""On which side of the way each sensor stands: two interior solutions, then two exterior ones."""


class PairPasses(NamedTuple):
    """Passes `theta` (4, 5): P, x0, y0 at time 0, vx, vy, for the rows of `SIDES`.

    `moves` (4,) is false where the speed would be infinite: both sensors say the same time and
    (interior: never) the same width. Their rows of `theta` are zero.
    """

    theta: Matrix
    moves: NDArray[np.bool_]


def pair_passes(
    first: Profile, second: Profile, sensors: Matrix, *, exponent: float = 1.0
) -> PairPasses:
    """All passes of which `sensors` (2, 2) would send just these two messages.

    With S = (s2 D2 - s1 D1) / sqrt(c) and C = t2 - t1 from widths D, times t and sides s = +-1, and
    D = |xs2 - xs1|: speed |v| = D / hypot(S, C), heading that of xs2 - xs1 plus atan2(S, C), n = v
    turned by 90 degrees over |v|, x0 = xs1 + s1 d1 n - t1 v, d = width |v| / sqrt(c). Berger
    (25)-(36), corrected. P is the geometric mean of what both amplitudes say, which is one number
    if they go with the widths.
    """
    psi = np.array([first.array(), second.array()])
    if psi.shape != (2, 3) or np.shape(sensors) != (2, 2):
        raise InputError(f"two messages and sensors (2, 2) expected, found {np.shape(sensors)}")
    if not np.isfinite(psi).all() or not (psi[:, (0, 2)] > 0.0).all():
        raise InputError("a pair wants two messages that heard something, with finite numbers")
    root = np.sqrt(steepness(exponent))
    (a1, t1, w1), (a2, t2, w2) = psi
    base = np.asarray(sensors[1] - sensors[0], float)
    S = (SIDES[:, 1] * w2 - SIDES[:, 0] * w1) / root
    C = t2 - t1
    slow = np.hypot(S, C)
    reach = np.hypot(*base)
    moves = (slow > 1e-12 * (w1 + w2 + abs(C))) & (reach > 0.0)
    speed = reach / np.where(moves, slow, 1.0)
    heading = np.arctan2(base[1], base[0]) + np.arctan2(S, C)
    u = np.column_stack([np.cos(heading), np.sin(heading)])
    n = np.column_stack([-u[:, 1], u[:, 0]])
    v = speed[:, None] * u
    x0 = sensors[0] + (SIDES[:, 0] * w1 * speed / root)[:, None] * n - t1 * v
    power = a1 * a2 * (w1 * w2 * (speed / root) ** 2) ** exponent
    theta = np.column_stack([power, x0, v])
    return PairPasses(np.where(moves[:, None], theta, 0.0), moves)
