"""A field in closed loop: tracks decide which nodes are awake, and what is awake the tracks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trackfield.network import meter as meters
from trackfield.network.meter import Meter
from trackfield.network.site import Site
from trackfield.pipeline.commands import Commander
from trackfield.pipeline.rows import tracks_of
from trackfield.scheduling.scheduler_state import Told
from trackfield.types import Commands, Mode, Readings, Status, Tracks, Vector

_JUST = 1e-6  # of an interval, by which a watermark stays before its end
_COUNTS = ("commands", "handovers", "late", "lost", "exhausted")
_MOST_TROUBLES = 100  # that are told
_SHOWN = (Status.CONFIRMED, Status.COASTING)


class Senses(Protocol):
    """A world in which nodes measure if they are told to."""

    def hear(self, from_s: float, to_s: float, *, sensing: NDArray[np.bool_]) -> Readings:
        """Say what is heard from `from_s` to before `to_s` if the `sensing` (n,) nodes measure."""
        ...


class Tracking(Protocol):
    """A tracker as an operator: `pipeline.tagged.Tracker`, `pipeline.untagged.UntaggedTracker`."""

    def process(self, readings: Readings, /, *, watermark_s: float | None = None) -> Tracks:
        """Take readings, and return the rows that are settled."""
        ...


class Turn(NamedTuple):
    """One interval, from `told.t_s` on: who was told what, what was heard, which tracks came of it.

    `commands` are the changes of modes, `told` all of them and who serves whom; nodes spend
    `spent_j` (n,) [J] in it, and `meter` is what they have spent by its end.
    """

    told: Told
    commands: Commands
    readings: Readings
    tracks: Tracks
    spent_j: Vector
    meter: Meter


class Outcome(NamedTuple):
    """What some intervals in closed loop came to.

    `tracked_s` is for how long targets were shown, or known so well that nobody was asked, all of
    them added up; `spent_j` what the network spent [J], of which `above_sleep_j` by nodes above
    their sleep, the exhausted nothing; `in_mode_s` (4,) how long nodes were in each mode, added up.
    `counts` tells changes of modes (`commands`), `handovers` of masters, nodes that woke `late`,
    tracks given up (`lost`), nodes `exhausted`; `troubles` what could not be had, each once.
    """

    duration_s: float
    tracked_s: float
    spent_j: float
    above_sleep_j: float
    in_mode_s: Vector
    counts: dict[str, int]
    troubles: tuple[str, ...]

    @property
    def per_tracked_s(self) -> float:
        """Energy above sleep per second in which a target was tracked [J/s]; 0 if none was."""
        return self.above_sleep_j / self.tracked_s if self.tracked_s > 0.0 else 0.0


def closed_loop(
    site: Site, senses: Senses, tracker: Tracking, *, duration_s: float
) -> Iterator[Turn]:
    """Run a site in closed loop, interval by interval of its `[scheduling]`.

    In each interval those nodes measure that were told to, at its start, from what tracks said by
    then. Nodes spend by their modes, as `[energy]` says; who is exhausted does nothing any more.
    """
    commander, interval_s = Commander(site), site.scheduling.interval_s
    meter = meters.init(site.energy, site.sensor_ids)
    tracks = tracks_of(())
    for k in range(max(1, math.ceil(duration_s / interval_s - 1e-9))):
        from_s, to_s = k * interval_s, (k + 1) * interval_s
        commander.tell_energy(meter.residual_j / meter.battery_j)
        commands = commander.process(tracks, watermark_s=from_s)
        (told,) = commander.told
        readings = senses.hear(from_s, to_s, sensing=measuring(told))
        tracks = tracker.process(readings, watermark_s=to_s - _JUST * interval_s)
        meter, spent = meters.step(meter, to_s, commands=commands)
        yield Turn(told, commands, readings, tracks, spent.joules, meter)


def measuring(told: Told) -> NDArray[np.bool_]:
    """Nodes (n,) that measure: those that sense, and masters whose own track they sense."""
    nodes = told.modes == Mode.SENSING
    for service in told.services:
        nodes[service.sensors] = True
    return nodes | (told.modes == Mode.MASTER) if told.sweeping else nodes


def outcome(turns: Iterable[Turn], site: Site) -> Outcome:
    """Add up intervals of a run."""
    found = nothing()
    for turn in turns:
        found = tallied(found, turn, site)
    return found


def nothing() -> Outcome:
    """Tell of no interval."""
    return Outcome(0.0, 0.0, 0.0, 0.0, np.zeros(len(Mode)), dict.fromkeys(_COUNTS, 0), ())


def tallied(before: Outcome, turn: Turn, site: Site) -> Outcome:
    """Add an interval to those `before` it: what has passed need not be kept."""
    told, interval_s = turn.told, site.scheduling.interval_s
    shown = turn.tracks.track[np.isin(turn.tracks.status, _SHOWN)].tolist()
    spared = [s.track for s in told.services if not (s.sensors.size or s.missed or s.trouble)]
    spent_j = float(turn.spent_j.sum())
    asleep_j = 1e-3 * site.energy.sleep_mw * interval_s
    above_j = float(np.maximum(turn.spent_j - asleep_j, 0.0).sum())
    here = {
        "commands": len(turn.commands),
        "handovers": told.handovers,
        "late": told.late,
        "lost": len(told.lost),
    }
    counts = {name: before.counts[name] + count for name, count in here.items()}
    said = [*told.trouble, *(line for service in told.services for line in service.trouble)]
    return Outcome(
        duration_s=before.duration_s + interval_s,
        tracked_s=before.tracked_s + interval_s * len({*shown, *spared}),
        spent_j=before.spent_j + spent_j,
        above_sleep_j=before.above_sleep_j + above_j,
        in_mode_s=before.in_mode_s + interval_s * np.bincount(told.modes, minlength=len(Mode)),
        counts={**counts, "exhausted": int((~turn.meter.alive).sum())},
        troubles=tuple(dict.fromkeys((*before.troubles, *said)))[:_MOST_TROUBLES],
    )
