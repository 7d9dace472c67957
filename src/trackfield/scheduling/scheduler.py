"""The scheduler: what is believed of targets in, what each node does until next time out.

Pham, chapters 2 and 5: around a target a few nodes sense and one of them is the master; nodes that
it comes to next are awake; the others sleep; the border is watched while nobody is inside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.motion import Motion
from trackfield.network.site import SchedulingSettings
from trackfield.raster import Region
from trackfield.scheduling import master
from trackfield.scheduling.awake import Look, look_for, region_nodes, watchers
from trackfield.scheduling.scheduler_state import (
    Followed,
    Service,
    Sighted,
    State,
    Told,
    carried,
    merged,
)
from trackfield.scheduling.serving import Able, Choice, Sensors, choose
from trackfield.scheduling.watch import Watch
from trackfield.types import Gaussian, Mode, Vector

_SEARCHED = 2  # intervals without a reading, or odd rows, from which on a track is looked for
_WIDEST = 20  # times that a search doubles its width: anything is a whole field then
_PLACE = 0.5  # weight of a master's distance to the target, against the energy that it has spent
_EARLY = 1e-6  # of an interval, by which times of rounded steps may differ


class _Case(NamedTuple):
    """A track that is to be served: its state at the time of the step, and what it has missed."""

    name: int
    known: Followed
    mean: Vector
    covariance: NDArray[np.float64]
    missed: int

    @property
    def doubt(self) -> int:
        """Intervals without a reading, or with readings that contradict the belief, in a row."""
        return max(self.missed, self.known.odd)

    @property
    def place(self) -> Gaussian:
        """Where the target is."""
        return Gaussian(self.mean[:2], self.covariance[:2, :2])


@dataclass(frozen=True, slots=True, eq=False)
class Scheduler:
    """Scheduling of a field of sensors in the plane; states are values, a step makes a new one.

    `motion` says how targets may move until they are sensed again; `watch` who may watch the border
    of `region`, None where it is never watched.
    """

    sensors: Sensors
    settings: SchedulingSettings
    motion: Motion
    region: Region
    watch: Watch | None = None

    def initial(self) -> State:
        """Make the state before the first step: all sleep."""
        return State(None, np.zeros(len(self.sensors.nodes), np.int8), {}, -math.inf)

    def step(
        self, state: State, t_s: float, *, sighted: Sighted, residual: Vector | None = None
    ) -> tuple[State, Told]:
        """Command all nodes for the interval from `t_s` on, knowing `sighted` of up to then.

        `residual` (n,) is the share of its energy that each node has left: who has none is told
        nothing, who has little is spared. `InputError` for a time that is not later than the last
        one, and for residuals that are no shares.
        """
        if not math.isfinite(t_s) or (state.t_s is not None and t_s <= state.t_s):
            raise InputError(f"found commands for {t_s} s after those for {state.t_s} s")
        able = self._able(state, residual)
        known, ended, trouble = merged(state.tracks, sighted, until_s=t_s)
        until_s = state.sweep_until_s
        if state.t_s is None or any(self._inside(one.belief.mean) for one in ended.values()):
            until_s = t_s + self.settings.sweep_s
        sweeping = until_s > t_s
        cases, looks, lost = self._cases(known, t_s)
        choices = self._choices(cases, looks, able)
        modes = self._modes(cases, choices, able, sweeping=sweeping)
        watching = self._watches(cases, sweeping=sweeping)
        if watching is not None:
            nodes = watchers(watching, t_s, alive=able.alive)
            modes[nodes] = Mode.SENSING
            trouble += [] if nodes.size else ["no node that lives sees the border"]
        masters = [self._master(*pair, able) for pair in zip(cases, choices, strict=True)]
        modes[[node for node in masters if node >= 0]] = Mode.MASTER
        served = list(zip(cases, choices, masters, strict=True))
        told = Told(
            t_s=t_s,
            modes=modes,
            changed=np.flatnonzero(modes != state.modes).astype(np.int32),
            services=tuple(
                Service(a.name, b.sensors, m, b.trace_m2, a.missed, b.trouble) for a, b, m in served
            ),
            watching=watching is not None,
            sweeping=sweeping,
            late=sum(choice.late for choice in choices),
            handovers=sum(m != case.known.master >= 0 for case, _, m in served),
            lost=lost,
            trouble=tuple(trouble),
        )
        tracks = {
            case.name: case.known._replace(
                asked_s=_asked(case.known, choice, t_s),
                master=node,
                looked=case.name in looks and looks[case.name].whole,
            )
            for case, choice, node in served
        }
        return State(t_s, modes, tracks, until_s), told

    def _able(self, state: State, residual: Vector | None) -> Able:
        """Who lives, who is awake, and who is to be spared."""
        n = len(self.sensors.nodes)
        ready = state.modes >= Mode.ACTIVE
        nobody = np.zeros(n, np.bool_)
        if residual is None:
            return Able(~nobody, ready, nobody, np.ones(n))
        if residual.shape != (n,) or not ((residual >= 0.0) & (residual <= 1.0)).all():
            raise InputError(f"residuals of shape {residual.shape}: expected ({n},) from 0 to 1")
        alive = residual > 0.0
        return Able(alive, ready & alive, nobody, residual, self.settings.energy_weight)

    def _inside(self, mean: Vector) -> bool:
        """Tell whether a track that ended at a state cannot simply have left the region."""
        x_min, y_min, x_max, y_max = self.region
        reach = min(self.sensors.farthest_m, (x_max - x_min) / 4, (y_max - y_min) / 4)
        inner = Region(x_min + reach, y_min + reach, x_max - reach, y_max - reach)
        return bool(inner.contains(mean[:2]))

    def _cases(
        self, known: Mapping[int, Followed], t_s: float
    ) -> tuple[list[_Case], dict[int, Look], tuple[int, ...]]:
        """Tracks to be served, which of them are looked for and how, and which are lost."""
        means, covariances = carried(known.values(), self.motion, t_s=t_s)
        cases = [
            _Case(name, one, means[i], covariances[i], self._missed(one, t_s))
            for i, (name, one) in enumerate(known.items())
        ]
        missed = [case for case in cases if case.doubt >= _SEARCHED]
        wider = [4.0 ** min(case.doubt - _SEARCHED, _WIDEST) for case in missed]
        found = look_for(
            self.sensors,
            np.array([case.place.mean for case in missed]).reshape(-1, 2),
            covariances=np.array(
                [w * case.place.covariance for case, w in zip(missed, wider, strict=True)]
            ).reshape(-1, 2, 2),
            region=self.region,
        )
        looks = {case.name: look for case, look in zip(missed, found, strict=True)}
        lost = {case.name for case in missed if case.known.looked or looks[case.name].gone}
        return [case for case in cases if case.name not in lost], looks, tuple(sorted(lost))

    def _missed(self, one: Followed, t_s: float) -> int:
        """Count intervals, or usual gaps between readings, since sensors were asked in vain."""
        if one.asked_s is None:
            return 0
        pause_s = max(self.settings.interval_s, one.gap_s)
        return math.floor((t_s - one.asked_s) / pause_s + _EARLY)

    def _choices(
        self, cases: Sequence[_Case], looks: Mapping[int, Look], able: Able
    ) -> list[Choice]:
        """Choose sensors track by track; who senses for one is there for all."""
        taken = np.zeros(len(self.sensors.nodes), np.bool_)
        choices: list[Choice] = []
        for case in cases:
            if case.name in looks:
                nodes = looks[case.name].nodes
                nodes = nodes[able.alive[nodes]]
                said = f"missed, or odd, {case.doubt} times: {nodes.size} nodes look for it"
                late = int((~able.ready[nodes]).sum())
                trace = float(np.trace(case.place.covariance))
                choice = Choice(nodes, trace, late, 0.0, (said,))
            else:
                able = able._replace(taken=taken)
                choice = self._choice(case, able)
            taken[choice.sensors] = True
            choices.append(choice)
        return choices

    def _choice(self, case: _Case, able: Able) -> Choice:
        """Choose sensors of a track by the policy; twice as many, and the best, where it is odd."""
        settings, wanted = self.settings, self.settings.sensors
        if case.doubt and settings.policy != "all":
            settings, wanted = replace(settings, policy="accuracy"), 2 * wanted
        return choose(self.sensors, case.place, settings=settings, able=able, wanted=wanted)

    def _modes(
        self, cases: Sequence[_Case], choices: Sequence[Choice], able: Able, *, sweeping: bool
    ) -> NDArray[np.int8]:
        """Modes (n,) of nodes around targets, masters and the border aside."""
        modes = np.zeros(len(self.sensors.nodes), np.int8)
        near = [case for case in cases if case.doubt < _SEARCHED]
        if near:
            spreads = np.array([np.linalg.eigvalsh(case.place.covariance)[-1] for case in near])
            region = region_nodes(
                self.sensors,
                np.array([case.mean for case in near]),
                spreads=np.sqrt(spreads),
                radius_m=max(choice.radius_m for choice in choices),
                settings=self.settings,
            )
            modes[region[able.alive[region]]] = Mode.ACTIVE
        for choice in choices:
            modes[choice.sensors] = Mode.SENSING
        if sweeping:
            modes[able.alive] = Mode.SENSING
        return modes

    def _watches(self, cases: Sequence[_Case], *, sweeping: bool) -> Watch | None:
        """Who may watch the border now, if it is watched."""
        always = self.settings.watch == "always"
        return self.watch if not sweeping and (always or not cases) else None

    def _master(self, case: _Case, choice: Choice, able: Able) -> int:
        """Node that runs the filter: one that senses, near the target, with energy left; or as is.

        Pham 2.4: a master stays unless another costs less by the hysteresis, or it is out of reach.
        """
        old = case.known.master
        nodes = np.append(choice.sensors, old) if old >= 0 else choice.sensors
        if not nodes.size:
            return master.NOBODY
        offsets = self.sensors.nodes.positions[nodes] - case.mean[:2]
        distance = np.hypot(offsets[:, 0], offsets[:, 1])
        far = max(
            self.settings.far * choice.radius_m,
            float(distance[: choice.sensors.size].max(initial=0.0)),
        )
        cost = master.costs(
            np.minimum(distance / max(far, 1e-9), 1.0), able.residual[nodes], alpha=_PLACE
        )
        stays = old >= 0 and bool(able.alive[old]) and bool(distance[-1] <= far)
        chosen = master.choose(
            cost,
            len(nodes) - 1 if old >= 0 else master.NOBODY,
            able=np.append(np.ones(choice.sensors.size, np.bool_), stays)[: len(nodes)],
            may_stay=stays,
            margin=self.settings.hysteresis,
        )
        return master.NOBODY if chosen.node == master.NOBODY else int(nodes[chosen.node])


def _asked(known: Followed, choice: Choice, t_s: float) -> float | None:
    """When sensors were first asked, or missing, without an answer; not where none are needed."""
    if known.asked_s is not None or not (choice.sensors.size or choice.trouble):
        return known.asked_s
    return t_s
