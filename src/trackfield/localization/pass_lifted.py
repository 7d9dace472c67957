"""One linear solution of a pass from three or more sensors, no mirror images: a start.

The squared distance over Q = P^(1/alpha), a^(-2/alpha), is a quadratic in time, and its
coefficients are linear in [1/Q, x0/Q, y0/Q, |x0|^2/Q, vx/Q, vy/Q, v x0/Q, |v|^2/Q]. Three sensors
fix all of these but one, and that follows from 1/Q = |v/Q|^2 / (|v|^2/Q). New, not in Berger.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.linalg import cholesky
from trackfield.sensing.profile import Profile, steepness
from trackfield.types import Matrix, Vector

UNKNOWNS = 8
_ROUNDING = 1e-11  # of the smallest over the largest eigenvalue: below it a direction is not fixed


class LiftedPass(NamedTuple):
    """Pass `theta` (5,): P, x0, y0 at time 0, vx, vy.

    `rank`: how many of the 8 unknowns the messages fix, 8 by four sensors, 7 by three, 6 by any
    number in a line. `condition` of the other 7 equations, each scaled to one. `determined` is
    false below rank 7, and where 1/Q or the speed comes out as no such thing; `theta` is zero then.
    """

    theta: Vector
    rank: int
    condition: float
    determined: bool


class LiftedSum(NamedTuple):
    """Normal equations `matrix` (8, 8) and `right` (8,) of that many `messages`; they add up.

    `origin` (2,) [m] and `time_s` are where positions and times are counted from: near the sensors
    and the pass, or digits are lost.
    """

    matrix: Matrix
    right: Vector
    messages: int
    origin: Vector
    time_s: float = 0.0

    def added(
        self, message: Profile, fisher: Matrix, sensor: Vector, *, exponent: float = 1.0
    ) -> LiftedSum:
        """Return the sum with one more `message`, its Fisher matrix (3, 3) and `sensor` (2,)."""
        a, t, width = (float(part) for part in message)
        t -= self.time_s
        if not (a > 0.0 and width > 0.0 and np.isfinite([a, t, width]).all()):
            raise InputError(f"found {tuple(message)}, expected a_max > 0, a time, width_s > 0")
        c = float(steepness(exponent)) / width**2
        per = a ** (-2.0 / exponent)
        quadratic = per * np.array([1.0 + c * t**2, -2.0 * c * t, c])
        slopes = np.column_stack(
            [
                -2.0 / exponent / a * quadratic,
                per * np.array([2.0 * c * t, -2.0 * c, 0.0]),
                -2.0 / width * (quadratic - per * np.array([1.0, 0.0, 0.0])),
            ]
        )
        inverse = np.linalg.inv(slopes)
        W = inverse.T @ np.asarray(fisher, float) @ inverse
        x, y = np.asarray(sensor, float) - self.origin
        H = np.zeros((3, UNKNOWNS))
        H[0, :4] = x**2 + y**2, -2.0 * x, -2.0 * y, 1.0
        H[1, 4:7] = -2.0 * x, -2.0 * y, 2.0
        H[2, 7] = 1.0
        return self._replace(
            matrix=self.matrix + H.T @ W @ H,
            right=self.right + H.T @ W @ quadratic,
            messages=self.messages + 1,
        )

    def solved(self, *, exponent: float = 1.0) -> LiftedPass:
        """Solve for the pass; told where it is not determined."""
        size = np.sqrt(np.diag(self.matrix))
        size = np.where(size > 0.0, size, 1.0)
        N, b = self.matrix / np.outer(size, size), self.right / size
        roots = np.linalg.eigvalsh(N)
        rank = int((roots > _ROUNDING * roots[-1]).sum())
        inner = np.linalg.eigvalsh(N[1:, 1:])
        condition = float(inner[-1] / max(inner[0], np.finfo(float).eps * inner[-1], 1e-300))
        lower, ok = cholesky(N[1:, 1:])
        nothing = LiftedPass(np.zeros(5), rank, condition, determined=False)
        if rank < UNKNOWNS - 1 or not ok or not inner[0] > _ROUNDING * inner[-1]:
            return nothing
        # without the first unknown, and by how much the others go with it
        half = np.linalg.solve(lower, np.column_stack([b[1:], -N[1:, 0]]))
        apart, along = np.linalg.solve(lower.T, half).T
        z = np.concatenate([[0.0], apart]) / size
        first = float((b[0] - N[0, 1:] @ apart) / (N[0, 0] + N[0, 1:] @ along) / size[0])
        if rank < UNKNOWNS:
            first = float(z[4:6] @ z[4:6] / z[7]) if z[7] > 0.0 else 0.0
        z += first * size[0] * np.concatenate([[1.0], along]) / size
        if not z[0] > 0.0 or not np.hypot(z[4], z[5]) > 0.0:
            return nothing
        v = z[4:6] / z[0]
        x0 = self.origin + z[1:3] / z[0] - self.time_s * v
        return LiftedPass(np.array([z[0] ** -exponent, *x0, *v]), rank, condition, determined=True)


def empty(origin: Vector, *, time_s: float = 0.0) -> LiftedSum:
    """Return the sum of no messages."""
    where = np.asarray(origin, float)
    return LiftedSum(np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS), 0, where, time_s)
