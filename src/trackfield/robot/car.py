"""A car-like robot: exact arcs, and manoeuvres to a wanted point within its speed and steering.

    x' = v cos(phi) cos(w),  y' = v cos(phi) sin(w),  w' = (v / L) sin(phi)

with |v| <= V of the front wheels, |phi| <= phi_max and the wheel base L: Pham (4.7)-(4.10),
corrected. A pose is [x, y, w], in metres and radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trackfield.errors import InputError
from trackfield.types import Vector

_TURN = 2.0 * math.pi
_NOTHING = 1e-9  # of a turn: rounding, not a whole turn


@dataclass(frozen=True, slots=True)
class Car:
    """Limits of a car: speed V [m/s] of the front wheels, steering angle [rad], wheel base [m].

    `InputError` for a speed or wheel base that is not above 0, and for a steering angle that is
    not between 0 and a right angle.
    """

    max_speed_m_s: float
    max_steering_rad: float = 0.6
    wheel_base_m: float = 0.3

    def __post_init__(self) -> None:
        for name in ("max_speed_m_s", "wheel_base_m"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise InputError(f"{name}: found {value}, expected a number above 0")
        if not 0.0 < self.max_steering_rad < math.pi / 2.0:
            raise InputError(
                f"max_steering_rad: found {self.max_steering_rad}, expected an angle between 0 "
                "and a right angle, 1.57"
            )

    @property
    def turning_radius_m(self) -> float:
        """Radius [m] of the centre's narrowest circle, L / tan(phi_max)."""
        return self.wheel_base_m / math.tan(self.max_steering_rad)


class Leg(NamedTuple):
    """A part of a manoeuvre: the steering angle [rad], and the way [m], below 0 in reverse."""

    steering_rad: float
    way_m: float


class Drive(NamedTuple):
    """What a car did in a step: its pose then (3,), the way of its centre [m], and its controls.

    A row of `controls` (k, 3) is a speed [m/s], a steering angle [rad] and how long [s].
    """

    pose: Vector
    way_m: float
    controls: Vector


def moved(
    pose: ArrayLike, car: Car, *, speed_m_s: float, steering_rad: float, t_s: float
) -> Vector:
    """Pose (3,) after `t_s` of constant speed and steering, exactly: an arc; Pham (4.7), corrected.

    The heading goes on counting: it is not taken modulo a turn.
    """
    way = speed_m_s * math.cos(steering_rad) * t_s
    return _along(np.asarray(pose, np.float64), way, math.tan(steering_rad) / car.wheel_base_m)


def legs_to(car: Car, pose: ArrayLike, goal: ArrayLike) -> tuple[Leg, ...]:
    """Find the shortest manoeuvre to `goal` (2,) [m] that turns and goes straight, or turns twice.

    All turns are the narrowest. Both go forward or in reverse, the second kind each turn for
    itself, so that any point is reached from any pose; the heading there is free.
    """
    x, y, heading = np.asarray(pose, np.float64)
    east, north = np.asarray(goal, np.float64) - (x, y)
    cos, sin = math.cos(heading), math.sin(heading)
    ahead, aside = cos * east + sin * north, cos * north - sin * east
    R, phi = car.turning_radius_m, car.max_steering_rad
    found: list[tuple[Leg, ...]] = []
    for way, side in product((1.0, -1.0), repeat=2):  # mirror images: to the left, and forward
        turn, straight = _turn_and_straight(way * ahead / R, side * aside / R)
        if straight >= 0.0:
            found.append((Leg(side * phi, way * R * turn), Leg(0.0, way * R * straight)))
    for side in (1.0, -1.0):
        for first, second in _two_turns(ahead / R, side * aside / R):
            found.append((Leg(-side * phi, R * first), Leg(side * phi, R * second)))
    shortest = min(found, key=lambda legs: sum(abs(leg.way_m) for leg in legs))
    return tuple(leg for leg in shortest if leg.way_m != 0.0)


def steer(car: Car, pose: ArrayLike, goal: ArrayLike, *, dt_s: float) -> Drive:
    """Drive for `dt_s` along `legs_to` the goal at full speed; stop there if there is time left."""
    return follow_legs(car, pose, legs_to(car, pose, goal), dt_s=dt_s)


def follow_legs(
    car: Car, pose: ArrayLike, legs: tuple[Leg, ...], *, dt_s: float, most_m: float = math.inf
) -> Drive:
    """Drive along `legs` at full speed for `dt_s` and `most_m` at most."""
    now, left, way = np.asarray(pose, np.float64), dt_s, 0.0
    controls: list[tuple[float, float, float]] = []
    for leg in legs:
        pace = car.max_speed_m_s * math.cos(leg.steering_rad)
        part = min(abs(leg.way_m), pace * left, most_m - way)
        if part <= 0.0:
            break
        direction = math.copysign(1.0, leg.way_m)
        now = _along(now, direction * part, math.tan(leg.steering_rad) / car.wheel_base_m)
        controls.append((direction * car.max_speed_m_s, leg.steering_rad, part / pace))
        left, way = left - part / pace, way + part
    return Drive(now, way, np.array(controls).reshape(-1, 3))


def _along(pose: Vector, way: float, curvature: float) -> Vector:
    """Pose after a signed way [m] on a circle of this curvature [1/m]: the chord, turned half."""
    x, y, heading = pose
    half = way * curvature / 2.0
    chord = way * float(np.sinc(half / math.pi))
    return np.array(
        [
            x + chord * math.cos(heading + half),
            y + chord * math.sin(heading + half),
            heading + 2.0 * half,
        ]
    )


def _turn_and_straight(ahead: float, aside: float) -> tuple[float, float]:
    """Left turn [rad] and straight way to a point, forward, in turning radii; -1 inside the circle.

    The circle is centred at (0, 1); the tangent at turn a leads from (sin a, 1 - cos a) along
    (cos a, sin a).
    """
    square = ahead**2 + (aside - 1.0) ** 2 - 1.0
    if square < 0.0:
        return 0.0, -1.0
    straight = math.sqrt(square)
    turn = math.atan2(aside - 1.0, ahead) + math.pi / 2.0 - math.atan2(straight, 1.0)
    return _whole(turn), straight


def _two_turns(ahead: float, aside: float) -> list[tuple[float, float]]:
    """Find turns right, then left [rad], below 0 in reverse, to a point, in turning radii.

    The second circle touches the first, about (0, -1): its centre is 2 from there and 1 from the
    point.
    """
    rise = aside + 1.0
    away = math.hypot(ahead, rise)
    if not 1.0 <= away <= 3.0:
        return []
    bearing = math.atan2(rise, ahead)
    half = math.acos(min(1.0, max(-1.0, (away**2 + 3.0) / (4.0 * away))))
    found: list[tuple[float, float]] = []
    for angle in (bearing - half, bearing + half):
        x, y = 2.0 * math.cos(angle), 2.0 * math.sin(angle) - 1.0
        first = _whole(math.pi / 2.0 - angle)
        second = _whole(math.atan2(aside - y, ahead - x) - angle - math.pi)
        found += product((first, -_whole(-first)), (second, -_whole(-second)))
    return found


def _whole(turn: float) -> float:
    """Angle [rad] within a turn, from 0; rounding below 0 is 0."""
    turn %= _TURN
    return 0.0 if turn > _TURN * (1.0 - _NOTHING) else turn
