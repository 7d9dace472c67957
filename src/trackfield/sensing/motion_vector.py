"""What motion sensors say in n dimensions, for any falloff and for sensors that move.

Cheng, Ghosh, Hu (2), (3), (10), (19), (24)-(38), as corrected. Inside, n = r - s is the target seen
from a sensor, u = rdot - sdot how it moves past it, and Q_k, P_k are |.|^2 and the inner product of
their first k entries.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector


class Sighting(NamedTuple):
    """A target seen from sensors: `offsets` (..., N, n) [m], `velocities` (..., N, n) [m/s]."""

    offsets: Matrix
    velocities: Matrix


class ScalarResidual(NamedTuple):
    """F (..., N) of Cheng (10) and its slopes (19), (..., N, n), in place and velocity."""

    value: Matrix
    place: Matrix
    velocity: Matrix


class RateRows(NamedTuple):
    """Rows of E v = B, Cheng (30)-(34): `E` (..., N, n - 1, n) and `B` (..., N, n - 1)."""

    E: Matrix
    B: Matrix


class OutputSlope(NamedTuple):
    """Slopes (..., rows, n) of readings in place and velocity of the target."""

    place: Matrix
    velocity: Matrix


def sighting(sensors: Matrix, states: Matrix, *, velocities: Matrix | None = None) -> Sighting:
    """See a target in `states` (..., 2 n) from `sensors` (N, n), at rest or with `velocities`.

    `InputError` for shapes that do not fit, n < 2, and numbers that are not finite.
    """
    n = sensors.shape[-1]
    drift = np.zeros(sensors.shape) if velocities is None else velocities
    fits = sensors.ndim == 2 and n >= 2 and states.shape[-1:] == (2 * n,)
    if not fits or drift.shape != sensors.shape:
        raise InputError(
            f"sensors of shape {sensors.shape}, their velocities of shape {drift.shape} and states "
            f"of shape {states.shape}: expected (N, n), (N, n) and (..., 2 n), n >= 2"
        )
    if not all(np.isfinite(part).all() for part in (sensors, states, drift)):
        raise InputError("sensors and states must be finite, found NaN or infinity")
    return Sighting(states[..., None, :n] - sensors, states[..., None, n:] - drift)


def vector_output(seen: Sighting, *, falloff: float = 1.0) -> Matrix:
    """Part of the velocity across the line of sight over r^falloff (..., N, n), Cheng (2).

    Zero at a sensor, where there is no line of sight.
    """
    n, u = seen
    r2, inverse = _squares(n)
    across = u - (np.sum(n * u, axis=-1) * inverse)[..., None] * n
    return np.where(r2 > 0.0, _power(r2, -0.5 * falloff), 0.0)[..., None] * across


def scalar_output(seen: Sighting, *, falloff: float = 1.0) -> Matrix:
    """Size (..., N) of `vector_output`, Cheng (3)."""
    return np.linalg.norm(vector_output(seen, falloff=falloff), axis=-1)


def scalar_residual(seen: Sighting, readings: Matrix, *, falloff: float = 1.0) -> ScalarResidual:
    """F = |n|^2 |u|^2 - <n, u>^2 - b^2 |n|^(2 p + 2) for readings b (..., N), with its slopes.

    Cheng (10), (19) for any falloff p: the last term of the slope in the place is
    (p + 1) b^2 |n|^(2 p) n, corrected. Zero at rest in the velocity, whatever was read: a trap.
    """
    n, u = seen
    r2, u2 = np.sum(n**2, axis=-1), np.sum(u**2, axis=-1)
    along, b2 = np.sum(n * u, axis=-1), np.square(readings)
    far = b2 * _power(r2, falloff)
    value = r2 * u2 - along**2 - far * r2
    place = (u2 - (falloff + 1.0) * far)[..., None] * n - along[..., None] * u
    velocity = r2[..., None] * u - along[..., None] * n
    return ScalarResidual(value, 2.0 * place, 2.0 * velocity)


def polar_angles(offsets: Matrix) -> Matrix:
    """Angles a_1 .. a_(n-1) (..., n - 1) [rad] of offsets (..., n), Cheng (25), (26).

    a_1 is the azimuth, counter-clockwise in -pi to pi; the others are elevations over the space of
    the entries before, -pi/2 to pi/2.
    """
    low = np.sqrt(np.cumsum(offsets**2, axis=-1))[..., :-1]
    low[..., 0] = offsets[..., 0]  # the azimuth goes all round
    return np.arctan2(offsets[..., 1:], low)


def angular_rates(seen: Sighting) -> Matrix:
    """Rates (..., N, n - 1) [rad/s] of the `polar_angles`, Cheng (27)-(29), corrected.

    (u_(k+1) Q_k - n_(k+1) P_k) / (Q_(k+1) sqrt(Q_k)), with P_k of k terms; for k = 1 the sign of
    n_1 goes with the root. Zero where an angle does not exist.
    """
    rows, weight = _rate_rows(seen.offsets)
    turned = np.sum(rows * seen.velocities[..., None, :], axis=-1)
    return _ratio(turned, weight)


def rate_rows(sensors: Matrix, position: Vector, rates: Matrix, velocities: Matrix) -> RateRows:
    """E and B of E v = B for a target at `position` (n,) whose angles turn at `rates` (N, n - 1).

    Cheng (30)-(34), corrected; `velocities` (N, n) are those of the sensors. The velocity that fits
    best is the right side of the observer (33).
    """
    n = position - sensors
    E, weight = _rate_rows(n)
    B = np.sum(E * velocities[:, None, :], axis=-1) + rates * weight
    return RateRows(E, B)


def output_slope(seen: Sighting, kind: str, *, falloff: float = 1.0) -> OutputSlope:
    """Slopes (..., rows, n) of all readings of a `kind`, in place and velocity of the target.

    "motion": `scalar_output`, a row a sensor; "angular_rate": `angular_rates`, n - 1 rows a sensor;
    "bearing": `polar_angles`, likewise; "vector": `vector_output`, n rows a sensor. Zero where a
    reading has no slope.
    """
    makers = {
        "motion": _scalar_slope,
        "vector": _vector_slope,
        "angular_rate": _rate_slope,
        "bearing": _bearing_slope,
    }
    if kind not in makers:
        raise InputError(f"found readings of kind {kind!r}, expected one of {', '.join(makers)}")
    place, velocity = makers[kind](seen, falloff)
    shape = (*place.shape[:-3], place.shape[-3] * place.shape[-2], place.shape[-1])
    return OutputSlope(place.reshape(shape), velocity.reshape(shape))


def _rate_rows(n: Matrix) -> tuple[Matrix, Matrix]:
    """E (..., n - 1, n), and Q_(k+1) sqrt(Q_k) (..., n - 1), of which the rate is a share."""
    size = n.shape[-1]
    Q = np.cumsum(n**2, axis=-1)
    low = np.sqrt(Q[..., :-1])
    weight = Q[..., 1:] * low
    E = np.zeros((*n.shape[:-1], size - 1, size))
    for k in range(1, size):
        E[..., k - 1, :k] = -n[..., k, None] * n[..., :k]
        E[..., k - 1, k] = Q[..., k - 1]
    # the first row over n_1, as in (34): no root, and the azimuth goes all round
    E[..., 0, 0], E[..., 0, 1] = -n[..., 1], n[..., 0]
    weight[..., 0] = Q[..., 1]
    return E, weight


def _scalar_slope(seen: Sighting, falloff: float) -> tuple[Matrix, Matrix]:
    """Slopes (..., N, 1, n): e' times those of the vector output, e its direction."""
    y = vector_output(seen, falloff=falloff)
    size = np.linalg.norm(y, axis=-1)
    least = 1e-12 * np.linalg.norm(seen.velocities, axis=-1) * _least_scale(seen, falloff)
    unit = _ratio(y, np.where(size > least, size, 0.0)[..., None])
    place, velocity = _vector_slope(seen, falloff)
    row = unit[..., None, :]
    return row @ place, row @ velocity


def _vector_slope(seen: Sighting, falloff: float) -> tuple[Matrix, Matrix]:
    """Slopes (..., N, n, n) of (u - c n) / r^p, c = <u, n> / r^2."""
    n, u = np.broadcast_arrays(*seen)
    r2, inverse = _squares(n)
    scale = np.where(r2 > 0.0, _power(r2, -0.5 * falloff), 0.0)[..., None, None]
    eye = np.eye(n.shape[-1])
    c = (np.sum(n * u, axis=-1) * inverse)[..., None, None]
    nn, nu = n[..., :, None] * n[..., None, :], n[..., :, None] * u[..., None, :]
    over = inverse[..., None, None]
    y = vector_output(seen, falloff=falloff)
    place = scale * ((2.0 * c * nn - nu) * over - c * eye)
    place = place - falloff * over * (y[..., :, None] * n[..., None, :])
    return place, scale * (eye - nn * over)


def _rate_slope(seen: Sighting, falloff: float) -> tuple[Matrix, Matrix]:
    """Slopes (..., N, n - 1, n): those of F = E u - a w, Cheng (35)-(38), over w."""
    del falloff  # of sizes only
    n, u = np.broadcast_arrays(*seen)
    size = n.shape[-1]
    E, weight = _rate_rows(n)
    Q, P = np.cumsum(n**2, axis=-1), np.cumsum(n * u, axis=-1)
    a = angular_rates(seen)
    place = np.zeros(E.shape)
    for k in range(1, size):
        root = np.sqrt(Q[..., k - 1])
        low, grown = n[..., :k], _ratio(Q[..., k], root) + 2.0 * root
        place[..., k - 1, :k] = (2.0 * u[..., k, None] * low - n[..., k, None] * u[..., :k]) - (
            a[..., k - 1] * grown
        )[..., None] * low
        place[..., k - 1, k] = -P[..., k - 1] - 2.0 * a[..., k - 1] * root * n[..., k]
    place[..., 0, 0] = u[..., 1] - 2.0 * a[..., 0] * n[..., 0]
    place[..., 0, 1] = -u[..., 0] - 2.0 * a[..., 0] * n[..., 1]
    return _ratio(place, weight[..., None]), _ratio(E, weight[..., None])


def _bearing_slope(seen: Sighting, falloff: float) -> tuple[Matrix, Matrix]:
    """Slopes (..., N, n - 1, n): an angle's rate is linear in the velocity, so E / w are they."""
    del falloff
    n, _ = np.broadcast_arrays(*seen)
    E, weight = _rate_rows(n)
    place = _ratio(E, weight[..., None])
    return place, np.zeros(place.shape)


def _squares(n: Matrix) -> tuple[Matrix, Matrix]:
    """r^2 (..., N) and its inverse, zero at the sensor."""
    r2: Matrix = np.sum(n**2, axis=-1)
    return r2, np.where(r2 > 0.0, 1.0, 0.0) / np.where(r2 > 0.0, r2, 1.0)


def _least_scale(seen: Sighting, falloff: float) -> Matrix:
    r2, _ = _squares(seen.offsets)
    return np.where(r2 > 0.0, _power(r2, -0.5 * falloff), 0.0)


def _power(r2: Matrix, exponent: float) -> Matrix:
    """r2^exponent (...), of zero one: where it is used, another factor is zero."""
    return np.where(r2 > 0.0, r2, 1.0) ** exponent


def _ratio(a: Matrix, b: Matrix) -> Matrix:
    """Divide a by b (...): zero where b is."""
    return np.where(b != 0.0, a, 0.0) / np.where(b != 0.0, b, 1.0)
