"""What a straight pass of a source looks like at each sensor: Berger (14), (19), corrected."""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.amplitude import CORE_M
from trackfield.sensing.profile import Profile, steepness
from trackfield.types import Matrix, Vector


def predict(theta: Vector, sensors: Matrix, *, exponent: float | Vector = 1.0) -> Profile:
    """Profiles (..., k) at `sensors` (k, 2) of passes `theta` (..., 5): P, x0, y0, vx, vy.

    The source is at (x0, y0) + (vx, vy) t; with d the distance of its line from the sensor,
    a_max = sqrt(P) / d^exponent, t_max = -v (x0 - xs) / |v|^2, width = sqrt(c) d / |v|. Units are
    whatever is consistent. A source at rest is closest always: t_max 0, an infinite width. A sensor
    on the line counts as `CORE_M` beside it.
    """
    if theta.shape[-1:] != (5,) or sensors.ndim != 2 or sensors.shape[1] != 2:
        raise InputError(
            f"passes of shape {theta.shape} and sensors of shape {sensors.shape}: "
            "expected (..., 5) and (k, 2)"
        )
    power, x0, v = theta[..., None, 0], theta[..., None, 1:3], theta[..., None, 3:5]
    offset = x0 - sensors
    speed = np.hypot(v[..., 0], v[..., 1])
    moves = speed > 0.0
    per_speed = np.divide(1.0, speed, out=np.zeros_like(speed), where=moves)
    u = v * per_speed[..., None]
    aside = np.abs(u[..., 0] * offset[..., 1] - u[..., 1] * offset[..., 0])
    d = np.maximum(np.where(moves, aside, np.linalg.norm(offset, axis=-1)), CORE_M)
    alpha = np.asarray(exponent, float)
    width = np.sqrt(steepness(alpha)) * d
    return Profile(
        a_max=np.sqrt(power) * d**-alpha,
        t_max_s=-np.sum(u * offset, axis=-1) * per_speed,
        width_s=np.divide(width, speed, out=np.full_like(width, np.inf), where=moves),
    )
