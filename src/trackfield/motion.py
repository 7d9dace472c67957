"""How targets move: linear models for the Kalman filter, and a turn whose rate is unknown.

States are positions, then velocities: [x, y, vx, vy], in 3-D [x, y, z, vx, vy, vz].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from trackfield.types import Matrix, Vector


class Motion(Protocol):
    """x' = F(dt) x + w, w ~ N(0, Q(dt)); F and Q (n, n), dt in seconds."""

    def transition(self, dt_s: float) -> Matrix:
        """F of a step of `dt_s`."""
        ...

    def noise(self, dt_s: float) -> Matrix:
        """Q of a step of `dt_s`."""
        ...


@runtime_checkable
class CurvedMotion(Protocol):
    """x' = f(x, dt) + w, w ~ N(0, Q(dt)), with df/dx; states (..., n)."""

    def move(self, state: Vector, dt_s: float) -> Vector:
        """f: the state after `dt_s` without noise, (..., n)."""
        ...

    def jacobian(self, state: Vector, dt_s: float) -> Matrix:
        """df/dx at `state`, (..., n, n)."""
        ...

    def noise(self, dt_s: float) -> Matrix:
        """Q of a step of `dt_s`."""
        ...


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """Velocity driven by white acceleration of density q [m^2/s^3], continuous in time.

    Q(dt) = q [[dt^3/3, dt^2/2], [dt^2/2, dt]] per axis: two half steps equal one whole step.
    """

    accel_density: float
    dimensions: int = 2

    def transition(self, dt_s: float) -> Matrix:
        """Return F (2d, 2d)."""
        return _per_axis([[1.0, dt_s], [0.0, 1.0]], self.dimensions)

    def noise(self, dt_s: float) -> Matrix:
        """Return Q (2d, 2d)."""
        q = self.accel_density
        cross = q * dt_s**2 / 2
        return _per_axis([[q * dt_s**3 / 3, cross], [cross, q * dt_s]], self.dimensions)


@dataclass(frozen=True, slots=True)
class SteppedAcceleration:
    """Acceleration constant in a step, independent between steps, Wang (1): Q = G Q_w G'.

    `accel_variance` [m^2/s^4] has one entry an axis: the diagonal of Q_w. Q has half rank, and two
    half steps are not one whole step: use it at a fixed rate, as Wang does.
    """

    accel_variance: tuple[float, ...]

    def transition(self, dt_s: float) -> Matrix:
        """Return F (2d, 2d)."""
        return _per_axis([[1.0, dt_s], [0.0, 1.0]], len(self.accel_variance))

    def noise(self, dt_s: float) -> Matrix:
        """Return Q (2d, 2d)."""
        g = np.array([dt_s**2 / 2, dt_s])
        return _kron(np.outer(g, g), np.diag(self.accel_variance))


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """Position without velocity, driven by white velocity of density q [m^2/s]; Q = q dt I."""

    velocity_density: float
    dimensions: int = 2

    def transition(self, dt_s: float) -> Matrix:
        """Return F = I (d, d)."""
        del dt_s
        return np.eye(self.dimensions)

    def noise(self, dt_s: float) -> Matrix:
        """Return Q (d, d)."""
        return self.velocity_density * dt_s * np.eye(self.dimensions)


@dataclass(frozen=True, slots=True)
class CoordinatedTurn:
    """Velocity turning at a known rate w [rad/s, counter-clockwise] with white acceleration q.

    Q is the exact integral over the step; w = 0 is `ConstantVelocity`.
    """

    rate_rad_s: float
    accel_density: float

    def transition(self, dt_s: float) -> Matrix:
        """Return F (4, 4)."""
        along, aside = _arc(self.rate_rad_s, dt_s)
        F = np.eye(4)
        F[:2, 2:] = _rotation(along, aside)
        turn = self.rate_rad_s * dt_s
        F[2:, 2:] = _rotation(math.cos(turn), math.sin(turn))
        return F

    def noise(self, dt_s: float) -> Matrix:
        """Return Q (4, 4)."""
        q, turn = self.accel_density, self.rate_rad_s * dt_s
        excess = _sine_excess(turn)
        Q = np.zeros((4, 4))
        Q[:2, :2] = 2.0 * q * dt_s**3 * excess * np.eye(2)
        Q[2:, 2:] = q * dt_s * np.eye(2)
        symmetric = q * dt_s**2 / 2 * np.sinc(turn / (2 * math.pi)) ** 2
        Q[:2, 2:] = _rotation(symmetric, -q * dt_s**2 * turn * excess)
        Q[2:, :2] = Q[:2, 2:].T
        return Q


@dataclass(frozen=True, slots=True)
class UnknownTurn:
    """State [x, y, vx, vy, w]: velocity turning at rate w, which wanders; a curved motion.

    w is a random walk of density `rate_density` [rad^2/s^3]; white acceleration of density
    `accel_density` [m^2/s^3] acts besides.
    """

    accel_density: float
    rate_density: float

    def move(self, state: Vector, dt_s: float) -> Vector:
        """Return f (..., 5)."""
        vx, vy, w = state[..., 2], state[..., 3], state[..., 4]
        along, aside = _arcs(w, dt_s)
        cos, sin = np.cos(w * dt_s), np.sin(w * dt_s)
        moved = np.array(state, dtype=np.float64)
        moved[..., 0] += along * vx - aside * vy
        moved[..., 1] += aside * vx + along * vy
        moved[..., 2] = cos * vx - sin * vy
        moved[..., 3] = sin * vx + cos * vy
        return moved

    def jacobian(self, state: Vector, dt_s: float) -> Matrix:
        """Return df/dx (..., 5, 5)."""
        vx, vy, w = state[..., 2], state[..., 3], state[..., 4]
        along, aside = _arcs(w, dt_s)
        d_along, d_aside = _arc_slopes(w, dt_s)
        cos, sin = np.cos(w * dt_s), np.sin(w * dt_s)
        J = np.zeros((*state.shape, 5))
        J[...] = np.eye(5)
        J[..., 0, 2] = J[..., 1, 3] = along
        J[..., 1, 2], J[..., 0, 3] = aside, -aside
        J[..., 2, 2] = J[..., 3, 3] = cos
        J[..., 3, 2], J[..., 2, 3] = sin, -sin
        J[..., 0, 4] = d_along * vx - d_aside * vy
        J[..., 1, 4] = d_aside * vx + d_along * vy
        J[..., 2, 4] = -dt_s * (sin * vx + cos * vy)
        J[..., 3, 4] = dt_s * (cos * vx - sin * vy)
        return J

    def noise(self, dt_s: float) -> Matrix:
        """Return Q (5, 5)."""
        Q = np.zeros((5, 5))
        Q[:4, :4] = ConstantVelocity(self.accel_density).noise(dt_s)
        Q[4, 4] = self.rate_density * dt_s
        return Q


@dataclass(frozen=True, slots=True)
class StraightLeg:
    """The straight mode beside `UnknownTurn`: constant velocity, the rate w forgotten each step.

    State [x, y, vx, vy, w]; w becomes N(0, rate_sigma^2) [rad/s], ready for the next turn.
    """

    accel_density: float
    rate_sigma: float

    def transition(self, dt_s: float) -> Matrix:
        """Return F (5, 5)."""
        F = np.zeros((5, 5))
        F[:4, :4] = ConstantVelocity(self.accel_density).transition(dt_s)
        return F

    def noise(self, dt_s: float) -> Matrix:
        """Return Q (5, 5)."""
        Q = np.zeros((5, 5))
        Q[:4, :4] = ConstantVelocity(self.accel_density).noise(dt_s)
        Q[4, 4] = self.rate_sigma**2
        return Q


def _per_axis(block: list[list[float]], dimensions: int) -> Matrix:
    return _kron(np.array(block), np.eye(dimensions))


def _kron(a: Matrix, b: Matrix) -> Matrix:
    size = len(a) * len(b)
    return np.asarray(np.einsum("ij,kl->ikjl", a, b), dtype=np.float64).reshape(size, size)


def _rotation(cos: float, sin: float) -> Matrix:
    return np.array([[cos, -sin], [sin, cos]])


def _arc(rate: float, dt: float) -> tuple[float, float]:
    along, aside = _arcs(np.array(rate), dt)
    return float(along), float(aside)


def _arcs(rate: Vector, dt: float) -> tuple[Vector, Vector]:
    """sin(w dt)/w and (1 - cos(w dt))/w, also at w = 0."""
    turn = rate * dt / math.pi
    return dt * np.sinc(turn), rate * dt**2 / 2 * np.sinc(turn / 2) ** 2


def _arc_slopes(rate: Vector, dt: float) -> tuple[Vector, Vector]:
    """Differentiate `_arcs` by w, by series where the quotients lose their digits."""
    turn = np.asarray(rate * dt)
    small = np.abs(turn) < 1e-2
    safe = np.where(small, 1.0, turn)
    along = (safe * np.cos(safe) - np.sin(safe)) / safe**2
    aside = (safe * np.sin(safe) - 1.0 + np.cos(safe)) / safe**2
    near_along = -turn / 3 + turn**3 / 30
    near_aside = 0.5 - turn**2 / 8 + turn**4 / 144
    return (
        dt**2 * np.where(small, near_along, along),
        dt**2 * np.where(small, near_aside, aside),
    )


def _sine_excess(turn: float) -> float:
    """(turn - sin turn)/turn^3, also at 0."""
    if abs(turn) < 1e-2:
        return 1.0 / 6 - turn**2 / 120 + turn**4 / 5040
    return (turn - math.sin(turn)) / turn**3
