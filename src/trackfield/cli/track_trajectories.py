"""Trajectories of passes on the command line: what a run of amplitudes or messages came to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.cli.runs import Lag
    from trackfield.network.timing import Timing
    from trackfield.pipeline.trajectories import Trajectory, TrajectoryTracker
    from trackfield.plotting.tagged import Course

_SURE = 0.9995  # weight of a trajectory beside which there is no other
_SATURATION = "saturation: they count as at least so much; is it too low?"
_LISTED = 8  # sensors, at most, that a line names


def every(tracker: TrajectoryTracker) -> tuple[Trajectory, ...]:
    """Trajectories of the run, those that are over and the last ones, in order of their tracks."""
    return tuple(sorted([*tracker.ended, *tracker.trajectories], key=lambda one: one.track))


def numbers(found: Sequence[Trajectory]) -> dict[str, Any]:
    """Give the trajectories as plain objects, for `--json`."""
    return {"trajectories": [one.to_dict() for one in found]}


def told(found: Sequence[Trajectory]) -> list[str]:
    """Say of each trajectory who passed, where and how fast, with a standard deviation each."""
    return [line for one in found for line in _lines(one)]


def courses(found: Sequence[Trajectory], timing: Timing) -> list[Course]:
    """Where trajectories lie from the first to the last time of a run."""
    from trackfield.plotting.tagged import Course

    span = timing.first_s, timing.last_s
    return [
        Course(
            np.stack([one.position + (t_s - one.t_s) * one.velocity for t_s in span]), one.weight
        )
        for one in found
    ]


def doubts(tracker: TrajectoryTracker) -> list[str]:
    """Say what keeps the answer from being the only one."""
    found = tracker.trajectories
    several = [one for one in found if one.weight < _SURE]
    said = [f"{len(several)} trajectories explain what was heard"] if several else []
    said += [
        f"trajectory {one.track}: {one.reason}"
        for one in found
        if one.weight >= _SURE and one.verdict != "good"
    ]
    lost, above = tracker.counts["unexplained"], tracker.counts["saturated"]
    said += [f"{lost} messages fit no trajectory"] if lost else []
    return said + ([f"{above} samples are above their model's {_SATURATION}"] if above else [])


def require_seconds(lag: Lag) -> None:
    """Raise `ConfigurationError` for a lag in updates, which passes do not have."""
    if lag.steps:
        expected = "seconds (2 or 2s): trajectories of passes have no updates"
        raise ConfigurationError([f"--lag: found '{lag.steps}steps', expected {expected}"])


def _lines(one: Trajectory) -> list[str]:
    sigma = np.sqrt(np.maximum(np.diag(one.covariance), 0.0))
    (x, y), (vx, vy) = one.position.tolist(), one.velocity.tolist()
    whose = "" if one.target_id is None else f" of {one.target_id}"
    share = f", {one.weight:.0%}" if one.weight < _SURE else ""
    level = math.sqrt(one.power)
    heading = math.degrees(math.atan2(vy, vx))
    heard = ", ".join(one.sensors[:_LISTED]) + (", ..." if len(one.sensors) > _LISTED else "")
    return [
        f"trajectory {one.track}{whose}{share}: {one.reason}",
        f"  at {one.t_s:.4g} s in ({_measured(x, sigma[1])}, {_measured(y, sigma[2])}) m",
        f"  going ({_measured(vx, sigma[3])}, {_measured(vy, sigma[4])}) m/s: "
        f"{math.hypot(vx, vy):.3g} m/s towards {heading:.0f} deg from east",
        f"  power {_measured(one.power, sigma[0])} at 1 m, amplitude {level:.3g}; heard by {heard}",
    ]


def _measured(value: float, sigma: float) -> str:
    """Write a number with its standard deviation, to two digits of that."""
    digits = max(0, 1 - math.floor(math.log10(sigma))) if 0.0 < sigma < math.inf else 2
    return f"{value:.{min(digits, 9)}f} +- {sigma:.2g}"
