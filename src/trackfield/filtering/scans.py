"""What a filter of one tagged target is, so that one operator serves filters of any readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeVar

from trackfield.types import Indices, Status, Vector

State = TypeVar("State")


class Scan(NamedTuple):
    """All readings of one target at one time, (m,) each.

    `sensor` counts in the site; `sigma` is NaN where a reading brings none of its own.
    """

    t_s: float
    sensor: Indices
    value: Vector
    sigma: Vector


class Shown(NamedTuple):
    """What is shown of a target at one time, SI units.

    `position` (3,), z NaN where unknown; `velocity` (3,); `covariance` (3,) holds xx, xy, yy of the
    position; `nis` is the normalised innovation squared per reading, NaN without an update.
    """

    t_s: float
    position: Vector
    velocity: Vector
    covariance: Vector
    status: Status
    nis: float


class ScanFilter(Protocol[State]):
    """A filter of one target. `State` is an immutable value: an operator keeps and replays it."""

    def start(self) -> State:
        """Return the state of a target of which nothing was heard."""
        ...

    def step(self, state: State, scan: Scan) -> State:
        """Condition on a scan no earlier than the last one."""
        ...

    def shown(self, state: State, t_s: float) -> Shown | None:
        """Carry the belief to `t_s`, at or after the last scan; None before a track has started.

        A status of `ENDED` says that the track is given up; the next one is another track.
        """
        ...

    def hindsight(self, states: Sequence[State]) -> Shown | None:
        """Estimate the target at the time of `states[0]`, knowing all of these successive states.

        As `shown` of the first where that is all there is.
        """
        ...

    def pack(self, state: State) -> bytes:
        """Bytes that `unpack` makes the very same state of; not pickle."""
        ...

    def unpack(self, data: bytes) -> State:
        """Return the state that was packed; `StateError` for other bytes."""
        ...
