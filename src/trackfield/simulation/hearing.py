"""What is heard of a simulated world: readings and reports, piece by piece in order of arrival."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.detection_by_age import leaders_at
from trackfield.network.passage import Passed, Sent, in_order, pass_readings, pass_reports
from trackfield.simulation import sensed, sources
from trackfield.simulation.faults import struck
from trackfield.simulation.fused import fuse, loud_from
from trackfield.simulation.messages import draw_messages
from trackfield.simulation.scenario import Carried, Scenario
from trackfield.simulation.sensed import Loudness, Steps
from trackfield.simulation.tags import Drawn, draw_tagged, readings_of
from trackfield.simulation.world import World, stream
from trackfield.types import Indices, Matrix, Readings, Reports, Vector, join_rows, select_rows

_Kept = Loudness | Drawn | Vector | None  # what stays alike through a run
_PIECE = 400_000  # sensors times targets times steps, at most, that are worked on at once
_PIECE_STEPS = 1000


class Heard(NamedTuple, Generic[Sent]):
    """Some of what was said, in order of arrival, and what became of messages meanwhile.

    Nothing that is heard later arrives before `until_s`.
    """

    table: Sent
    passed: Passed
    until_s: float


class Listening(NamedTuple):
    """Who is listened to: asked anew for each piece of `interval_s`, when it is about to be drawn.

    `sensing` tells which sensors (n,) measure; those that do not say nothing, whatever they see.
    """

    interval_s: float
    sensing: Callable[[], NDArray[np.bool_]]


def hear_readings(world: World, listening: Listening | None = None) -> Iterator[Heard[Readings]]:
    """Say what sensors say, piece by piece in order of arrival; memory does not grow with the run.

    Where the network carries readings, each has its `arrival_s`, and late ones wait for it. All
    sensors measure all the time unless `listening` says who does. `InputError` if the scenario
    gives reports.
    """
    return _in_time(_readings(world, listening))


def hear_reports(world: World, listening: Listening | None = None) -> Iterator[Heard[Reports]]:
    """Say what positions are reported, given or fused of signals; else as `hear_readings`.

    Of `listening` only the interval counts. `InputError` if the scenario gives readings and says no
    fusion of them.
    """
    return _in_time(_reports(world, listening))


def all_of(heard: Iterable[Heard[Sent]]) -> tuple[Sent, Passed]:
    """Put all that is heard into one table, and add up the counts."""
    every = list(heard)
    table = join_rows([one.table for one in every])
    return table, functools.reduce(Passed.plus, (one.passed for one in every))


def carry_reports(
    world: World, reports: Reports, rng: np.random.Generator, *, origin: Indices | None = None
) -> tuple[Reports, Passed]:
    """Send reports on their way through a world's network and faults; what arrives, in order.

    They set out from the nodes `origin` (n,), else from those nearest to them.
    """
    nodes = world.deployment.network
    node = leaders_at(nodes, reports.position[:, :2]) if origin is None else origin
    silent = struck("silent", world.strikes, reports.t_s, node) > 0.0
    sent, node = select_rows(reports, ~silent), node[~silent]
    off = struck("clock_jump", world.strikes, sent.t_s, node)
    told, passed = replace(sent, t_s=sent.t_s + off), Passed(sent=len(sent))
    if network_carries(world.scenario, "reports"):
        region = world.scenario.area
        told, passed = pass_reports(told, nodes, rng, region=region, origin=node, sent_s=sent.t_s)
    elif _clocks_err(world):
        told = replace(told, arrival_s=sent.t_s)
    return told, passed._replace(silent=int(silent.sum()))


def network_carries(scenario: Scenario, what: Carried) -> bool:
    """Tell whether readings, or reports, come over the network."""
    return scenario.network is not None and scenario.carried == what


def tells_arrivals(world: World, what: Carried) -> bool:
    """Tell whether readings, or reports, that are heard have an `arrival_s`."""
    return network_carries(world.scenario, what) or _clocks_err(world)


def _readings(world: World, listening: Listening | None) -> Iterator[Heard[Readings]]:
    scenario, kept, ahead_s = world.scenario, _kept(world), sources.clocks(world)
    sensing, network = stream(world.seed, "sensing"), stream(world.seed, "network")
    for steps, until_s in _pieces(world, listening):
        table = _spoken(world, steps, kept, sensing)
        if listening is not None:
            table = select_rows(table, listening.sensing()[table.sensor])
        silent = struck("silent", world.strikes, table.t_s, table.sensor) > 0.0
        table = select_rows(table, ~silent)
        off = struck("clock_jump", world.strikes, table.t_s, table.sensor)
        told, sent_s = replace(table, t_s=table.t_s + off + ahead_s[table.sensor]), table.t_s
        passed = Passed(sent=len(told))
        if network_carries(scenario, "readings"):
            told, passed = pass_readings(told, world.deployment.network, network, sent_s=sent_s)
        elif _clocks_err(world):
            told = replace(told, arrival_s=sent_s)
        passed = passed._replace(silent=int(silent.sum()))
        yield Heard(told, passed, until_s)


def _reports(world: World, listening: Listening | None) -> Iterator[Heard[Reports]]:
    scenario = world.scenario
    if scenario.reports is None and scenario.fusion is None:
        raise InputError("found a scenario whose sensors give readings, expected [reports]")
    kept = _kept(world)
    sensing, network = stream(world.seed, "sensing"), stream(world.seed, "network")
    for steps, until_s in _pieces(world, listening):
        origin = None
        if scenario.reports is not None:
            table = sensed.as_reports(
                scenario.reports, scenario.area, steps, struck=world.strikes, rng=sensing
            )
        else:
            values = _values(world, steps, kept, sensing)
            table, origin = fuse(scenario, world.deployment, steps, values)
        told, passed = carry_reports(world, table, network, origin=origin)
        yield Heard(told, passed, until_s)


def _spoken(world: World, steps: Steps, kept: _Kept, rng: np.random.Generator) -> Readings:
    """Draw what sensors say in some steps, before anything happens to it."""
    scenario = world.scenario
    if isinstance(kept, Drawn):
        return readings_of(kept, world.deployment, steps)
    values = _values(world, steps, kept, rng)
    if scenario.detection is not None:
        # Silence is not said, but where it would be taken for sleep.
        said, kind = (values > 0.0) | (scenario.scheduling is not None), "detection"
    elif scenario.amplitude is not None:
        said, kind = np.ones(values.shape, np.bool_), "amplitude"
    else:
        said, kind = values >= loud_from(scenario), "signal"
    return sensed.as_readings(values, said, world.deployment, steps=steps, kind=kind)


def _values(world: World, steps: Steps, kept: _Kept, rng: np.random.Generator) -> Matrix:
    """Draw what sensors measure in some steps, (m, n)."""
    scenario, deployment = world.scenario, world.deployment
    if scenario.detection is not None:
        values = sensed.detections(
            scenario.detection, deployment, steps, struck=world.strikes, rng=rng
        )
    elif scenario.signal is not None and isinstance(kept, Loudness):
        values = sensed.signals(scenario.signal, deployment, steps, kept=kept, rng=rng)
    elif scenario.amplitude is not None and isinstance(kept, np.ndarray):
        values = sources.amplitudes(scenario.amplitude, deployment, steps, level=kept, rng=rng)
    else:
        raise InputError("found a scenario that gives reports, expected sensors that give readings")
    return sensed.stuck_values(values, world.strikes, steps)


def _kept(world: World) -> _Kept:
    """Draw what belongs to a run as a whole: errors and levels that stay, and what tags say."""
    scenario, deployment, truth = world.scenario, world.deployment, world.truth
    if scenario.tagged:
        return draw_tagged(scenario, deployment, truth, rng=stream(world.seed, "sensing"))
    if scenario.energy_message is not None:
        return draw_messages(world)
    if scenario.signal is not None:
        rng = stream(world.seed, "errors")
        return sensed.loudness(scenario.signal, deployment, len(truth.target_ids), rng)
    return None if scenario.amplitude is None else sources.levels(world)


def _pieces(world: World, listening: Listening | None) -> Iterator[tuple[Steps, float]]:
    """Gather steps that are drawn at once, and when they are over: all of an interval, if told."""
    scenario = world.scenario
    if listening is None:
        for steps in _all_steps(world):
            yield steps, float(steps.t_s[-1]) + scenario.step_s
        return
    first, number = 0, 1
    while first < scenario.steps:
        until_s = number * listening.interval_s
        last = min(math.ceil(until_s / scenario.step_s - 1e-9), scenario.steps)
        yield sensed.steps_of(scenario, world.truth, first, last), until_s
        first, number = last, number + 1


def _all_steps(world: World) -> Iterator[Steps]:
    """All steps of a run, some at a time: as many as bounded memory allows."""
    scenario = world.scenario
    alive = np.unique(world.truth.t_s, return_counts=True)[1].max(initial=1)
    each = max(len(world.deployment.sensor_ids), 1) * int(alive)
    some = int(np.clip(_PIECE // each, 1, _PIECE_STEPS))
    for first in range(0, scenario.steps, some):
        yield sensed.steps_of(scenario, world.truth, first, min(first + some, scenario.steps))


def _clocks_err(world: World) -> bool:
    jump = any(one.fault.kind == "clock_jump" for one in world.strikes)
    return jump or sources.clocks_differ(world.scenario)


def _in_time(sent: Iterator[Heard[Sent]]) -> Iterator[Heard[Sent]]:
    """Hold back what has not arrived yet: all that is heard is in order of arrival.

    What has no arrival is taken as it comes.
    """
    held: Sent | None = None
    until_s = 0.0
    for table, passed, until_s in sent:
        if held is None and np.isnan(table.arrival_s).all():
            yield Heard(table, passed, until_s)
            continue
        every = in_order(table if held is None else join_rows([held, table]))
        ready = int(np.searchsorted(every.arrival_s, until_s))
        held = select_rows(every, slice(ready, None))
        yield Heard(select_rows(every, slice(ready)), passed, until_s)
    if held is not None and len(held):
        yield Heard(held, Passed(), math.inf)
