"""Nearest neighbours: every report goes to one track at most, and counters decide what is a track.

The baselines: global (GNN: the best pairs of a whole scan) and greedy. One explanation and no
probabilities: fast, and easily misled. The mixture of `bernoulli` is the default.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackfield.association import nearest_state, rewind
from trackfield.association.contract import (
    Alternative,
    Estimates,
    Explanation,
    Info,
    ReportScan,
)
from trackfield.association.intake import Intake, take_in
from trackfield.association.model import Scene
from trackfield.association.nearest_state import Held, NearestState
from trackfield.association.nearest_step import NearestSettings, advance, motion, told_sigma_m
from trackfield.errors import ConfigurationError, InputError
from trackfield.filtering import kalman
from trackfield.filtering.smoothing import Passed, back
from trackfield.types import Gaussian


class Nearest:
    """An `Associator` that follows the nearest report.

    `existence` of its estimates is a counter, no probability: the share of a track's last
    `confirm_steps` steps (of its life, if shorter) that brought a report. Shown is a confirmed
    track inside the region. A track is numbered by its first report.
    """

    def __init__(self, scene: Scene, settings: NearestSettings = NearestSettings()) -> None:  # noqa: B008 - an immutable value
        found = _problems(scene, settings)
        if found:
            raise ConfigurationError(found)
        self.scene, self.settings = scene, settings

    def initial(self) -> NearestState:
        """Make the state before the first scan."""
        return rewind.Window((), nearest_state.no_tracks(self.settings.confirm_steps))

    def step(
        self, state: NearestState, scan: ReportScan, late: Sequence[ReportScan] = ()
    ) -> tuple[NearestState, Info]:
        """Take the next scan, and reports of earlier ones.

        Late reports are added to the scan of exactly their time, and all since is done again;
        those older than the window are dropped and counted. `InputError` for a scan that is not
        newer than all before it, and for numbers that no report can have.
        """
        sigma_m, region = told_sigma_m(self.scene), self.scene.reporting.region
        taken = take_in(scan, region, sigma_m=sigma_m)
        parts: list[Intake] = []
        for added in late:
            known = [kept.scan for kept in state.kept] + [part.scan for part in parts]
            places = [one.position for one in known if one.t_s == added.t_s]
            here = np.concatenate([np.empty((0, 2)), *places])
            parts.append(take_in(added, region, sigma_m=sigma_m, known=here))
        moved = rewind.advance(
            state,
            taken.scan,
            lambda held, one, _: advance(held, one, self.scene, self.settings),
            late=[part.scan for part in parts],
            length=self.settings.window_steps,
        )
        newest = moved.window.state
        counts = {
            "outside": taken.outside + sum(part.outside for part in parts),
            "duplicate": taken.duplicate + sum(part.duplicate for part in parts),
            "late": moved.dropped,
            "replayed": moved.replayed,
            "crowded_out": newest.crowded,
        }
        return moved.window, Info(counts, {}, newest.pairs)

    def estimates(self, state: NearestState, lag_steps: int = 0) -> Estimates:
        """Tell what is held after the newest scan, or in hindsight of `lag_steps` before it.

        Hindsight smooths (Rauch, Tung, Striebel), knows which tracks were confirmed later, and
        hides those that had ended already. Empty while there are not so many scans. `InputError`
        for a lag beyond `window_steps`.
        """
        if not 0 <= lag_steps <= self.settings.window_steps:
            raise InputError(
                f"a lag of 0 to {self.settings.window_steps} steps expected, found {lag_steps}"
            )
        states = [*(kept.before for kept in state.kept[1:]), state.state]
        if lag_steps >= len(states):
            return self._told(nearest_state.no_tracks(self.settings.confirm_steps))
        return self._told(self._smoothed(states[len(states) - 1 - lag_steps :]))

    def explain(self, state: NearestState, track: int) -> Explanation | None:
        """Say why a track is there: its only explanation; None where there is no such track."""
        held = state.state
        for place in np.flatnonzero(held.track == track):
            reports = tuple(held.recent[place].tolist())
            existence, first_s = float(_existence(held)[place]), float(held.first_s[place])
            return Explanation(track, existence, first_s, (Alternative(1.0, reports),))
        return None

    def encode(self, state: NearestState) -> bytes:
        """Write a state as bytes: arrays of NumPy without pickle."""
        return nearest_state.encode(state)

    def decode(self, data: bytes) -> NearestState:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        return nearest_state.decode(data, self.settings.confirm_steps)

    def _told(self, held: Held) -> Estimates:
        return Estimates(
            t_s=held.t_s if held.t_s > -np.inf else 0.0,
            track=held.track,
            existence=_existence(held),
            mean=held.mean,
            covariance=held.covariance,
            first_s=held.first_s,
            detected=held.missed == 0,
            shown=held.confirmed & self.scene.reporting.region.contains(held.mean[:, :2]),
        )

    def _smoothed(self, states: Sequence[Held]) -> Held:
        """Smooth the first of consecutive states, given all of them.

        Confirmed are then tracks that ever are, and bring a report at that step or later.
        """
        later = states[-1]
        if len(states) > 1:
            later = later._replace(confirmed=later.confirmed & (later.missed == 0))
        for held in reversed(states[:-1]):
            i, j = np.intersect1d(held.track, later.track, return_indices=True)[1:]
            dt_s = later.t_s - held.t_s
            F, Q = motion(self.scene.targets, self.scene.reporting.step_s, dt_s=dt_s)
            posterior = Gaussian(held.mean[i], held.covariance[i])
            passed = Passed(posterior, F, kalman.predict(posterior, F, Q))
            smoothed = back(Gaussian(later.mean[j], later.covariance[j]), passed)
            mean, covariance = held.mean.copy(), held.covariance.copy()
            mean[i], covariance[i] = smoothed
            confirmed = held.confirmed & (held.missed == 0)
            confirmed[i] |= later.confirmed[j]
            later = held._replace(mean=mean, covariance=covariance, confirmed=confirmed)
        return later


def _existence(held: Held) -> NDArray[np.float64]:
    steps = np.minimum(held.age + 1, held.recent.shape[1])
    return np.count_nonzero(held.recent >= 0, axis=1) / steps


def _problems(scene: Scene, settings: NearestSettings) -> list[str]:
    """Say what of a scene or of settings cannot be used, one line each."""
    targets, reporting = scene.targets, scene.reporting
    region, sigma_m = reporting.region, reporting.sigma_m
    accel, velocity = targets.accel_sigma_m_s2, targets.velocity_sigma_m_s
    rules = [
        (region.x_max > region.x_min and region.y_max > region.y_min, "region", region),
        (0 < reporting.step_s < math.inf, "step_s", reporting.step_s),
        (sigma_m is None or 0 < sigma_m < math.inf, "sigma_m", sigma_m),
        (0 <= accel < math.inf, "accel_sigma_m_s2", accel),
        (0 < velocity < math.inf, "velocity_sigma_m_s", velocity),
        (settings.pairing in ("optimal", "greedy"), "pairing", settings.pairing),
        (0 < settings.gate_d2 < math.inf, "gate_d2", settings.gate_d2),
        (
            1 <= settings.confirm_hits <= settings.confirm_steps,
            "confirm_hits",
            settings.confirm_hits,
        ),
        (settings.drop_misses >= 1, "drop_misses", settings.drop_misses),
        (settings.drop_tentative >= 1, "drop_tentative", settings.drop_tentative),
        (settings.window_steps >= 0, "window_steps", settings.window_steps),
        (settings.max_tracks >= 1, "max_tracks", settings.max_tracks),
    ]
    return [f"{name}: outside its domain, found {found}" for good, name, found in rules if not good]
