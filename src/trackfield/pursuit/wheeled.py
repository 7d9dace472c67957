"""Pursuers with wheels: the car of `robot.car` as a vehicle of pursuit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackfield.pursuit.vehicles import Aims, Runner
from trackfield.robot.car import Car, legs_to, steer
from trackfield.types import Matrix, Vector

_ROUNDS = 60
_SOON = 1e-6  # of a time: it is there


@dataclass(frozen=True, slots=True)
class Wheels:
    """A car; its state is x, y, heading [m], [rad] and its command the place (2,) [m] to go for.

    It meets an evader on the way of `legs_to`: at the narrowest turns, forward or in reverse.
    """

    width: ClassVar[int] = 3
    car: Car

    def times(self, states: Matrix, evaders: Matrix) -> Matrix:
        """Tell times (p, e) [s] by which cars can be where evaders are then; inf: never found.

        From the time of a point that turns at once, on to that of the way to where the evader is
        then, until the car is there by then: t = max(t, T(p + t v)).
        """
        straight = Runner(self.car.max_speed_m_s).times(states[:, :2], evaders)
        times = np.full(straight.shape, np.inf)
        for i, j in np.argwhere(np.isfinite(straight)):
            times[i, j] = self._time(states[i], evaders[j], float(straight[i, j]))
        return times

    def commands(self, states: Matrix, aims: Aims, *, step_s: float) -> Matrix:
        """Where it meets its aim, at the end of the step at the earliest; its own place to hold."""
        goals = states[:, :2].copy()
        for i in np.flatnonzero(np.isfinite(aims.state).all(axis=1)):
            time = float(self.times(states[i : i + 1], aims.state[i : i + 1])[0, 0])
            if math.isfinite(time):
                goals[i] = aims.state[i, :2] + max(time, step_s) * aims.state[i, 2:]
        return goals

    def moved(self, states: Matrix, commands: Matrix, *, step_s: float) -> Matrix:
        """Drive along the shortest manoeuvre to each place, or stop there."""
        driven = [
            steer(self.car, state, goal, dt_s=step_s).pose
            for state, goal in zip(states, commands, strict=True)
        ]
        return np.array(driven).reshape(states.shape)

    def _time(self, pose: Vector, evader: Vector, time: float) -> float:
        for _ in range(_ROUNDS):
            needed = self._drive_time(pose, evader[:2] + time * evader[2:])
            if needed <= time * (1.0 + _SOON):
                return time
            time = needed
        return math.inf

    def _drive_time(self, pose: Vector, goal: Vector) -> float:
        speed = self.car.max_speed_m_s
        return sum(
            abs(leg.way_m) / (speed * math.cos(leg.steering_rad))
            for leg in legs_to(self.car, pose, goal)
        )
