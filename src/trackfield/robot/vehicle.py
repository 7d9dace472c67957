"""How far a robot gets in a step: at once, at a limited speed, as a car; among obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.robot.car import Car, follow_legs, legs_to
from trackfield.robot.obstacle_discs import way_into_disc
from trackfield.robot.obstacles import Obstacles
from trackfield.robot.rule import least_move
from trackfield.types import Matrix, Vector

_PARTS = 32  # of a car's step: it stops at the first one that is in the disc, or before an obstacle


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A robot that turns on the spot, at `max_speed_m_s`; or a `car`, at its own speed.

    `obstacles` have its radius as their margin. A car takes obstacles as it finds them: it stops
    where its arc would run into one.
    """

    max_speed_m_s: float = math.inf
    car: Car | None = None
    obstacles: Obstacles = field(default_factory=Obstacles)

    def __post_init__(self) -> None:
        if not self.max_speed_m_s > 0.0:
            raise InputError(f"max_speed_m_s: found {self.max_speed_m_s}, expected one above 0")

    @property
    def speed_m_s(self) -> float:
        """Speed [m/s] that it has on a straight way."""
        return self.max_speed_m_s if self.car is None else self.car.max_speed_m_s


class Disc(NamedTuple):
    """Where the robot has to be: within `reach_m` of `centre` (2,) [m]."""

    centre: Vector
    reach_m: float


class Moved(NamedTuple):
    """Where the robot is then (2,) [m], its heading [rad], and the way that it went [m].

    `reachable` is false where obstacles leave no way into the disc.
    """

    place: Vector
    heading_rad: float
    way_m: float
    reachable: bool


def move(
    vehicle: Vehicle, place: Vector, heading_rad: float, *, wanted: Vector, disc: Disc, dt_s: float
) -> Moved:
    """Move from a place (2,) for `dt_s` towards `wanted` (2,) in the disc, or into it at all.

    Where `wanted` cannot be had in time or behind obstacles, the nearest place of the disc is
    aimed at; a robot too slow for that gets as near as it can.
    """
    budget = vehicle.speed_m_s * dt_s if math.isfinite(vehicle.speed_m_s) else math.inf
    if vehicle.car is not None:
        return _drive(vehicle, vehicle.car, place, heading_rad, wanted=wanted, disc=disc, dt_s=dt_s)
    obstacles = vehicle.obstacles
    if not (obstacles.free(wanted) and obstacles.clear(place, wanted)):
        way = way_into_disc(obstacles, place, disc.centre, radius_m=disc.reach_m)
        if not way.found:
            return Moved(place, heading_rad, 0.0, reachable=False)
        places = way.places
    elif math.dist(place, wanted) > budget:
        nearest = least_move(place, disc.centre, reach_m=disc.reach_m)
        clear = bool(obstacles.free(nearest) and obstacles.clear(place, nearest))
        places = np.stack([place, nearest if clear else wanted])
    else:
        places = np.stack([place, wanted])
    return _walk(places, heading_rad, budget)


def _walk(places: Matrix, heading: float, budget: float) -> Moved:
    """Walk a broken line (k, 2) as far as `budget` [m] goes."""
    at, way = places[0], 0.0
    for to in places[1:]:
        length = math.dist(at, to)
        if length == 0.0:
            continue
        share = min(1.0, (budget - way) / length)
        heading = math.atan2(to[1] - at[1], to[0] - at[0])
        at, way = at + share * (to - at), way + share * length
        if share < 1.0:
            break
    return Moved(at, heading, way, reachable=True)


def _drive(
    vehicle: Vehicle,
    car: Car,
    place: Vector,
    heading: float,
    *,
    wanted: Vector,
    disc: Disc,
    dt_s: float,
) -> Moved:
    """Drive a car towards the disc's centre by way of `wanted`, until it is in the disc.

    To aim at the near border would mean to shuffle: a car goes where it points.
    """
    pose = np.array([*place, heading])
    if math.dist(place, disc.centre) <= disc.reach_m:
        return Moved(place, heading, 0.0, reachable=True)
    way = way_into_disc(vehicle.obstacles, place, disc.centre, radius_m=disc.reach_m)
    if not way.found:
        return Moved(place, heading, 0.0, reachable=False)
    aim = way.places[1] if len(way.places) > 2 else 0.5 * (wanted + disc.centre)
    legs = legs_to(car, pose, aim)
    whole = follow_legs(car, pose, legs, dt_s=dt_s).way_m
    drives = [
        follow_legs(car, pose, legs, dt_s=dt_s, most_m=whole * k / _PARTS)
        for k in range(_PARTS + 1)
    ]
    poses = np.array([drive.pose for drive in drives])
    clear = vehicle.obstacles.clear(poses[:-1, :2], poses[1:, :2])
    last = _PARTS if clear.all() else int(np.argmin(clear))
    inside = np.linalg.norm(poses[: last + 1, :2] - disc.centre, axis=1) <= disc.reach_m
    stop = int(np.argmax(inside)) if inside.any() else last
    end = drives[stop]
    return Moved(end.pose[:2], float(end.pose[2]), end.way_m, reachable=True)
