"""What runs of the tracker share on the command line: what is wanted, and what came out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.plotting.tagged import Course
    from trackfield.types import Tracks


class Lag(NamedTuple):
    """How late positions are told, in seconds or in updates."""

    seconds: float = 0.0
    steps: int = 0


class Wanted(NamedTuple):
    """What rows are wanted: how late, how far apart, and whether they are kept for a picture.

    What they let the scheduler tell sensor nodes goes to `commands`, which rooms targets are in to
    `rooms`.
    """

    lag: Lag = Lag()
    every_s: float = 0.0
    keep: bool = False
    commands: Path | None = None
    rooms: Path | None = None


class Outcome(NamedTuple):
    """What came out of a run: numbers for `--json`, lines for people, warnings, tracks if kept.

    `courses` are the trajectories of passes, to be drawn.
    """

    numbers: dict[str, Any]
    told: list[str]
    warnings: list[str]
    kept: list[Tracks]
    courses: Sequence[Course] = ()


def parse_lag(text: str) -> Lag:
    """Read `2` or `2s` (seconds), or `10steps` (updates)."""
    steps = text.endswith("steps")
    digits = text.removesuffix("steps").removesuffix("s").strip()
    try:
        lag = Lag(steps=int(digits)) if steps else Lag(seconds=float(digits))
    except ValueError:
        lag = Lag(seconds=-1.0)
    if not (0.0 <= lag.seconds < float("inf") and lag.steps >= 0):
        expected = "seconds (2 or 2s) or updates (10steps), 0 or more"
        raise ConfigurationError([f"--lag: found {text!r}, expected {expected}"])
    return lag
