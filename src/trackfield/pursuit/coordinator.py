"""Tracks in, orders out: who chases whom, and what each pursuer does in the next step.

Oh, III.C and IV.C: times to capture, the assignment whose last capture comes soonest, robust
steering. Tracks may be false, split, merged, swapped or gone: whoever has none to chase takes the
next one or holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackfield.errors import InputError
from trackfield.pursuit import separation
from trackfield.pursuit.assignment import Chase, assign, double, keep
from trackfield.pursuit.coordinator_state import NOBODY, Orders, Quarry, State, learned
from trackfield.pursuit.detours import delayed, leg
from trackfield.pursuit.separation import Body, Fleet
from trackfield.pursuit.settings import PursuitSettings
from trackfield.pursuit.vehicles import Aims, Thruster, Vehicle
from trackfield.robot.obstacles import Obstacles
from trackfield.types import Indices, Matrix, Tracks, Vector

_ROOM = 1.25  # times the clearance: so far from obstacles are ways around them planned
_ASTRAY = 1e-6  # [m], [m/s]: rounding, beside the tube in which a pursuer follows


class _Field(NamedTuple):
    """Tracks that are chased, in order of their numbers: states (e, 4) and variances now."""

    names: tuple[int, ...]
    state: Matrix
    variance: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class Coordinator:
    """Coordination of pursuers of one kind; states are values, a step makes a new one.

    With a `body`, pursuers have thrust and keep clear of each other and of obstacles, as
    `pursuit.separation` proves; other vehicles go around obstacles without that promise. Ways are
    planned around `planned` obstacles, `clearance` tells how far the real ones are.
    """

    vehicle: Vehicle
    settings: PursuitSettings
    body: Body | None
    planned: Obstacles
    clearance: separation.Clearance | None

    def initial(self) -> State:
        """Make the state before the first step."""
        return State({}, (), {}, None)

    def step(
        self,
        state: State,
        t_s: float,
        *,
        tracks: Tracks,
        pursuers: Matrix,
        dismissed: Iterable[int] = (),
    ) -> tuple[State, Orders]:
        """Order pursuers (p, width) for the step from `t_s` on, knowing rows of tracks up to then.

        A pursuer whose state is not finite holds. The evaders of `dismissed` tracks are caught:
        these are not chased for `forget_s`; who is shown longer is somebody else. `InputError` for
        a time that is not finite, for states of another shape, and for a first state of a pursuer
        with a body that is unknown.
        """
        if not math.isfinite(t_s):
            raise InputError(f"found orders for {t_s} s, expected a finite time")
        here = self._checked(pursuers, state)
        field, state, trouble = self._learn(state, tracks, t_s, dismissed)
        fleet, said = self._fleet(state, here)
        trouble += said
        present = np.asarray(np.isfinite(here).all(axis=1), np.bool_)
        places = here if fleet is None else np.hstack(fleet)
        places = np.where(present[:, None], places, 0.0) if fleet is None else places
        costs = np.full((len(here), len(field.names)), np.inf)
        if costs.size:
            costs = delayed(
                self.vehicle.times(places, field.state), places[:, :2], field.state, self.planned
            )
            costs[~present] = np.inf
        chase = self._chase(costs, state.chased, field.names)
        evader = double(costs, chase) if self.settings.double else chase.evader
        wanted = self.vehicle.commands(
            places, self._aims(places, evader, costs, field), step_s=self.settings.step_s
        )
        braked = np.zeros(len(here), np.bool_)
        if fleet is not None and self.body is not None and len(here):
            moved = separation.move(
                fleet,
                wanted,
                self.body,
                step_s=self.settings.step_s,
                actual=Fleet(*np.split(np.where(present[:, None], here, places), 2, axis=1)),
                clearance=self.clearance,
            )
            wanted, fleet, braked = moved.thrust_m_s2, moved.fleet, moved.braked
        orders = _orders(t_s, wanted, evader, costs, field)
        columns: list[int] = chase.evader.tolist()
        names = [field.names[j] if j >= 0 else NOBODY for j in columns]
        orders = orders._replace(braked=braked, trouble=tuple(trouble))
        return state._replace(chased=tuple(names), fleet=fleet), orders

    def _checked(self, pursuers: ArrayLike, state: State) -> Matrix:
        here = np.asarray(pursuers, np.float64)
        if here.ndim != 2 or here.shape[1] != self.vehicle.width:
            raise InputError(
                f"pursuers of shape {here.shape}: expected states (p, {self.vehicle.width})"
            )
        known = state.fleet is not None and len(state.fleet.position) == len(here)
        lost = np.flatnonzero(~np.isfinite(here).all(axis=1))
        if self.body is not None and not known and lost.size:
            raise InputError(
                f"pursuer {lost[0]}: found a first state that is not finite, expected one "
                "from which it can be told whether it keeps clear"
            )
        return here

    def _learn(
        self, state: State, tracks: Tracks, t_s: float, dismissed: Iterable[int]
    ) -> tuple[_Field, State, list[str]]:
        """Take what tracks say; carry those that may be chased on to `t_s`."""
        own = self.settings
        density = own.evader_accel_m_s2**2 * own.step_s
        known, trouble = learned(state.quarries, tracks, until_s=t_s, density=density)
        quarries = {name: q for name, q in known.items() if t_s - q.t_s <= own.forget_s}
        trouble += [
            f"track {name}: found nothing for {t_s - q.t_s:.3g} s, and gave it up"
            for name, q in known.items()
            if name not in quarries
        ]
        until = {**state.dismissed, **dict.fromkeys(dismissed, t_s + own.forget_s)}
        over = {name: end for name, end in until.items() if name in quarries and t_s < end}
        names = tuple(sorted(name for name in quarries if name not in over))
        found, variance = _carried([quarries[name] for name in names], density, t_s)
        sigma = np.sqrt(variance[:, :2].max(axis=1, initial=0.0))
        good = (sigma <= own.most_sigma_m) & np.isfinite(found).all(axis=1)
        trouble += [
            f"track {names[i]}: known to {sigma[i]:.3g} m only, and not chased"
            for i in np.flatnonzero(~good)
        ]
        field = _Field(tuple(names[i] for i in np.flatnonzero(good)), found[good], variance[good])
        return field, state._replace(quarries=quarries, dismissed=over), trouble

    def _fleet(self, state: State, here: Matrix) -> tuple[Fleet | None, list[str]]:
        """Say where pursuers with a body should be; those that are elsewhere start anew."""
        if self.body is None:
            return None, []
        step_s, error = self.settings.step_s, self.body.error_m_s2
        if state.fleet is None or len(state.fleet.position) != len(here):
            fleet = Fleet(here[:, :2].copy(), here[:, 2:].copy())
            try:
                separation.check_start(fleet, self.body, step_s=step_s, clearance=self.clearance)
            except InputError as problem:
                return fleet, [str(problem)]
            return fleet, []
        nominal = np.hstack(state.fleet)
        tube = np.array([step_s**2, step_s**2, 2.0 * step_s, 2.0 * step_s]) * error + _ASTRAY
        astray = (np.abs(here - nominal) > tube * (1.0 + 1e-9)).any(axis=1)  # not if it is unknown
        nominal[astray] = here[astray]
        lost = np.flatnonzero(~np.isfinite(here).all(axis=1))
        said = [
            f"pursuer {i}: found it off its way, and cannot tell whether it keeps clear"
            for i in np.flatnonzero(astray)
        ]
        said += [f"pursuer {i}: found no state of it, and lets it brake" for i in lost]
        return Fleet(nominal[:, :2], nominal[:, 2:]), said

    def _chase(self, costs: Matrix, chased: Sequence[int], names: tuple[int, ...]) -> Chase:
        fresh = assign(costs, self.settings.objective)
        column = {name: j for j, name in enumerate(names)}
        before = np.array([column.get(name, NOBODY) for name in chased], np.int32)
        return keep(costs, before, fresh, margin=self.settings.margin)

    def _aims(self, places: Matrix, evader: Indices, costs: Matrix, field: _Field) -> Aims:
        """Aim at evaders in doubt, or at the corner of the way around that comes first."""
        own, n = self.settings, len(places)
        aims = Aims(np.full((n, 4), np.nan), np.zeros((n, 4)), np.zeros(n))
        busy = np.flatnonzero(evader >= 0)
        chased = evader[busy]
        aims.state[busy] = field.state[chased]
        aims.doubt[busy] = own.doubt_sigmas * np.sqrt(field.variance[chased])
        aims.thrust_m_s2[busy] = 2.0 * own.evader_accel_m_s2
        if not self.planned.parts:
            return aims
        pace, top = 0.5, np.inf
        if self.body is not None:
            pace, top = 0.5 * self.body.reserve_m_s2, self.body.speed_m_s
        for i, j in zip(busy.tolist(), chased.tolist(), strict=True):
            aim = leg(places[i, :2], field.state[j], float(costs[i, j]), self.planned, pace)
            if (aim != field.state[j]).any():  # a corner: it is where it is
                aims.state[i] = np.append(aim[:2], np.clip(aim[2:], -top, top))
                aims.doubt[i], aims.thrust_m_s2[i] = 0.0, 0.0
        return aims


def coordinator(
    vehicle: Vehicle | Body,
    settings: PursuitSettings | None = None,
    *,
    polygons: Sequence[ArrayLike] = (),
) -> Coordinator:
    """Make a coordinator of pursuers that move as `vehicle`s, or have a `Body` that keeps clear.

    `polygons` (m, 2) [m] each are obstacles; `InputError` for what is no polygon.
    """
    own = PursuitSettings() if settings is None else settings
    body = vehicle if isinstance(vehicle, Body) else None
    margin = 0.0 if body is None else _ROOM * body.clear_m + 2.0 * own.step_s**2 * body.error_m_s2
    real = Obstacles(polygons)
    return Coordinator(
        Thruster(vehicle.reserve_m_s2, vehicle.speed_m_s) if isinstance(vehicle, Body) else vehicle,
        own,
        body,
        Obstacles(polygons, margin_m=margin),
        real.distance if real.parts else None,
    )


def _carried(quarries: Sequence[Quarry], density: float, t_s: float) -> tuple[Matrix, Matrix]:
    """States (e, 4) and variances (e, 4) at `t_s`, at constant velocity but for white noise."""
    mean = np.array([q.mean for q in quarries]).reshape(-1, 4)
    variance = np.array([q.variance for q in quarries]).reshape(-1, 4)
    dt = np.array([max(t_s - q.t_s, 0.0) for q in quarries]).reshape(-1, 1)
    place = mean[:, :2] + dt * mean[:, 2:]
    wide = variance[:, :2] + dt**2 * variance[:, 2:] + density * dt**3 / 3.0
    return np.hstack([place, mean[:, 2:]]), np.hstack([wide, variance[:, 2:] + density * dt])


def _orders(t_s: float, commands: Matrix, evader: Indices, costs: Matrix, field: _Field) -> Orders:
    n = len(commands)
    track = np.full(n, NOBODY, np.int32)
    here, meeting, expected = np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.full(n, np.inf)
    busy: NDArray[np.intp] = np.flatnonzero(evader >= 0)
    chased = evader[busy]
    track[busy] = np.array(field.names, np.int32)[chased] if busy.size else NOBODY
    expected[busy] = costs[busy, chased]
    time: Vector = expected[busy][:, None]
    here[busy] = field.state[chased, :2]
    meeting[busy] = here[busy] + time * field.state[chased, 2:]
    lost = np.isinf(costs).all(axis=0) & (n > 0)
    idle = ~lost & ~np.isin(np.arange(len(field.names)), chased)
    return Orders(
        t_s,
        commands,
        track,
        here,
        meeting,
        expected,
        np.zeros(n, np.bool_),
        tuple(field.names[j] for j in np.flatnonzero(lost)),
        tuple(field.names[j] for j in np.flatnonzero(idle)),
        (),
    )
