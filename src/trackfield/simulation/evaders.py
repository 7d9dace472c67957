"""The evaders of a game: a truth that is written while it is played."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackfield.pursuit.vehicles import Vehicle
from trackfield.raster import Region
from trackfield.simulation.targets import Life, lives_of
from trackfield.simulation.world import World, stream
from trackfield.types import Indices, Matrix, Truth, Vector, select_rows

_TRIED = np.array([[x, y] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
_GONE = -1


class Present(NamedTuple):
    """Evaders that are there: their places (m,) among all targets, and states (m, 4)."""

    target: Indices
    state: Matrix


class Evaders:
    """Targets of a world that can be captured, and may flee.

    `world` is the world as it comes to be: what its sensors hear of a step must be drawn after
    `flee` of the step before. Captured targets are gone.
    """

    def __init__(self, world: World) -> None:
        self._lives = lives_of(world.scenario, stream(world.seed, "targets"))
        whole = world.truth
        self._truth = replace(whole, target=whole.target.copy(), position=whole.position.copy())
        self._rows = [np.flatnonzero(whole.target == j) for j in range(len(self._lives))]
        self._velocity = [_first_velocity(life, world.scenario.step_s) for life in self._lives]
        self._ends = [life.first + len(life.path) for life in self._lives]
        self.world = replace(world, truth=self._truth)

    @property
    def truth(self) -> Truth:
        """Where evaders were as long as they were there."""
        return select_rows(self._truth, self._truth.target != _GONE)

    def lives(self) -> list[tuple[float, float]]:
        """When each evader came, and was gone without being captured [s]."""
        step_s = self.world.scenario.step_s
        ends = (life.first + len(life.path) for life in self._lives)
        return [
            (life.first * step_s, end * step_s) for life, end in zip(self._lives, ends, strict=True)
        ]

    def at(self, step: int) -> Present:
        """Tell who is there in a step, and how they move, or have moved to get there."""
        here = [j for j, life in enumerate(self._lives) if life.first <= step < self._ends[j]]
        state = [np.append(self._place(j, step), self._speed(j, step)) for j in here]
        return Present(np.array(here, np.int32), np.array(state).reshape(-1, 4))

    def flee(self, step: int, pursuers: Matrix, vehicle: Vehicle) -> None:
        """Let who flees take, of nine thrusts, the one after which its capture comes latest.

        Oh (10): the time to capture is that of the nearest pursuer, as its motion tells. Who comes
        to the border of the region stops there.
        """
        scenario = self.world.scenario
        here: list[int] = self.at(step).target.tolist()
        for j in here:
            life = self._lives[j]
            if life.evade_m_s2 == 0.0 or step + 1 >= self._ends[j]:
                continue
            now = np.append(self._place(j, step), self._velocity[j])
            after = _fled(now, life, scenario.step_s, scenario.area)
            sooner = vehicle.times(pursuers, after).min(axis=0) if len(pursuers) else np.zeros(9)
            best = after[int(sooner.argmax())]
            self._truth.position[self._rows[j][step + 1 - life.first], :2] = best[:2]
            self._velocity[j] = best[2:]

    def capture(self, target: int, step: int) -> None:
        """Take an evader away, from the next step on."""
        self._ends[target] = step + 1
        rows = self._rows[target][step + 1 - self._lives[target].first :]
        self._truth.target[rows] = _GONE
        self._truth.position[rows] = np.nan

    def _place(self, target: int, step: int) -> Vector:
        row = self._rows[target][step - self._lives[target].first]
        return self._truth.position[row, :2]

    def _speed(self, target: int, step: int) -> Vector:
        life = self._lives[target]
        if life.evade_m_s2 > 0.0 or step == life.first:
            return self._velocity[target]
        gone = self._place(target, step) - self._place(target, step - 1)
        return gone / self.world.scenario.step_s


def _first_velocity(life: Life, step_s: float) -> Vector:
    return (life.path[1] - life.path[0]) / step_s if len(life.path) > 1 else np.zeros(2)


def _fled(now: Vector, life: Life, step_s: float, region: Region) -> Matrix:
    """States (9, 4) a step later, one for each thrust that is tried."""
    low, high = ((side - now[2:]) / step_s for side in (-life.speed_m_s, life.speed_m_s))
    thrust = np.clip(life.evade_m_s2 * _TRIED, np.minimum(low, 0.0), np.maximum(high, 0.0))
    place = now[:2] + step_s * now[2:] + 0.5 * step_s**2 * thrust
    inside = np.clip(place, region[:2], region[2:])
    velocity = np.where(inside == place, now[2:] + step_s * thrust, 0.0)
    return np.hstack([inside, velocity])
