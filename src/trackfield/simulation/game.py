"""Pursuit and evasion in one loop: evaders, sensors, tracker, coordinator and pursuers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.pipeline.pursuing import Pursuit
from trackfield.pipeline.rows import Row, tracks_of
from trackfield.pipeline.untagged import Feed, UntaggedTracker
from trackfield.pursuit.coordinator import Coordinator, coordinator
from trackfield.pursuit.coordinator_state import Orders
from trackfield.pursuit.separation import Body
from trackfield.pursuit.settings import PursuitSettings
from trackfield.pursuit.vehicles import Runner, Thruster, Vehicle
from trackfield.pursuit.wheeled import Wheels
from trackfield.robot.car import Car
from trackfield.robot.obstacles import Obstacles
from trackfield.simulation.evaders import Evaders, Present
from trackfield.simulation.hearing import Heard, Listening, hear_readings, hear_reports
from trackfield.simulation.scenario import Pursuit as Rules
from trackfield.simulation.scenario import Scenario
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import World, stream
from trackfield.types import Matrix, Readings, Reports, Status, Tracks, Truth

_JUST = 1e-6  # of a step, by which a watermark stays before its end
_PARTS = 8  # of a step, at whose ends distances are taken


class Captured(NamedTuple):
    """An evader, as its place among the targets, and the pursuer that has it."""

    target: int
    pursuer: int


class Turn(NamedTuple):
    """One step of a game, from `t_s` on.

    `pursuers` (p, k) and `evaders` are as they are at `t_s`, `captured` who is captured then;
    `orders` are given then, and `tracks` are the rows that were known. `apart_m` and `clear_m` are
    the least distances between two pursuers, and of one to an obstacle, in the step; inf of none.
    """

    t_s: float
    pursuers: Matrix
    evaders: Present
    captured: tuple[Captured, ...]
    tracks: Tracks
    orders: Orders
    apart_m: float
    clear_m: float


class Game:
    """A game of a world whose scenario says `[pursuit]`: `turns` are drawn as it is played.

    `InputError` for a scenario without.
    """

    def __init__(self, world: World) -> None:
        rules = world.scenario.pursuit
        if rules is None:
            raise InputError(
                "found a scenario without pursuit, expected [pursuit] and [[pursuers]]"
            )
        self._rules, self._scenario = rules, world.scenario
        self._evaders = Evaders(world)
        self._coordinator = coordinator_of(world.scenario)
        self._pursuit = Pursuit(self._coordinator)
        self._rng = stream(world.seed, "pursuit")
        self._moving: Vehicle = self._coordinator.vehicle
        if self._coordinator.body is not None:  # their actuators do more than what they are told
            self._moving = Thruster(rules.thrust_m_s2 + rules.error_m_s2)
        self._real = Obstacles([shape.corners for shape in world.scenario.obstacles])

    @property
    def truth(self) -> Truth:
        """Where evaders were until they left or were captured."""
        return self._evaders.truth

    @property
    def counts(self) -> dict[str, int]:
        """What was ordered, as `pipeline.pursuing.Pursuit` counts it."""
        return self._pursuit.counts

    def lives(self) -> list[tuple[float, float]]:
        """When each evader came, and would have left [s]."""
        return self._evaders.lives()

    def turns(self) -> Iterator[Turn]:
        """Play, step by step, to the end of the scenario."""
        scenario, step_s = self._scenario, self._scenario.step_s
        states, near = starts(scenario), dict[tuple[int, int], int]()
        heard, tracker = self._senses()
        rows, dismissed = tracks_of(()), list[int]()
        before: Orders | None = None
        for k in range(scenario.steps):
            t_s = k * step_s
            present = self._evaders.at(k)
            near = _nearer(near, states, present, self._rules.capture_m)
            captured = _captures(near, self._rules.confirm_steps)
            for one in captured:
                self._evaders.capture(one.target, k)
                if before is not None:
                    dismissed += _track_of(before, one, present, 3.0 * self._rules.capture_m)
            if self._rules.sight == "exact":
                rows = exact(t_s, present, captured)
            orders = self._pursuit.process(rows, states, t_s=t_s, dismissed=dismissed)
            done = self._noisy(orders.commands)
            apart_m, clear_m = self._least(states, done)
            yield Turn(t_s, states, present, captured, rows, orders, apart_m, clear_m)
            before, dismissed = orders, []
            if self._rules.sight == "tracks":
                rows = tracker.process(next(heard).table, watermark_s=t_s + step_s * (1.0 - _JUST))
            self._evaders.flee(k, states, self._coordinator.vehicle)
            states = self._moving.moved(states, done, step_s=step_s)

    def _senses(self) -> tuple[Iterator[Heard[Readings] | Heard[Reports]], UntaggedTracker]:
        world, scenario = self._evaders.world, self._scenario
        everybody = np.ones(len(world.deployment.sensor_ids), np.bool_)
        listening = Listening(scenario.step_s, lambda: everybody)
        site = site_of(world)
        if scenario.reports is not None or scenario.fusion is not None:
            return hear_reports(world, listening), UntaggedTracker(site)
        source = "detection" if scenario.detection is not None else "signal"
        return hear_readings(world, listening), UntaggedTracker(site, Feed(source, world.seed))

    def _noisy(self, commands: Matrix) -> Matrix:
        if self._coordinator.body is None:
            return commands
        error = self._rules.error_m_s2
        return commands + self._rng.uniform(-error, error, commands.shape)

    def _least(self, states: Matrix, commands: Matrix) -> tuple[float, float]:
        """Least distance between two pursuers, and to an obstacle, in a step."""
        apart, clear = math.inf, math.inf
        n = len(states)
        for part in range(1, _PARTS + 1):
            share = self._scenario.step_s * part / _PARTS
            place = self._moving.moved(states, commands, step_s=share)[:, :2]
            if n > 1:
                between = np.linalg.norm(place[:, None] - place, axis=-1)
                apart = min(apart, float(between[~np.eye(n, dtype=np.bool_)].min()))
            if self._real.parts and n:
                clear = min(clear, float(self._real.distance(place).min()))
        return apart, clear


def coordinator_of(scenario: Scenario) -> Coordinator:
    """Make the coordinator of a scenario's pursuers; `InputError` for one without `[pursuit]`."""
    rules = scenario.pursuit
    if rules is None:
        raise InputError("found a scenario without pursuit, expected [pursuit] and [[pursuers]]")
    settings = PursuitSettings(
        step_s=scenario.step_s,
        objective=rules.objective,
        margin=rules.margin,
        double=rules.double,
        evader_accel_m_s2=rules.evader_accel_m_s2,
        doubt_sigmas=rules.doubt_sigmas,
        most_sigma_m=rules.most_sigma_m,
        forget_s=rules.forget_s,
    )
    polygons = [shape.corners for shape in scenario.obstacles]
    return coordinator(vehicle_of(rules), settings, polygons=polygons)


def vehicle_of(rules: Rules) -> Vehicle | Body:
    """Say what pursuers are; `ConfigurationError` for what cannot move."""
    if rules.vehicle == "runner":
        return Runner(rules.speed_m_s)
    if rules.vehicle == "car":
        return Wheels(Car(rules.speed_m_s, math.radians(rules.steering_deg), rules.wheel_base_m))
    return Body(
        thrust_m_s2=rules.thrust_m_s2,
        error_m_s2=rules.error_m_s2,
        speed_m_s=rules.speed_m_s,
        apart_m=rules.apart_m,
        clear_m=rules.clear_m,
    )


def starts(scenario: Scenario) -> Matrix:
    """States (p, k) in which pursuers begin, at rest."""
    at = np.array([one.at for one in scenario.pursuers], np.float64).reshape(-1, 2)
    kind = "thruster" if scenario.pursuit is None else scenario.pursuit.vehicle
    heading = np.radians([[one.heading_deg] for one in scenario.pursuers]).reshape(-1, 1)
    more = {"thruster": np.zeros(at.shape), "runner": at[:, :0], "car": heading}
    return np.hstack([at, more[kind]])


def exact(t_s: float, present: Present, captured: Iterable[Captured]) -> Tracks:
    """Make rows of tracks of the evaders themselves; those of the captured ones end."""
    over = {one.target for one in captured}
    rows: list[Row] = []
    for j, (x, y, vx, vy) in zip(present.target.tolist(), present.state.tolist(), strict=True):
        status = Status.ENDED if j in over else Status.CONFIRMED
        rows.append(Row(t_s, j + 1, x, y, vx, vy, 0.0, 0.0, 0.0, int(status)))
    return tracks_of(rows)


def _nearer(
    before: dict[tuple[int, int], int], states: Matrix, present: Present, capture_m: float
) -> dict[tuple[int, int], int]:
    """Count for how many steps in a row pursuers have been near evaders, (evader, pursuer)."""
    away = np.linalg.norm(states[:, None, :2] - present.state[:, :2], axis=-1)
    pairs = [(int(present.target[j]), int(i)) for i, j in np.argwhere(away <= capture_m)]
    return {pair: before.get(pair, 0) + 1 for pair in pairs}


def _captures(near: dict[tuple[int, int], int], steps: int) -> tuple[Captured, ...]:
    found: dict[int, Captured] = {}
    for (target, pursuer), count in near.items():
        if count >= steps:
            found.setdefault(target, Captured(target, pursuer))
    return tuple(found.values())


def _track_of(before: Orders, one: Captured, present: Present, within_m: float) -> list[int]:
    """Tell which track a pursuer chased that has captured an evader, if it was near that one."""
    track = int(before.track[one.pursuer])
    state = present.state[present.target == one.target][0]
    away = math.dist(before.evader[one.pursuer], state[:2]) if track >= 0 else math.inf
    return [track] if away <= within_m else []
