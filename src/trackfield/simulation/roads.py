"""Wang's road network: 100 range sensors along two roads that part at a corner, Wang 4.3.

Road AB leads 40 m along (1, .3); there it turns right, gently to D or by a right angle to C, with
a rounded corner. Sensors stand in pairs every 2 m, 2 m to each side. All lengths [m], times [s].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackfield.network.site import Site
from trackfield.sensing import range as ranging
from trackfield.sensing.range import Nlos, RangeModel
from trackfield.types import Matrix, Vector

End = Literal["C", "D"]

A = (0.0, 2.0)
VELOCITY = (1.0, 0.3)  # of the target at A [m/s]
AB_M, BC_M, BD_M = 40.0, 30.0, 30.0
D_HEADING_DEG = -10.0
CORNER_RADIUS_M = 2.5
PAIR_SPACING_M, PAIR_OFFSET_M = 2.0, 2.0
DT_S = 0.1
RANGES = RangeModel(sigma_m=math.sqrt(1e-3), sigma_scale=math.sqrt(1e-3), max_range_m=3.0)


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """One target passing sensors: `start` (4,) at time 0, `truth` (K, 4) at `t_s` (K,).

    States are [x, y, vx, vy]; `sensors` (n, 2). `accel_variance` (K, 2) [m^2/s^4] is that of the
    noise that really drove the truth, zero where it followed a road.
    """

    t_s: Vector
    start: Vector
    truth: Matrix
    sensors: Matrix
    accel_variance: Matrix


def sensors(rng: np.random.Generator, *, jitter_m: float = 0.2) -> Matrix:
    """Place the sensors (100, 2): 50 pairs every 2 m of AB (20), BD (15) and BC (15).

    Each stands 2 m to one side of the road and is moved by N(0, jitter_m^2) per axis.
    """
    b = np.array(A) + AB_M * _direction("AB")
    along_ab = PAIR_SPACING_M * np.arange(AB_M / PAIR_SPACING_M)
    groups = [_pairs(np.array(A), _direction("AB"), along_ab)]
    for name, length in (("BD", BD_M), ("BC", BC_M)):
        along = PAIR_SPACING_M * np.arange(1, length / PAIR_SPACING_M + 1)
        groups.append(_pairs(b, _direction(name), along))
    placed = np.concatenate(groups)
    return placed + jitter_m * rng.standard_normal(placed.shape)


def centre_line(end: End, s: Vector) -> tuple[Matrix, Matrix]:
    """Return points and unit tangents (n, 2) of the road A-B-`end` at way `s` (n,) from A.

    The corner is an arc; beyond the end the road goes straight on.
    """
    u, w = _direction("AB"), _direction("B" + end)
    turn = math.acos(float(np.clip(u @ w, -1.0, 1.0)))
    cut = CORNER_RADIUS_M * math.tan(turn / 2)  # from B to where the arc begins
    arc = CORNER_RADIUS_M * turn
    first = AB_M - cut
    right = np.array([u[1], -u[0]])
    phi = np.clip(s - first, 0.0, arc)[:, None] / CORNER_RADIUS_M

    straight = np.array(A) + np.minimum(s, first)[:, None] * u
    corner = CORNER_RADIUS_M * (np.sin(phi) * u + (1.0 - np.cos(phi)) * right)
    last = np.maximum(s - first - arc, 0.0)[:, None] * w
    tangent = np.cos(phi) * u + np.sin(phi) * right
    return straight + corner + last, tangent


def road_length(end: End) -> float:
    """Return the way from A to `end` along the centre line, which cuts the corner [m]."""
    u, w = _direction("AB"), _direction("B" + end)
    turn = math.acos(float(np.clip(u @ w, -1.0, 1.0)))
    corner = CORNER_RADIUS_M * (turn - 2.0 * math.tan(turn / 2))
    return AB_M + (BC_M if end == "C" else BD_M) + corner


def follow_road(
    rng: np.random.Generator,
    end: End,
    *,
    dt_s: float = DT_S,
    speed_sigma: float = 0.02,
    from_m: float = 0.0,
) -> Drive:
    """Drive from A, or `from_m` after it, to `end` on the centre line with about |VELOCITY|.

    The speed's deviation is an Ornstein-Uhlenbeck process, `speed_sigma` [m/s], 5 s.
    """
    placed = sensors(rng)
    mean = math.hypot(*VELOCITY)
    steps = int((road_length(end) - from_m) / (mean * dt_s))
    keep = math.exp(-dt_s / 5.0)
    kicks = speed_sigma * math.sqrt(1.0 - keep**2) * rng.standard_normal(steps)
    deviation = np.empty(steps)
    level = 0.0
    for k in range(steps):
        level = keep * level + kicks[k]
        deviation[k] = level
    speed = mean + deviation
    points, tangents = centre_line(end, from_m + np.cumsum(speed) * dt_s)
    first, heading = centre_line(end, np.array([from_m]))
    return Drive(
        t_s=times(steps, dt_s),
        start=np.concatenate([first[0], mean * heading[0]]),
        truth=np.hstack([points, speed[:, None] * tangents]),
        sensors=placed,
        accel_variance=np.zeros((steps, 2)),
    )


def matched(
    rng: np.random.Generator,
    *,
    steps: int = 400,
    accel_variance: tuple[float, float] = (0.025, 0.01),
    dt_s: float = DT_S,
) -> Drive:
    """Drive whose acceleration noise is really drawn from the model, Wang (1), past paired sensors.

    Such a path leaves any road of 4 m, so the pairs stand every 2 m of the path itself; then a
    filter with this model is the right one, and bounds and consistency can be tested.
    """
    variance = np.array(accel_variance)
    accel = np.sqrt(variance) * rng.standard_normal((steps, 2))
    velocity = np.array(VELOCITY) + dt_s * np.vstack([np.zeros(2), np.cumsum(accel, axis=0)])
    moves = dt_s * velocity[:-1] + 0.5 * dt_s**2 * accel
    path = np.array(A) + np.vstack([np.zeros(2), np.cumsum(moves, axis=0)])

    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    marks = np.arange(-PAIR_SPACING_M, way[-1] + 1.5 * PAIR_SPACING_M, PAIR_SPACING_M)
    at = np.clip(np.searchsorted(way, marks), 0, steps)
    heading = velocity[at] / np.linalg.norm(velocity[at], axis=1, keepdims=True)
    inside = np.clip(marks, 0.0, way[-1])
    centre = np.column_stack([np.interp(inside, way, path[:, i]) for i in (0, 1)])
    centre += (marks - inside)[:, None] * heading
    side = PAIR_OFFSET_M * np.column_stack([-heading[:, 1], heading[:, 0]])
    placed = np.concatenate([centre + side, centre - side])
    return Drive(
        t_s=times(steps, dt_s),
        start=np.array([*A, *VELOCITY]),
        truth=np.hstack([path[1:], velocity[1:]]),
        sensors=placed + 0.2 * rng.standard_normal(placed.shape),
        accel_variance=np.tile(variance, (steps, 1)),
    )


def ranges(
    rng: np.random.Generator,
    drive: Drive,
    *,
    runs: int,
    model: RangeModel = RANGES,
    nlos: Nlos | None = None,
) -> Matrix:
    """Draw the readings (runs, K, n) of every sensor, Wang (2); NaN beyond `max_range_m`."""

    def one() -> Matrix:
        drawn = ranging.simulate(model, drive.sensors, path=drive.truth[:, :2], rng=rng, nlos=nlos)
        return np.where(drawn.heard, drawn.value, np.nan)

    return np.array([one() for _ in range(runs)])


def site(drive: Drive, *, model: RangeModel = RANGES) -> Site:
    """Describe the sensors of a drive as a site, named s0, s1, ..."""
    count = len(drive.sensors)
    return Site(
        name="road",
        sensor_ids=tuple(f"s{i}" for i in range(count)),
        positions=np.column_stack([drive.sensors, np.full(count, np.nan)]),
        models=(model,) * count,
    )


def times(steps: int, dt_s: float = DT_S) -> Vector:
    """Return the times (steps,) of the readings: dt, 2 dt, ... [s]."""
    return dt_s * np.arange(1, steps + 1, dtype=np.float64)


def starts(rng: np.random.Generator, drive: Drive, *, runs: int, sigma: float = 0.1) -> Matrix:
    """Draw wrong starts (runs, 4): the true one plus N(0, sigma^2) on each entry, Wang 4.3."""
    return drive.start + sigma * rng.standard_normal((runs, 4))


def _direction(road: str) -> Vector:
    ab = np.array(VELOCITY) / math.hypot(*VELOCITY)
    if road == "AB":
        return ab
    if road == "BC":
        return np.array([ab[1], -ab[0]])
    heading = math.radians(D_HEADING_DEG)
    return np.array([math.cos(heading), math.sin(heading)])


def _pairs(start: Vector, direction: Vector, along: Vector) -> Matrix:
    centre = start + along[:, None] * direction
    side = PAIR_OFFSET_M * np.array([-direction[1], direction[0]])
    return np.concatenate([centre + side, centre - side])
