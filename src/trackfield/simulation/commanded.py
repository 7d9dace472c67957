"""A simulated world in closed loop: its sensors say what they measure while they are told to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.passage import Passed
from trackfield.network.site import SchedulingSettings
from trackfield.pipeline.scheduled import averaged
from trackfield.pipeline.tagged import Tracker
from trackfield.pipeline.untagged import Feed, UntaggedTracker
from trackfield.sensing.range import RangeModel
from trackfield.simulation.closed_loop import Tracking, Turn, closed_loop
from trackfield.simulation.hearing import Heard, Listening, hear_readings
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import World
from trackfield.types import Readings


class WorldSenses:
    """The sensors of a world, for `closed_loop`, interval after interval of its run.

    What a sensor measures does not depend on who else does: two runs of one world differ only in
    who is listened to. `passed` counts what became of messages so far.
    """

    def __init__(self, world: World, settings: SchedulingSettings) -> None:
        self.passed = Passed()
        self._sensing: NDArray[np.bool_] = np.zeros(len(world.deployment.sensor_ids), np.bool_)
        self._model: RangeModel | None = None  # of means, where these are told
        model = world.scenario.range
        if model is not None and settings.burst > 1:
            self._model = averaged(model, settings.burst)
            world = replace(world, scenario=replace(world.scenario, range=self._model))
        listening = Listening(settings.interval_s, lambda: self._sensing)
        self._heard: Iterator[Heard[Readings]] = hear_readings(world, listening)

    def hear(self, from_s: float, to_s: float, *, sensing: NDArray[np.bool_]) -> Readings:
        """Say what is heard in the next interval; `InputError` where the run is over."""
        self._sensing = sensing
        heard = next(self._heard, None)
        if heard is None:
            raise InputError(f"found nothing more to hear from {from_s} to {to_s} s")
        self.passed = self.passed.plus(heard.passed)
        if self._model is None:
            return heard.table
        growing = self._model.sigma_scale * heard.table.value
        return replace(heard.table, sigma=np.hypot(self._model.sigma_m, growing))


def run_commanded(world: World, senses: WorldSenses) -> Iterator[Turn]:
    """Run a world that is scheduled: in each interval those sense that its tracks ask for."""
    site = site_of(world)
    return closed_loop(site, senses, tracker_of(world), duration_s=world.scenario.duration_s)


def tracker_of(world: World) -> Tracking:
    """Make the tracker of what a world's sensors say."""
    site = site_of(world)
    if world.scenario.range is not None:
        return Tracker(site)
    if world.scenario.detection is not None:
        return UntaggedTracker(site, Feed("detection", world.seed, says_zero=True))
    return UntaggedTracker(site, Feed("signal", world.seed))
