"""Trajectories that were found, as they are told besides the rows of tracks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from trackfield.pipeline.live_passes import LivePass
from trackfield.types import Matrix, Vector


class Trajectory(NamedTuple):
    """One trajectory that was found: the tracks' numbers as in the rows, and what is known of it.

    `power` is the source's at 1 m; `position` (2,) [m] is where it is at `t_s`, `velocity` (2,)
    [m/s]; `covariance` (5, 5) is of power, position and velocity. `weight` is the probability that
    it is this one of those that explain what was heard by `sensors`; `reason` says why others are
    to be thought of, or that there are none. `by_samples`: all samples were used.
    """

    track: int
    target_id: str | None
    t_s: float
    power: float
    position: Vector
    velocity: Vector
    covariance: Matrix
    weight: float
    sensors: tuple[str, ...]
    verdict: str
    reason: str
    by_samples: bool

    def to_dict(self) -> dict[str, object]:
        """Give everything as plain objects."""
        plain = self._asdict()
        for name in ("position", "velocity", "covariance"):
            plain[name] = plain[name].tolist()
        return {**plain, "sensors": list(self.sensors)}


def trajectories_of(
    passes: Iterable[LivePass],
    target_id: str | None,
    *,
    tracks: Callable[[int], int],
    sensor_ids: tuple[str, ...],
) -> Iterator[Trajectory]:
    """Tell the trajectories of passes of one name; `tracks` numbers their tracks as the rows do."""
    for one in passes:
        belief = one.belief
        sensors = tuple(sensor_ids[number] for number in sorted({key[0] for key in one.keys}))
        for track, mode in zip(one.tracks, belief.modes, strict=True):
            yield Trajectory(
                tracks(track),
                target_id,
                belief.start_s,
                float(mode.theta[0]),
                mode.theta[1:3],
                mode.theta[3:5],
                mode.covariance,
                mode.weight,
                sensors,
                belief.verdict.name.lower(),
                belief.reason,
                belief.by_samples,
            )
