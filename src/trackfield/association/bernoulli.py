"""The default tracker of unknown targets: a Poisson multi-Bernoulli mixture with late reports.

Each possible target has an existence probability, and a Gaussian for each of its histories (which
report in which scan); targets that may have met the same reports are decided on together, by exact
enumeration of the joint explanations while they are few, by belief propagation when they are many.
Every report starts a possible target; targets never seen are a Poisson density. Williams (2015),
Garcia-Fernandez et al. (2018). The arithmetic is compiled (`trackfield._core`).
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _bernoulli as kernel
from trackfield.association import rewind
from trackfield.association.bernoulli_settings import (
    BernoulliSettings,
    first_sigma_m,
    kernel_model,
)
from trackfield.association.contract import (
    Alternative,
    Estimates,
    Explanation,
    Info,
    ReportScan,
)
from trackfield.association.intake import Intake, take_in
from trackfield.association.model import Scene
from trackfield.errors import InputError, StateError
from trackfield.raster import Raster
from trackfield.types import Arrays, Matrix, Vector

_VERSION = 2
_ARRIVED = 0.995  # share of reports after which a scan counts as complete
_ALTERNATIVES = 10
_LEAST = 1e-9
_ALL = np.ones(1)
_NO_PLACES = np.zeros((0, 2))
_COUNTED = ("enumerated", "propagated", "burst", "crowded_out")


class BernoulliState(NamedTuple):
    """The scans of the window with the states between them, and when reports came.

    `names` are the identities that are told; `arrivals` (ages,) counts reports by the age of their
    scan, `waited` (ages,) the scans that have reached that age.
    """

    window: rewind.Window[kernel.State]
    names: kernel.Names
    arrivals: Vector
    waited: Vector


class Bernoulli:
    """An `Associator` that keeps a mixture of joint explanations, and existence probabilities."""

    def __init__(self, scene: Scene, settings: BernoulliSettings = BernoulliSettings()) -> None:  # noqa: B008 - an immutable value
        self.scene, self.settings = scene, settings
        self._kernel = kernel.Model(kernel_model(scene, settings))
        self._sigma_m = first_sigma_m(scene)
        ages = scene.reporting.p_detection or ()
        means = np.array([p.mean() if isinstance(p, Raster) else float(p) for p in ages])
        self._told = means / max(means[-1], _LEAST) if len(ages) > 1 else None

    def initial(self) -> BernoulliState:
        """Make the state before the first scan."""
        ages = self.settings.window_steps + 1
        arrivals, waited = np.zeros(ages), np.zeros(ages)
        arrivals[0] = waited[0] = 1.0
        return BernoulliState(rewind.Window((), kernel.State()), kernel.Names(), arrivals, waited)

    def step(
        self, state: BernoulliState, scan: ReportScan, late: Sequence[ReportScan] = ()
    ) -> tuple[BernoulliState, Info]:
        """Take the next scan, and reports of earlier ones.

        Late reports are added to the scan of exactly their time, and all since is reconsidered;
        those older than the window are dropped and counted. `InputError` for a scan that is not
        newer than all before it, and for numbers that no report can have.
        """
        taken = take_in(scan, self.scene.reporting.region, sigma_m=self._sigma_m)
        parts = self._late(state, late)
        share = self._share(state)

        def replay(before: kernel.State, one: ReportScan, age: int) -> kernel.State:
            arrived = float(share[min(age, len(share) - 1)])
            return self._kernel.step(
                before, one.t_s, one.position, one.covariance, one.number, age, arrived
            )

        moved = rewind.advance(
            state.window,
            taken.scan,
            replay,
            late=[part.scan for part in parts],
            length=self.settings.window_steps,
            unsettled=int(np.searchsorted(share, _ARRIVED)),
        )
        arrivals, waited = state.arrivals.copy(), state.waited.copy()
        arrivals[0] += len(taken.scan.number)
        arrivals += moved.late_by_age
        waited[: len(state.window.kept) + 1] += 1.0
        told = moved.window.state.told()
        counts = {
            **{name: int(told[name]) for name in _COUNTED},
            "outside": taken.outside + sum(part.outside for part in parts),
            "duplicate": taken.duplicate + sum(part.duplicate for part in parts),
            "late": moved.dropped,
            "replayed": moved.replayed,
        }
        info = Info(counts, self._learned(told), int(told["work"]))
        names = self._kernel.renamed(moved.window.state, state.names, moved.replayed)
        return BernoulliState(moved.window, names, arrivals, waited), info

    def estimates(self, state: BernoulliState, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight of `lag_steps` before it.

        Hindsight smooths along each history (Rauch, Tung, Striebel), existence included. Empty
        while there are not so many scans. `InputError` for a lag beyond `history_steps`.
        """
        if not 0 <= lag_steps <= self.settings.history_steps:
            raise InputError(
                f"a lag of 0 to {self.settings.history_steps} steps expected, found {lag_steps}"
            )
        inner = state.window.state
        if lag_steps >= inner.scans():
            return _estimates(0.0, np.zeros((0, 22)), np.zeros((0, 3), dtype=np.int32))
        return _estimates(*self._kernel.estimates(inner, state.names, lag_steps))

    def explain(self, state: BernoulliState, track: int) -> Explanation | None:
        """Say why a track is there: its likeliest histories; None where there is no such track."""
        found = kernel.explain(state.window.state, state.names, track)
        if found is None:
            return None
        existence, first_s, histories = found
        ranked = sorted(histories, key=lambda history: -history[0])[:_ALTERNATIVES]
        alternatives = tuple(Alternative(p, tuple(reports[::-1])) for p, reports in ranked)
        return Explanation(track, existence, first_s, alternatives)

    def encode(self, state: BernoulliState) -> bytes:
        """Write a state as bytes: arrays of NumPy without pickle."""
        kept = state.window.kept
        inner = kernel.encode([*(k.before for k in kept), state.window.state], state.names)
        numbers = [k.scan.number for k in kept]
        file = io.BytesIO()
        np.savez(
            file,
            version=np.array(_VERSION),
            arrivals=state.arrivals,
            waited=state.waited,
            t_s=np.array([k.scan.t_s for k in kept]),
            sizes=np.array([len(n) for n in numbers], dtype=np.int64),
            position=np.concatenate([np.zeros((0, 2)), *(k.scan.position for k in kept)]),
            covariance=np.concatenate([np.zeros((0, 3)), *(k.scan.covariance for k in kept)]),
            number=np.concatenate([np.zeros(0, dtype=np.int32), *numbers]),
            kernel=np.frombuffer(inner, dtype=np.uint8),
        )
        return file.getvalue()

    def decode(self, data: bytes) -> BernoulliState:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as file:
                columns = {name: file[name] for name in file.files}
            if int(columns["version"]) != _VERSION:
                raise StateError(f"version {_VERSION} expected, found {columns['version']}")
            states, names = kernel.decode(columns["kernel"].tobytes())
            for inner in states:
                self._kernel.check(inner)
            *before, newest = states
            kept = tuple(
                rewind.Kept(b, scan) for b, scan in zip(before, _scans(columns), strict=True)
            )
        except (KeyError, ValueError, RuntimeError, EOFError, OSError, zipfile.BadZipFile) as error:
            raise StateError(f"not a state of this tracker: {error}") from error
        return BernoulliState(
            rewind.Window(kept, newest), names, columns["arrivals"], columns["waited"]
        )

    def _late(self, state: BernoulliState, late: Sequence[ReportScan]) -> list[Intake]:
        parts: list[Intake] = []
        for added in late:
            known = [kept.scan.position for kept in state.window.kept if kept.scan.t_s == added.t_s]
            known += [part.scan.position for part in parts if part.scan.t_s == added.t_s]
            places = np.concatenate([_NO_PLACES, *known])
            region = self.scene.reporting.region
            parts.append(take_in(added, region, sigma_m=self._sigma_m, known=places))
        return parts

    def _share(self, state: BernoulliState) -> Vector:
        """Share of reports that have arrived, by age: told, or as they came so far."""
        if self._told is not None:
            return self._told
        if not state.arrivals[1:].any():
            return _ALL
        rate = state.arrivals / np.maximum(state.waited, 1.0)
        return np.cumsum(rate) / rate.sum()

    def _learned(self, told: dict[str, float]) -> dict[str, float]:
        reporting = self.scene.reporting
        left_open = {
            "sigma_m": (reporting.sigma_m, "sigma"),
            "p_detection": (reporting.p_detection, "p_detection"),
            "false_per_scan": (reporting.false_per_scan, "false_per_scan"),
        }
        learned = {name: told[key] for name, (given, key) in left_open.items() if given is None}
        if self.scene.targets.births_per_s is None:
            learned["births_per_s"] = told["births"] / reporting.step_s
        return learned


def _scans(columns: Arrays) -> list[ReportScan]:
    ends = np.cumsum(columns["sizes"])
    position, covariance, number = (columns[name] for name in ("position", "covariance", "number"))
    return [
        ReportScan(
            float(t_s),
            position[end - size : end],
            covariance[end - size : end],
            number[end - size : end],
        )
        for t_s, end, size in zip(columns["t_s"], ends, columns["sizes"], strict=True)
    ]


def _estimates(t_s: float, numbers: Matrix, names: NDArray[np.int32]) -> Estimates:
    return Estimates(
        t_s=t_s,
        track=np.ascontiguousarray(names[:, 0]),
        existence=numbers[:, 1],
        mean=numbers[:, 2:6],
        covariance=numbers[:, 6:].reshape(-1, 4, 4),
        first_s=numbers[:, 0],
        detected=names[:, 1] != 0,
        shown=names[:, 2] != 0,
    )
