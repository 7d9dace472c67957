"""Pursuers that never come too near each other or an obstacle, whatever their actuators do.

Each pursuer has a nominal state that it follows exactly but for a tube. Thrust that is wrong by w,
|w| <= W an axis, is put right within two steps by the deadbeat feedback -e/step^2 - 1.5 edot/step,
which takes at most 3 W of the thrust and keeps the pursuer within step^2 W of the nominal one an
axis, at all times between the steps too. Nominal pursuers keep a way to brake in reserve: a thrust
is taken only if braking after it stays clear of the ways to which all others are committed. Whoever
finds no such thrust brakes, on the way that was kept clear for him; so what is clear once stays so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError, InputError
from trackfield.types import Matrix, Vector

Clearance = Callable[[Matrix], Vector]
"""Distances (m,) [m] of points (m, 2) to the nearest obstacle."""

_PARTS = 2  # of a step, between whose ends a way is taken for straight
_GRID = 5  # thrusts an axis that are tried beside the wanted one


@dataclass(frozen=True, slots=True)
class Body:
    """What pursuers are: thrust U, its error W, top speed, all of an axis; how near they may come.

    `apart_m` is kept between pursuers, `clear_m` from obstacles (to the centres).
    """

    thrust_m_s2: float = 1.0
    error_m_s2: float = 0.0
    speed_m_s: float = 3.0
    apart_m: float = 1.0
    clear_m: float = 0.5

    def __post_init__(self) -> None:
        """Refuse what cannot move, or cannot correct its own errors."""
        problems = [
            f"body.{name}: found {value:g}, expected a finite number "
            + ("of 0 or more" if may else "above 0")
            for name, value, may in (
                ("thrust_m_s2", self.thrust_m_s2, False),
                ("error_m_s2", self.error_m_s2, True),
                ("speed_m_s", self.speed_m_s, False),
                ("apart_m", self.apart_m, True),
                ("clear_m", self.clear_m, True),
            )
            if not (np.isfinite(value) and (value >= 0.0 if may else value > 0.0))
        ]
        if not problems and self.reserve_m_s2 <= 0.0:
            problems.append(
                f"body.error_m_s2: found {self.error_m_s2:g}, expected less than a third of the "
                f"thrust {self.thrust_m_s2:g}: three times the error is kept to correct it"
            )
        if problems:
            raise ConfigurationError(problems)

    @property
    def reserve_m_s2(self) -> float:
        """Thrust an axis for the nominal motion, U - 3 W."""
        return self.thrust_m_s2 - 3.0 * self.error_m_s2


class Fleet(NamedTuple):
    """Nominal positions [m] and velocities [m/s] of pursuers, (n, 2) each."""

    position: Matrix
    velocity: Matrix


class Moved(NamedTuple):
    """Thrusts (n, 2) for the step, the nominal fleet after it, and who had to brake, (n,)."""

    thrust_m_s2: Matrix
    fleet: Fleet
    braked: NDArray[np.bool_]


def check_start(fleet: Fleet, body: Body, *, step_s: float, clearance: Clearance | None) -> None:
    """Raise `InputError` if pursuers at the start cannot all brake clear of all else."""
    if (np.abs(fleet.velocity) > body.speed_m_s * (1.0 + 1e-9)).any():
        fast = float(np.abs(fleet.velocity).max())
        raise InputError(f"pursuers: found {fast:g} m/s, expected at most {body.speed_m_s:g} m/s")
    ways = _way(fleet, _brake(fleet.velocity, body, step_s), body, step_s)
    for i in range(len(ways)):
        if not _clear(ways[i : i + 1], ways[:i], body, step_s=step_s, clearance=clearance)[0]:
            raise InputError(
                f"pursuer {i} at {fleet.position[i].tolist()}: found it too near to another one or "
                "to an obstacle, or too fast to brake before, expected a start that is clear"
            )


def move(
    fleet: Fleet,
    wanted: Matrix,
    body: Body,
    *,
    step_s: float,
    actual: Fleet | None = None,
    clearance: Clearance | None = None,
) -> Moved:
    """Choose thrusts nearest to `wanted` (n, 2) that keep everybody clear; `actual` is measured.

    Pursuers choose one after the other, those first whose wanted thrust is largest, against the
    ways of all others: new ones of those who chose, braking ones of the rest.
    """
    if wanted.shape != fleet.position.shape or not np.isfinite(wanted).all():
        raise InputError(f"wanted thrusts: expected finite ones of shape {fleet.position.shape}")
    brakes = _brake(fleet.velocity, body, step_s)
    nominal, braked = brakes.copy(), np.zeros(len(brakes), np.bool_)
    ways = _way(fleet, brakes, body, step_s)
    for i in np.argsort(-np.abs(wanted).max(axis=1), kind="stable"):
        tried = _candidates(fleet.velocity[i], wanted[i], body, step_s)
        one = Fleet(
            np.broadcast_to(fleet.position[i], tried.shape),
            np.broadcast_to(fleet.velocity[i], tried.shape),
        )
        new = _way(one, tried, body, step_s)
        others = np.delete(ways, i, axis=0)
        good = _clear(new, others, body, step_s=step_s, clearance=clearance)
        braked[i] = not good.any()
        if good.any():
            nominal[i], ways[i] = tried[good.argmax()], new[good.argmax()]
    thrust = nominal if actual is None else nominal + _correction(fleet, actual, step_s)
    after = Fleet(
        fleet.position + step_s * fleet.velocity + 0.5 * step_s**2 * nominal,
        fleet.velocity + step_s * nominal,
    )
    limit = body.thrust_m_s2
    return Moved(np.clip(thrust, -limit, limit), after, braked)


def _correction(fleet: Fleet, actual: Fleet, step_s: float) -> Matrix:
    """Thrust that takes pursuers back to their nominal states within two steps."""
    wrong = actual.position - fleet.position
    wrong_speed = actual.velocity - fleet.velocity
    return -wrong / step_s**2 - 1.5 * wrong_speed / step_s


def _brake(velocity: Matrix, body: Body, step_s: float) -> Matrix:
    return np.clip(-velocity / step_s, -body.reserve_m_s2, body.reserve_m_s2)


def _candidates(velocity: Vector, wanted: Vector, body: Body, step_s: float) -> Matrix:
    """Thrusts (m, 2) within the reserve and the top speed, nearest to the wanted one first."""
    most = body.reserve_m_s2
    low = np.clip((-body.speed_m_s - velocity) / step_s, -most, most)
    high = np.clip((body.speed_m_s - velocity) / step_s, -most, most)
    best = np.clip(wanted, low, high)
    x, y = np.linspace(low, high, _GRID).T
    grid = np.column_stack([np.repeat(x, _GRID), np.tile(y, _GRID)])
    tried = np.vstack([best, grid])
    return tried[np.argsort(np.square(tried - wanted).sum(axis=1), kind="stable")]


def _way(fleet: Fleet, thrust: Matrix, body: Body, step_s: float) -> Matrix:
    """Places (n, t, 2) of a step with `thrust` (n, 2) and of braking after it, `_PARTS` a step."""
    braking = int(np.ceil(body.speed_m_s / (step_s * body.reserve_m_s2) - 1e-9))
    x, v, u = fleet.position, fleet.velocity, thrust
    after = step_s * np.arange(1, _PARTS + 1)[:, None, None] / _PARTS
    parts = [x[None]]
    for _ in range(1 + braking):
        parts.append(x + after * v + 0.5 * after**2 * u)
        x, v = x + step_s * v + 0.5 * step_s**2 * u, v + step_s * u
        u = _brake(v, body, step_s)
    return np.concatenate(parts).swapaxes(0, 1)


def _clear(
    new: Matrix, others: Matrix, body: Body, *, step_s: float, clearance: Clearance | None
) -> NDArray[np.bool_]:
    """Tell which ways (m, t, 2) stay clear of `others` (k, t, 2) and of obstacles, (m,).

    Between sampled places a way bends away from its chord by at most a h^2 / 8.
    """
    tube = np.sqrt(2.0) * step_s**2 * body.error_m_s2  # of both axes together
    bend = np.sqrt(2.0) * body.reserve_m_s2 * (step_s / _PARTS) ** 2 / 8.0
    good = np.ones(len(new), np.bool_)
    if len(others):
        apart = new[:, None] - others
        nearest = _to_segments(apart[..., :-1, :], apart[..., 1:, :]).min(axis=(1, 2))
        good &= nearest >= body.apart_m + 2.0 * (tube + bend)
    if clearance is not None:
        half = 0.5 * np.linalg.norm(np.diff(new, axis=1), axis=-1)
        middles = 0.5 * (new[:, 1:] + new[:, :-1])
        away = clearance(middles.reshape(-1, 2)).reshape(half.shape)
        good &= (away >= body.clear_m + tube + bend + half).all(axis=1)
    return good


def _to_segments(a: Matrix, b: Matrix) -> Vector:
    """Distances (...) of the origin to the segments from a to b (..., 2)."""
    way = b - a
    long = np.square(way).sum(axis=-1)
    share = np.clip(-(a * way).sum(axis=-1) / np.where(long > 0.0, long, 1.0), 0.0, 1.0)
    return np.linalg.norm(a + share[..., None] * way, axis=-1)
