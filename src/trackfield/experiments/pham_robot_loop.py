"""Pham, chapter 4, closed loop: a robot that selects sensors, filters their ranges and moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments.pham_robot_paths import FIELD, SENSING_M, sinusoid
from trackfield.filtering import extended, kalman
from trackfield.filtering.extended import Ranges
from trackfield.localization import trilateration
from trackfield.localization.information import reading_gains
from trackfield.motion import ConstantVelocity
from trackfield.robot import horizon as robot_horizon
from trackfield.robot.horizon import Horizon
from trackfield.robot.optimum import shortest_tour
from trackfield.robot.rule import Link, least_move
from trackfield.scheduling.selection import select
from trackfield.sensing.range import RangeModel, distance, simulate
from trackfield.types import Gaussian, Indices, Matrix, Vector

NODES = 441
SIGMA_M = 0.1
ERROR_M = 0.15  # dtau_T: two and a half of the filter's standard deviations
SELECTED = 3
_DT_S = 0.5
_STEPS, _PERIODS, _AMPLITUDE = 96, 2.0, 2.5
_MOTION = ConstantVelocity(0.02)
_MODEL = RangeModel(sigma_m=SIGMA_M)
_HORIZON = Horizon(region=FIELD)


@dataclass(frozen=True, slots=True)
class Setting:
    """Communication radius [m], and whether the robot looks ahead or follows the rule (4.11)."""

    comm_m: float
    ahead: bool


class Loop(NamedTuple):
    """What became of a run: true, filtered and trilaterated places (n, 2), the robot's, nodes.

    `heard` (n,) counts the sensors that sense the target, `in_hop` (n,) those of them that hear
    the robot; `master` (n,) is the node nearest to the target. `optimum_m` is the shortest tour
    through the discs around the true places.
    """

    setting: Setting
    nodes: Matrix
    target: Matrix
    filtered: Matrix
    trilaterated: Matrix
    robot: Matrix
    heard: Indices
    in_hop: Indices
    selected: Indices
    master: Indices
    length_m: float
    optimum_m: float

    @property
    def hop_kept(self) -> float:
        """Share of the steps in which all sensors that sense the target hear the robot."""
        kept = np.equal(self.in_hop, self.heard)
        return float(np.count_nonzero(kept)) / len(kept)


def run_loop(rng: np.random.Generator, setting: Setting, *, phase: float = 0.0) -> Loop:
    """Follow a target on a sinusoid across the field, 441 random nodes, ranges with noise .1 m.

    In each step the robot asks three of the sensors in its hop, those of least trace given what it
    knows; it begins at the target, whose place and rest it knows to 1 m and 1 m/s.
    """
    nodes = rng.uniform(0.0, 10.0, (NODES, 2))
    target = sinusoid(_STEPS, _PERIODS, _AMPLITUDE, phase)
    link = Link(setting.comm_m, SENSING_M, ERROR_M)
    senses = distance(nodes, target) <= SENSING_M
    belief = Gaussian(np.array([*target[0], 0.0, 0.0]), np.eye(4))
    state = robot_horizon.begin(target[0])
    rows: list[tuple[_Sight, Vector]] = []
    for k, at in enumerate(target):
        prior = kalman.predict(belief, _MOTION.transition(_DT_S), _MOTION.noise(_DT_S))
        hears = senses[k] & _within(nodes, state.place, setting.comm_m)
        sight = _look(rng, nodes[hears], at, prior)
        belief, told = sight.belief, sight.belief.mean[:2]
        if setting.ahead:
            state, advice = robot_horizon.step(
                state, told, t_s=k * _DT_S, reach_m=link.reach_m, horizon=_HORIZON
            )
            wanted = advice.place
        else:
            wanted = least_move(state.place, told, reach_m=link.reach_m)
        state = robot_horizon.arrive(state, wanted)
        rows.append((sight, wanted))
    robot = np.array([place for _, place in rows])
    in_hop = senses & (np.linalg.norm(nodes - robot[:, None], axis=-1) <= setting.comm_m)
    best = shortest_tour(target[0], target, radius_m=link.reach_m)
    return Loop(
        setting,
        nodes,
        target,
        np.array([sight.belief.mean[:2] for sight, _ in rows]),
        np.array([sight.trilaterated for sight, _ in rows]),
        robot,
        senses.sum(axis=1).astype(np.int32),
        in_hop.sum(axis=1).astype(np.int32),
        np.array([sight.selected for sight, _ in rows], np.int32),
        np.argmin(distance(nodes, target), axis=1).astype(np.int32),
        state.way_m,
        best.bound_m,
    )


def typical_error(places: Matrix, target: Matrix) -> float:
    """Median distance [m] of places (n, 2) from the target, where there is one."""
    return float(np.nanmedian(np.linalg.norm(places - target, axis=1)[1:]))


class _Sight(NamedTuple):
    belief: Gaussian
    trilaterated: Vector
    selected: int


def _look(rng: np.random.Generator, candidates: Matrix, at: Vector, prior: Gaussian) -> _Sight:
    """Ask those of the candidates (n, 2) that leave the least trace, and filter what they say."""
    nowhere = np.full(2, np.nan)
    if not len(candidates):
        return _Sight(prior, nowhere, 0)
    gains = reading_gains(_MODEL, candidates, prior.mean[:2])
    information = np.linalg.inv(prior.covariance[:2, :2])
    chosen = select(gains, SELECTED, prior=0.5 * (information + information.T)).sensors
    asked = candidates[chosen]
    z = simulate(_MODEL, asked, path=at[None], rng=rng).value[0]
    posterior = extended.update(prior, z, Ranges(asked, _MODEL)).posterior
    alone = trilateration.ordinary(asked, z).position if len(asked) == SELECTED else nowhere
    return _Sight(posterior, alone, len(asked))


def _within(nodes: Matrix, place: Vector, radius: float) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(nodes - place, axis=1) <= radius)
