"""A robot led after a known track: its path, what it costs, and whether it ever loses the hop."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.robot import horizon as robot_horizon
from trackfield.robot.horizon import Horizon
from trackfield.robot.optimum import shortest_tour
from trackfield.robot.rule import Link, beyond, checked_track, least_move
from trackfield.robot.vehicle import Disc, Vehicle, move
from trackfield.types import Matrix, Vector

_CAR_MARGIN = 0.25  # of the reach at most: a car starts to turn before it must be there
_MOST_PAIRS = 2000  # samples between which the speed that is needed is looked for


@dataclass(frozen=True, slots=True)
class Mission:
    """What the robot is, what it has to keep, and how it looks ahead; None: Pham's rule (4.11)."""

    link: Link
    vehicle: Vehicle = field(default_factory=Vehicle)
    horizon: Horizon | None = field(default_factory=Horizon)


class Path(NamedTuple):
    """Where a robot was when the target was seen: places (n, 2) [m], headings (n,) [rad].

    `way_m` (n,) went it in each step; `behind_m` (n,) is how far it was beyond its reach then, 0
    where the hop was kept; `reachable` (n,) is false where obstacles left no way into the disc.
    """

    place: Matrix
    heading_rad: Vector
    way_m: Vector
    behind_m: Vector
    reachable: NDArray[np.bool_]


class Plan(NamedTuple):
    """A path after a track, and what it is worth.

    `rule_m` is the length that the rule goes in the same vehicle; `optimum_m` is that of the
    shortest path that keeps the hop, known from the start, without obstacles or limits of speed,
    which no path that keeps the hop is shorter than but for `optimum_m` - `bound_m`.
    `hop_kept` is the share of the samples with the robot in reach; `lost_s` the time without, and
    `longest_lost_s` the longest of it at once. `needed_speed_m_s`: no slower robot can keep the
    hop all along; `too_slow` where this one is slower.
    """

    t_s: Vector
    path: Path
    length_m: float
    rule_m: float
    optimum_m: float
    bound_m: float
    hop_kept: float
    lost_s: float
    longest_lost_s: float
    needed_speed_m_s: float
    too_slow: bool

    @property
    def late_steps(self) -> NDArray[np.intp]:
        """Numbers of the samples at which the robot was out of reach."""
        return np.flatnonzero(self.path.behind_m > 0.0)


def plan(mission: Mission, t_s: Vector, track: Matrix, *, start: Vector) -> Plan:
    """Lead a robot from `start` (2,) [m] after a `track` (n, 2) [m], seen at `t_s` (n,), rising.

    At each sample the robot knows the track up to then, and gets where it is wanted by then as far
    as its vehicle lets it: the first step takes no time. `InputError` for times that do not rise,
    what is not finite, and a start in an obstacle.
    """
    place, seen = checked_track(start, track)
    times = checked_times(t_s, len(seen))
    if not mission.vehicle.obstacles.free(place):
        raise InputError(f"start: found {place.tolist()} in an obstacle, expected a free place")
    path = follow(mission, times, seen, start=place)
    rule = follow(replace(mission, horizon=None), times, seen, start=place)
    best = shortest_tour(place, seen, radius_m=mission.link.reach_m)
    late = path.behind_m > 0.0
    gaps = np.diff(times, prepend=times[0])
    needed = needed_speed(times, seen, start=place, reach_m=mission.link.reach_m)
    return Plan(
        times,
        path,
        float(path.way_m.sum()),
        float(rule.way_m.sum()),
        best.length_m,
        best.bound_m,
        1.0 - float(late.mean()),
        float(gaps[late].sum()),
        _longest(late, gaps),
        needed,
        too_slow=needed > mission.vehicle.speed_m_s,
    )


def follow(mission: Mission, t_s: Vector, track: Matrix, *, start: Vector) -> Path:
    """Lead the robot after a track (n, 2) [m] seen at `t_s` (n,), as `plan` says; without checks.

    A robot slower than the target just was does not save its way: it makes for the target.
    """
    vehicle, horizon = mission.vehicle, mission.horizon
    reach = mission.link.reach_m
    if vehicle.car is not None:
        reach -= min(vehicle.car.turning_radius_m, _CAR_MARGIN * reach)
    if horizon is not None and vehicle.obstacles.parts:
        horizon = replace(horizon, stake=math.inf)  # the rule's way is another among obstacles
    gaps = np.diff(t_s, prepend=t_s[0])
    state, heading = robot_horizon.begin(start), 0.0
    rows: list[tuple[float, ...]] = []
    for k, (t, target, dt) in enumerate(zip(t_s, track, gaps, strict=True)):
        disc = Disc(target, reach)
        outrun = k > 0 and math.dist(target, track[k - 1]) > vehicle.speed_m_s * float(dt)
        if outrun:
            disc = Disc(target, 1e-3 * reach)
        if horizon is None or outrun:
            wanted = least_move(state.place, target, reach_m=disc.reach_m)
            if horizon is not None:
                state, _ = robot_horizon.step(
                    state, target, t_s=float(t), reach_m=reach, horizon=horizon
                )
        else:
            state, advice = robot_horizon.step(
                state, target, t_s=float(t), reach_m=reach, horizon=horizon
            )
            wanted = advice.place
        went = move(vehicle, state.place, heading, wanted=wanted, disc=disc, dt_s=float(dt))
        state, heading = robot_horizon.arrive(state, went.place, way_m=went.way_m), went.heading_rad
        rows.append((*went.place, heading, went.way_m, float(went.reachable)))
    table = np.array(rows)
    behind = beyond(table[:, :2], track, reach_m=mission.link.reach_m)
    return Path(table[:, :2], table[:, 2], table[:, 3], behind, table[:, 4] > 0.0)


def needed_speed(t_s: Vector, track: Matrix, *, start: Vector, reach_m: float) -> float:
    """Speed [m/s] that no robot keeps the hop below: between two samples it goes |T_i - T_j| - 2 G.

    From the start it goes |T_j - start| - G. A lower bound: a robot just as fast may be too slow.
    """
    step = -(-len(t_s) // _MOST_PAIRS)
    t, places = t_s[::step], track[::step]
    gaps = t[None] - t[:, None]
    apart = np.linalg.norm(places[None] - places[:, None], axis=-1) - 2.0 * reach_m
    first = np.linalg.norm(places - start, axis=1) - reach_m
    if first[0] > 1e-9 * reach_m:
        return math.inf
    between = np.max(apart[gaps > 0.0] / gaps[gaps > 0.0], initial=0.0)
    return float(np.max(first[1:] / (t[1:] - t[0]), initial=between))


def checked_times(t_s: Vector, count: int) -> Vector:
    """Make an array of times (n,) [s], which must rise; else `InputError`."""
    times = np.asarray(t_s, np.float64)
    if times.shape != (count,) or not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        raise InputError(
            f"t_s: found times of shape {times.shape} that are not finite and rising, or not one "
            f"for each of {count} places"
        )
    return times


def _longest(late: NDArray[np.bool_], gaps: Vector) -> float:
    """Longest time [s] in one piece that the hop was lost."""
    longest = lost = 0.0
    for out, gap in zip(late, gaps, strict=True):
        lost = lost + float(gap) if out else 0.0
        longest = max(longest, lost)
    return longest
