"""Scenes of motion sensors that tests share: the rectangle of Cheng's Example 5.1, random ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.localization.motion_readings import MotionReadings, readings
from trackfield.network.kinds import SensorModel
from trackfield.sensing import angular_rate, bearing, motion_rate
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.types import Matrix, Vector

RECTANGLE = np.array([[0.3, 0.15], [-0.3, 0.15], [-0.3, -0.15], [0.3, -0.15]])
MODELS: dict[str, SensorModel] = {
    "motion": MotionRateModel(sigma=0.02),
    "angular_rate": AngularRateModel(sigma_rad_s=0.02),
    "bearing": BearingModel(sigma_rad=0.02),
}


class Pass(NamedTuple):
    """Readings of a straight pass, the times of its scans, and the true state at time 0."""

    given: MotionReadings
    t_s: Vector
    state: Vector

    def positions(self) -> Matrix:
        d = self.state.size // 2
        return self.state[:d] + self.t_s[:, None] * self.state[d:]


def straight(
    sensors: Matrix,
    state: Vector,
    t_s: Vector,
    *,
    model: SensorModel,
    rng: np.random.Generator | None = None,
) -> Pass:
    """Read a target that is in `state` at time 0; without `rng` there is no noise."""
    d = sensors.shape[1]
    states = np.hstack([state[:d] + t_s[:, None] * state[d:], np.tile(state[d:], (len(t_s), 1))])
    if isinstance(model, MotionRateModel):
        z = motion_rate.strength(model, sensors, states=states)
        sigma = model.sigma
    elif isinstance(model, AngularRateModel):
        z = angular_rate.expected(model, sensors, states=states)
        sigma = model.sigma_rad_s
    else:
        assert isinstance(model, BearingModel)
        z = bearing.expected(model, sensors, positions=states[:, :d])
        sigma = model.sigma_rad
    if rng is not None:
        z = z + sigma * rng.standard_normal(z.shape)
        z = np.abs(z) if isinstance(model, MotionRateModel) else z
    everywhere = np.tile(sensors, (len(t_s), 1))
    given = readings(model, everywhere, z.ravel(), t_s=np.repeat(t_s, len(sensors)))
    return Pass(given, t_s, state)


def joined(*parts: MotionReadings) -> MotionReadings:
    """Put readings together, in order of time."""
    whole = MotionReadings(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    places = np.unique(whole.sensors, axis=0, return_inverse=True)[1]
    whole = whole._replace(source=places.reshape(-1).astype(np.int32))
    return whole.rows(np.argsort(whole.t_s, kind="stable"))
