"""Track-before-detect on binary fields: tracks straight from what sensors say, silence included.

A particle filter of joint hypotheses. Each possible target has an existence and a cloud of
particles; targets that share sensors are one group with one particle index, so that the likelihood
of their meeting is exact, and the others stand behind it by their coverage. What nodes say also
tells which of them are dead or stuck, and how p and q of the whole field differ from their models.
The arithmetic is compiled (`trackfield._core`); every number it starts from stands here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _detect as kernel
from trackfield.association.contract import Estimates, Info
from trackfield.association.detect_field import Coverage, DetectField, coverage_of, models_of
from trackfield.errors import InputError, StateError
from trackfield.sensing.detection import reach
from trackfield.types import Indices, Vector

_MAGIC = b"trackfield-detect-1\n"


class ReadingScan(NamedTuple):
    """What n sensors said in one step: `value` (n,) is 1, 0, or -1 for nothing that was heard."""

    t_s: float
    value: NDArray[np.int8]


@dataclass(frozen=True, slots=True)
class DetectSettings:
    """What is believed of targets and nodes, and how much work is done.

    A target moves with white acceleration of `accel_sigma_m_s2`^2 * 1 s and turns `turns_per_s`
    times a second into another direction (change of `turn_sigma_m_s` per axis). Existence decides:
    a target is `confirm`ed, `show`n and `drop`ped at these probabilities. `temper` is the power of
    a scan's likelihood: 1 where the models are right, less where they are not. `dead` and `stuck`
    are the shares of such nodes, which change in about `node_time_s`.
    """

    particles: int = 3000
    accel_sigma_m_s2: float = 0.14
    turns_per_s: float = 0.0
    turn_sigma_m_s: float = 0.6
    velocity_sigma_m_s: float = 0.9
    lifetime_s: float = 300.0
    births_per_s: float = 0.01
    initial_count: float = 0.1
    temper: float = 0.85
    confirm: float = 0.7
    show: float = 0.2
    drop: float = 0.005
    group_size: int = 4
    most_targets: int = 64
    dead: float = 0.03
    stuck: float = 1e-5
    node_time_s: float = 2000.0
    learn_readings: float = 200.0
    history_steps: int = 5


class FieldExplanation(NamedTuple):
    """Why a track is there: how surely, since when, and what its sensors said for it.

    `log_ratio` (n,) is the log-likelihood of what `sensors` (n,) said in the last steps with the
    track over without it, the strongest first; `together` how many tracks are decided on jointly.
    """

    track: int
    existence: float
    first_s: float
    together: int
    sensors: Indices
    log_ratio: Vector


class Detect:
    """A tracker of unknown targets on raw binary readings; states are values."""

    def __init__(self, field: DetectField, settings: DetectSettings = DetectSettings()) -> None:
        self.field, self.settings = field, settings
        models = models_of(field)
        self.coverage = coverage_of(field, models)
        delivery = np.broadcast_to(np.asarray(field.delivery, float), len(field.sensors))
        group = np.broadcast_to(np.asarray(field.group, float), len(field.sensors))
        self._kernel = kernel.Filter(
            _numbers(field, settings, self.coverage, float(reach(models).min())),
            self.coverage.grid,
            self.coverage.start,
            self.coverage.sensor,
            self.coverage.covered,
            np.stack([models.p_detection, models.p_false, delivery, group], axis=1).ravel(),
        )

    def initial(self, seed: int = 0) -> kernel.State:
        """Make the state before the first scan. The same seed gives the same run."""
        return self._kernel.initial(seed)

    def step(self, state: kernel.State, scan: ReadingScan) -> tuple[kernel.State, Info]:
        """Take the next scan. `InputError` for one that is not newer or not of these sensors."""
        value = self._checked(scan)
        dt = self.field.step_s
        if state.scans():
            dt = scan.t_s - state.t
            if not dt > 0.0:
                raise InputError(f"scan at {scan.t_s} s: expected one after {state.t} s")
        after, told = self._kernel.step(state, scan.t_s, dt, value)
        counts = {name: int(told[name]) for name in ("births", "largest_group", "members")}
        learned = {name: told[name] for name in ("p_factor", "q_factor")}
        return after, Info(counts, learned, counts["members"] * self.settings.particles)

    def estimates(self, state: kernel.State, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight of `lag_steps` before it.

        Hindsight looks where the particles of now came from. `InputError` for a lag beyond
        `history_steps`.
        """
        if not 0 <= lag_steps <= self.settings.history_steps:
            raise InputError(
                f"a lag of 0 to {self.settings.history_steps} steps expected, found {lag_steps}"
            )
        t_s, numbers, names = state.rows(lag_steps)
        upper = np.zeros((4, 4), int)
        upper[np.triu_indices(4)] = np.arange(10)
        square = np.maximum(upper, upper.T)
        return Estimates(
            t_s=t_s,
            track=np.ascontiguousarray(names[:, 0]),
            existence=numbers[:, 1],
            mean=numbers[:, 2:6],
            covariance=numbers[:, 6:][:, square],
            first_s=numbers[:, 0],
            detected=names[:, 2] != 0,
            shown=(names[:, 1] != 0) & (numbers[:, 1] >= self.settings.show),
        )

    def explain(self, state: kernel.State, track: int) -> FieldExplanation | None:
        """Say which sensors speak for a track; None where no track has this identity now."""
        found = state.explain(track)
        if found is None:
            return None
        existence, first_s, together, sensors, ratio = found
        order = np.argsort(-ratio, kind="stable")
        return FieldExplanation(track, existence, first_s, together, sensors[order], ratio[order])

    def nodes(self, state: kernel.State) -> tuple[Vector, Vector]:
        """Probability of each node to be dead, and to be stuck at 1, (n,) each."""
        return state.dead(), state.stuck()

    def encode(self, state: kernel.State) -> bytes:
        """Write a state as bytes, versioned, not pickle."""
        return _MAGIC + self._kernel.encode(state)

    def decode(self, data: bytes) -> kernel.State:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        if not data.startswith(_MAGIC):
            raise StateError("not a state of this tracker and version")
        try:
            return self._kernel.decode(data[len(_MAGIC) :])
        except RuntimeError as error:
            raise StateError(str(error)) from error

    def _checked(self, scan: ReadingScan) -> NDArray[np.int8]:
        value = np.asarray(scan.value)
        n = len(self.field.sensors)
        if not math.isfinite(scan.t_s):
            raise InputError(f"a scan at {scan.t_s} s: expected a finite time")
        if value.shape != (n,):
            raise InputError(f"values of shape {value.shape}: expected ({n},), one a sensor")
        if not np.isin(value, (-1, 0, 1)).all():
            raise InputError("values other than 1, 0 and -1 (nothing heard)")
        return np.ascontiguousarray(value, np.int8)


def _numbers(
    field: DetectField, settings: DetectSettings, coverage: Coverage, reach_m: float
) -> dict[str, float]:
    """Every number of the kernel's settings."""
    return {
        "particles": settings.particles,
        "accel_density": settings.accel_sigma_m_s2**2,
        "turn_rate": settings.turns_per_s,
        "turn_sigma": settings.turn_sigma_m_s,
        "velocity_sigma": settings.velocity_sigma_m_s,
        "lifetime": settings.lifetime_s,
        "births_per_s": settings.births_per_s,
        "initial_count": settings.initial_count,
        "temper": settings.temper,
        "join": 0.1,
        "part": 0.05,
        "group_size": settings.group_size,
        "most_members": settings.most_targets,
        "drop": settings.drop,
        "confirm": settings.confirm,
        "mature": 0.5,
        "birth_radius": 0.9 * reach_m,
        "birth_reach": 0.65 * reach_m,
        "birth_stride": max(1, round(0.2 * reach_m / coverage.grid[2])),
        "births_per_step": 3,
        "least_birth": 0.1,
        "name_horizon": 2.0,
        "node_time": settings.node_time_s,
        "dead": settings.dead,
        "stuck": settings.stuck,
        "most_new": 4.0,
        "outage": 0.01,
        "says_zero": field.says_zero,
        "rate_weight": settings.learn_readings,
        "rate_memory": 100.0 * settings.learn_readings,
        "history": settings.history_steps,
        "support_time": 5.0,
    }
