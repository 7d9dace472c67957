"""The one interface of all trackers of unknown targets: scans of reports in, estimates out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Matrix, Vector

State = TypeVar("State")


class ReportScan(NamedTuple):
    """All reports of one step: `position` (n, 2) [m], `covariance` (n, 3) xx, xy, yy [m^2].

    A covariance of NaN is unknown: the scene's `sigma_m`, or the learned one, holds. `number` (n,)
    numbers the reports through the whole run, so that a track can say which ones are its own.
    """

    t_s: float
    position: Matrix
    covariance: Matrix
    number: Indices


class Estimates(NamedTuple):
    """What a tracker believes of time `t_s`; one entry a possible target, all (n, ...).

    `track` is an identity, counted from 1 and never used again; `existence` the probability that
    the target is there; `mean` (n, 4) x, y, vx, vy and `covariance` (n, 4, 4); `first_s` when it
    was first seen; `detected` whether the likeliest explanation gives it a report at `t_s`; `shown`
    whether it is worth showing.
    """

    t_s: float
    track: Indices
    existence: Vector
    mean: Matrix
    covariance: NDArray[np.float64]
    first_s: Vector
    detected: NDArray[np.bool_]
    shown: NDArray[np.bool_]


class Alternative(NamedTuple):
    """One explanation of a track: its probability, and the reports (numbers) of its last steps."""

    probability: float
    reports: tuple[int, ...]  # -1: not detected in that step; the newest last


class Explanation(NamedTuple):
    """Why a track is there: how surely, since when, and by which reports, likeliest first."""

    track: int
    existence: float
    first_s: float
    alternatives: tuple[Alternative, ...]


class Info(NamedTuple):
    """What happened in a step, for diagnostics.

    `counts` names what was counted (late reports dropped, clusters degraded, ...); `learned` what
    is believed now of quantities that the scene leaves open; `work` is the work done in units of
    the tracker's own budget.
    """

    counts: dict[str, int]
    learned: dict[str, float]
    work: int


class Associator(Protocol[State]):
    """A tracker of unknown targets. States are values: a step makes a new one."""

    def initial(self) -> State:
        """Make the state before the first scan."""
        ...

    def step(
        self, state: State, scan: ReportScan, late: Sequence[ReportScan] = ()
    ) -> tuple[State, Info]:
        """Take the next scan, and reports that belong to earlier ones.

        `late` scans are added to those of their times, as far as the tracker's window reaches; what
        is older is dropped and counted.
        """
        ...

    def estimates(self, state: State, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight of `lag_steps` before it."""
        ...

    def explain(self, state: State, track: int) -> Explanation | None:
        """Say why a track is there; None where no track has this identity now."""
        ...

    def encode(self, state: State) -> bytes:
        """Write a state as bytes, versioned, not pickle."""
        ...

    def decode(self, data: bytes) -> State:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        ...


AnyAssociator = Associator[Any]
