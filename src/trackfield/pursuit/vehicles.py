"""How pursuers move: one interface for those with thrust, with a top speed, and with wheels.

All meet evaders that go on straight. A pursuer with thrust is there when it is at the evader's
place with the evader's velocity; the others when they are at its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.pursuit.robust import Doubt, robust_thrust
from trackfield.pursuit.steering import held_thrust
from trackfield.types import Matrix, Vector


class Aims(NamedTuple):
    """What each pursuer goes for: `state` (n, 4) x, y, vx, vy [m], [m/s]; NaN: it holds.

    `doubt` (n, 4) bounds how wrong the state is, `thrust_m_s2` (n,) what the evader does.
    """

    state: Matrix
    doubt: Matrix
    thrust_m_s2: Vector


class Vehicle(Protocol):
    """What a pursuer is; states are rows (n, `width`) that begin with x and y [m]."""

    width: ClassVar[int]

    def times(self, states: Matrix, evaders: Matrix) -> Matrix:
        """Tell the times to capture (p, e) [s] of evaders (e, 4) that go on; inf: never."""
        ...

    def commands(self, states: Matrix, aims: Aims, *, step_s: float) -> Matrix:
        """Say what to do (n, 2) for the next step; its meaning is the vehicle's."""
        ...

    def moved(self, states: Matrix, commands: Matrix, *, step_s: float) -> Matrix:
        """States after a step of these commands, exactly."""
        ...


def certain(state: Matrix) -> Aims:
    """Aim at states (n, 4) that are known exactly."""
    return Aims(state, np.zeros(state.shape), np.zeros(len(state)))


@dataclass(frozen=True, slots=True)
class Thruster:
    """A double integrator with thrust U and top speed, both of an axis: Oh (6), (16)-(23).

    Its state is x, y, vx, vy and its command the thrust [m/s^2] of a step. `ConfigurationError` for
    limits that are not above 0.
    """

    width: ClassVar[int] = 4
    thrust_m_s2: float = 1.0
    speed_m_s: float = math.inf

    def __post_init__(self) -> None:
        """Refuse what cannot move."""
        _above_zero(self, "thrust_m_s2", finite=True)
        _above_zero(self, "speed_m_s", finite=False)

    def times(self, states: Matrix, evaders: Matrix) -> Matrix:
        """Time of the slowest axis, Oh (18), (19), corrected; with a stretch at top speed.

        Of thrust a = +-U first, then back: the speed against the evader peaks at
        r^2 = xidot^2 / 2 + U |xi|, measured along a. Where the pursuer may only be faster than the
        evader by c < r, it goes on at c until (2 c^2 - xidot^2) / 2 U remain; never if c <= 0.
        """
        own, other = states.T[:, :, None], evaders.T[:, None]  # axes first: long inner loops
        x, v = own[:2] - other[:2], own[2:] - other[2:]
        U = self.thrust_m_s2
        way = np.where(2.0 * U * x + v * np.abs(v) >= 0.0, -1.0, 1.0)  # of the first thrust
        x, v = -way * x, way * v  # what is left to go, and how fast it goes
        peak = np.sqrt(np.maximum(0.5 * v**2 + U * x, 0.0))
        time = (2.0 * peak - v) / U
        if math.isfinite(self.speed_m_s):
            cap = self.speed_m_s - way * other[2:]
            slow = cap < peak  # few of them: the rest needs no more
            c, x, v = cap[slow], x[slow], v[slow]
            safe = np.where(c > 0.0, c, 1.0)
            coasting = (2.0 * safe - v) / U + (x - (safe**2 - 0.5 * v**2) / U) / safe
            time[slow] = np.where(c > 0.0, coasting, np.inf)
            time[:, :, (np.abs(evaders[:, 2:]) > self.speed_m_s).any(axis=1)] = np.inf
        return np.maximum(time, 0.0).max(axis=0)

    def commands(self, states: Matrix, aims: Aims, *, step_s: float) -> Matrix:
        """Thrust of the least worst time, Oh (23); of least time where nothing is in doubt.

        Whoever has no aim brakes.
        """
        U = self.thrust_m_s2
        thrust = np.clip(-states[:, 2:] / step_s, -U, U)
        aimed = np.isfinite(aims.state).all(axis=1)
        doubtful = aimed & ((aims.doubt > 0.0).any(axis=1) | (aims.thrust_m_s2 > 0.0))
        for some, robust in ((aimed & ~doubtful, False), (doubtful, True)):
            if some.any():
                offset = states[some] - aims.state[some]
                x, v = offset[:, :2], offset[:, 2:]
                doubt = aims.doubt[some]
                bounds = Doubt(doubt[:, :2], doubt[:, 2:], aims.thrust_m_s2[some][:, None])
                thrust[some] = (
                    robust_thrust(x, v, limit_m_s2=U, doubt=bounds, step_s=step_s).thrust_m_s2
                    if robust
                    else held_thrust(x, v, limit_m_s2=U, step_s=step_s).thrust_m_s2
                )
        return self._allowed(states, thrust, step_s)

    def moved(self, states: Matrix, commands: Matrix, *, step_s: float) -> Matrix:
        """Move by thrusts, as far as they are within the limits: Oh (6)."""
        thrust = self._allowed(states, commands, step_s)
        place = states[:, :2] + step_s * states[:, 2:] + 0.5 * step_s**2 * thrust
        return np.hstack([place, states[:, 2:] + step_s * thrust])

    def _allowed(self, states: Matrix, thrust: Matrix, step_s: float) -> Matrix:
        U, top = self.thrust_m_s2, self.speed_m_s
        low = np.maximum(-U, np.minimum((-top - states[:, 2:]) / step_s, U))
        high = np.minimum(U, np.maximum((top - states[:, 2:]) / step_s, -U))
        return np.clip(thrust, low, high)


@dataclass(frozen=True, slots=True)
class Runner:
    """A point that turns at once and goes at most `speed_m_s`.

    Its state is x, y and its command the velocity [m/s] of a step.
    """

    width: ClassVar[int] = 2
    speed_m_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what cannot move."""
        _above_zero(self, "speed_m_s", finite=True)

    def times(self, states: Matrix, evaders: Matrix) -> Matrix:
        """Least t >= 0 with |d + w t| = V t: of (w'w - V^2) t^2 + 2 d'w t + d'd = 0."""
        d = evaders[:, :2] - states[:, None, :2]
        w = np.broadcast_to(evaders[:, 2:], d.shape)
        a = np.square(w).sum(axis=-1) - self.speed_m_s**2
        b, c = (d * w).sum(axis=-1), np.square(d).sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            # The root that is least above 0, written so that it holds for a = 0 too.
            time = c / (np.sqrt(b**2 - a * c) - b)
        time = np.where((time >= 0.0) & np.isfinite(time), time, np.inf)
        return np.where(c == 0.0, 0.0, time)

    def commands(self, states: Matrix, aims: Aims, *, step_s: float) -> Matrix:
        """Go straight to where it meets its aim; wait there; stay if that is nowhere."""
        velocity = np.zeros((len(states), 2))
        for i in np.flatnonzero(np.isfinite(aims.state).all(axis=1)):
            aim = aims.state[i]
            time = float(self.times(states[i : i + 1], aim[None])[0, 0])
            if math.isfinite(time):
                ahead = max(time, step_s)
                velocity[i] = (aim[:2] + ahead * aim[2:] - states[i]) / ahead
        return self._allowed(velocity)

    def moved(self, states: Matrix, commands: Matrix, *, step_s: float) -> Matrix:
        """Move by velocities, as far as they are within the limit."""
        return states + step_s * self._allowed(commands)

    def _allowed(self, velocity: Matrix) -> Matrix:
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        return velocity * np.minimum(1.0, self.speed_m_s / np.where(speed > 0.0, speed, 1.0))


def _above_zero(vehicle: Thruster | Runner, name: str, *, finite: bool) -> None:
    value: float = getattr(vehicle, name)
    if not (value > 0.0 and (math.isfinite(value) or not finite)):
        kind = "a finite number" if finite else "a number"
        raise ConfigurationError([f"{name}: found {value:g}, expected {kind} above 0"])
