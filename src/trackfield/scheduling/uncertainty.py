"""How well two or three ranges tell a place, in closed form: Pham 2.4, 3.3, 4.4.1, corrected.

Sensors are far away and have equal errors N(0, sigma^2); what counts is the angles at which the
target sees them. All of it is the bound (sum u u')^-1 sigma^2 of `localization.information`, which
takes any number of sensors of any kind; these are the forms by which a person can choose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

Angles = float | Vector
_LEAST_SINE = 1e-9  # of an angle that is taken for none


class ThirdSensor(NamedTuple):
    """Where a third sensor stands best beside two, and what they reach together.

    `beta` [rad] is the angle from the first, modulo pi; `trace` is over sigma^2. At a right angle
    of the two every third one is as good.
    """

    beta: Vector
    trace: Vector


def two_sensor_covariance(bearing: Angles, angle: Angles, *, sigma_m: float = 1.0) -> Matrix:
    """Covariance (..., 2, 2) [m^2] of a place from two ranges, Pham Theorem 3.1, (3.8), corrected.

    s^2 / sin^2 a [[sin^2 f + sin^2(f + a), -(sin 2f + sin 2(f + a))/2], [., cos^2 f +
    cos^2(f + a)]]: the target sees the first sensor in `bearing` f, the second in f + `angle` a
    [rad]. Trace 2 s^2 / sin^2 a and determinant are free of f, the matrix is not, unlike in (3.8).
    `InputError` where the two are on a line with the target, for then a direction is free.
    """
    f, g = np.broadcast_arrays(np.asarray(bearing, float), np.add(bearing, angle))
    xy = -0.5 * (np.sin(2.0 * f) + np.sin(2.0 * g))
    rows = [[np.sin(f) ** 2 + np.sin(g) ** 2, xy], [xy, np.cos(f) ** 2 + np.cos(g) ** 2]]
    square = _sine(angle, "angle") ** 2
    theta = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    return sigma_m**2 * theta / square[..., None, None]


def three_sensor_trace(alpha: Angles, beta: Angles) -> Vector:
    """Trace 3 / (sin^2 a + sin^2 b + sin^2(a - b)) (...) over sigma^2, Theorem 3.2, corrected.

    The second sensor stands at `alpha` from the first, the third at `beta` [rad]. Printed (3.10) is
    `printed_trace`. `InputError` where all three are on a line with the target.
    """
    a, b = np.asarray(alpha, float), np.asarray(beta, float)
    spread = np.sin(a) ** 2 + np.sin(b) ** 2 + np.sin(a - b) ** 2
    if (spread < _LEAST_SINE).any():
        raise InputError("found three sensors on a line with the target, expected one beside it")
    return 3.0 / spread


def printed_trace(alpha: Angles, beta: Angles) -> Vector:
    """Trace [4 - cos^2 b - cos^2(a - b)] / sin^2 a (...) as printed in Pham (3.10), wrong.

    It is above the trace 2 / sin^2 a of the two first sensors alone, whatever the third one; kept
    to show what follows from it.
    """
    a, b = np.asarray(alpha, float), np.asarray(beta, float)
    return (4.0 - np.cos(b) ** 2 - np.cos(a - b) ** 2) / _sine(alpha, "alpha") ** 2


def best_third(alpha: Angles) -> ThirdSensor:
    """Third sensor of least trace beside two at `alpha` [rad], Pham (3.11), corrected.

    b = a/2 + 90 deg if cos a > 0, else a/2; the trace is 3 / (sin^2 a + 1 + |cos a|). As printed
    the two cases are swapped: see `printed_third`.
    """
    a = np.asarray(alpha, float)
    beta = 0.5 * a + np.where(np.cos(a) > 0.0, 0.5 * np.pi, 0.0)
    return ThirdSensor(beta, 3.0 / (np.sin(a) ** 2 + 1.0 + np.abs(np.cos(a))))


def printed_third(alpha: Angles) -> ThirdSensor:
    """Third sensor as Pham (3.11) prints it: the worst there is, with the trace that it really has.

    Trace 3 / (sin^2 a + 1 - |cos a|). `InputError` where the two are on a line with the target.
    """
    a = np.asarray(alpha, float)
    _sine(alpha, "alpha")
    beta = 0.5 * a + np.where(np.cos(a) > 0.0, 0.0, 0.5 * np.pi)
    return ThirdSensor(beta, 3.0 / (np.sin(a) ** 2 + 1.0 - np.abs(np.cos(a))))


def three_sensor_trace_3d(alpha: Angles, beta: Angles, *, gamma: Angles) -> Vector:
    """Trace (...) over sigma^2 of a place in space from three ranges, Theorem 3.4, corrected.

    [sin^2 a + 2 - cos^2 g (cos^2 b + cos^2(a - b))] / (sin^2 a sin^2 g): the second sensor stands
    at `alpha` from the first, the third at `gamma` above their plane, in the direction `beta` from
    the first along it [rad]. It depends on `beta` unless `gamma` is a right angle; there it is
    1 + 2 / sin^2 a. `InputError` where all are in a plane with the target.
    """
    a, b, g = (np.asarray(angle, float) for angle in (alpha, beta, gamma))
    lost = np.cos(g) ** 2 * (np.cos(b) ** 2 + np.cos(a - b) ** 2)
    square = (_sine(alpha, "alpha") * _sine(gamma, "gamma")) ** 2
    return (np.sin(a) ** 2 + 2.0 - lost) / square


def half_chord(reach_m: float | Vector, apart_m: float | Vector) -> Vector:
    """Half the length sqrt(R^2 - (d/2)^2) (...) [m] of what two sensors both reach, (2.24).

    A target that two sensors of reach R a distance d apart see is at most this far from the line
    between them. `InputError` where they reach nothing together.
    """
    reach, apart = np.asarray(reach_m, float), np.asarray(apart_m, float)
    if not ((apart >= 0.0) & (apart <= 2.0 * reach)).all():
        raise InputError(
            "found sensors that reach no place together, expected 0 <= apart_m <= 2 reach_m"
        )
    return np.sqrt(reach**2 - (0.5 * apart) ** 2)


def long_diagonal(
    error_m: float | Vector, angle: Angles, *, reach_m: float | Vector = math.inf
) -> Vector:
    """Longest extent 2 u / min(sin(a/2), cos(a/2)) (...) [m] of where the target is, (2.25)-(2.26).

    Two rings of half width `error_m` u cross at `angle` a [rad], 0 to pi: far away a rhombus, and
    this is its longer diagonal. Never more than R + u, what one sensor of `reach_m` R alone tells.
    """
    half, u = 0.5 * np.asarray(angle, float), np.asarray(error_m, float)
    narrow = np.minimum(np.sin(half), np.cos(half))
    alone = np.asarray(reach_m) + u
    if not ((narrow > _LEAST_SINE) | np.isfinite(alone)).all() or (narrow < -_LEAST_SINE).any():
        raise InputError("found rings that touch and do not cross, expected an angle in 0 to pi")
    return np.minimum(2.0 * u / np.maximum(narrow, _LEAST_SINE), alone)


def two_cells(
    first_m: float | Vector,
    second_m: float | Vector,
    *,
    apart_m: float | Vector,
    error_m: float | Vector,
) -> NDArray[np.bool_]:
    """Tell (...) whether two rings cross in two cells apart from each other, Pham (4.12).

    d_1 + d_2 >= d + 2 u and d_1 + d >= d_2 + 2 u with d_1 <= d_2: rings of radius `first_m` and
    `second_m` [m] and half width `error_m` u about sensors `apart_m` d from each other. Else the
    rings touch, and the cell is long: the target is near the line of the two sensors.
    """
    near, far = np.minimum(first_m, second_m), np.maximum(first_m, second_m)
    slack = 1e-12 * (near + far + apart_m)  # of decimal numbers that should be equal
    outer = near + far + slack >= np.add(apart_m, np.multiply(2.0, error_m))
    inner = near + apart_m + slack >= far + np.multiply(2.0, error_m)
    return np.asarray(outer & inner)


def _sine(angle: Angles, name: str) -> Vector:
    sine = np.sin(np.asarray(angle, float))
    if not (np.abs(sine) > _LEAST_SINE).all():
        raise InputError(f"{name}: found an angle of 0 or a straight one, expected one between")
    return sine
