"""Wang 4.2 simulated: a robot on two circles between four sensors that are 2 m apart."""

from __future__ import annotations

import math

import numpy as np

from trackfield.experiments.wang_contest import Race
from trackfield.motion import SteppedAcceleration
from trackfield.sensing.range import RangeModel
from trackfield.simulation import roads
from trackfield.simulation.roads import Drive
from trackfield.types import Gaussian

DT_S = 0.2
RATE_RAD_S = 0.122
RADIUS_M = 0.35
SENSORS = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])
MODEL = RangeModel(
    bias_m=-0.0386, scale=0.0174, sigma_m=math.sqrt(7.97e-5), sigma_scale=math.sqrt(2.916e-4)
)
START = (1.0, 1.0, 0.0428, 0.0)  # [x, y, vx, vy], as the paper's filters were told
PAPER_ACCEL = 0.0027  # [m^2/s^4]
BETTER_ACCEL = 0.0003  # the robot's centripetal acceleration is 0.0052 m/s^2


def drive() -> Drive:
    """Lead the robot clockwise round (1, 0.65), then the other way round (1, 1.35)."""
    t_s = roads.times(int(4 * math.pi / (RATE_RAD_S * DT_S)), DT_S)
    turned = RATE_RAD_S * t_s
    second = turned > 2 * math.pi
    side = np.where(second, 1.0, -1.0)  # the circle's centre is to the left, or right
    angle = side * turned
    x = 1.0 + RADIUS_M * side * np.sin(angle)
    y = 1.0 + RADIUS_M * side * (1.0 - np.cos(angle))
    speed = RATE_RAD_S * RADIUS_M
    return Drive(
        t_s=t_s,
        start=np.array([1.0, 1.0, speed, 0.0]),
        truth=np.column_stack([x, y, speed * np.cos(angle), speed * np.sin(angle)]),
        sensors=SENSORS,
        accel_variance=np.zeros((t_s.size, 2)),
    )


def race(rng: np.random.Generator, *, runs: int, accel: float) -> Race:
    """Prepare readings of the two circles, and a start and motion as in the paper."""
    driven = drive()
    return Race(
        drive=driven,
        ranges=roads.ranges(rng, driven, runs=runs, model=MODEL),
        start=Gaussian(np.tile(START, (runs, 1)), 0.01 * np.eye(4)),
        motion=SteppedAcceleration((accel, accel)),
        model=MODEL,
        dt_s=DT_S,
    )
