"""Energy messages of a simulated world: each sensor fits its records and sends a word of each."""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.network.kinds import KINDS
from trackfield.sensing.energy_message import amplitude_model, sample_times
from trackfield.sensing.energy_message_making import make
from trackfield.simulation import sources
from trackfield.simulation.sensed import steps_of
from trackfield.simulation.tags import Drawn
from trackfield.simulation.world import World, stream
from trackfield.types import Vector


def draw_messages(world: World) -> Drawn:
    """Draw what every sensor says of its records, which follow each other from the run's start.

    Each record is fitted by the same arithmetic as in a real sensor, `sensing.energy_message`; one
    in which nothing was heard gives the word for that. Only one record of samples is held at a
    time.
    """
    scenario, deployment = world.scenario, world.deployment
    model = scenario.energy_message
    if model is None:
        raise InputError("found a scenario without [energy_message]")
    level, rng = sources.levels(world), stream(world.seed, "sensing")
    received, alive = amplitude_model(model), np.flatnonzero(deployment.network.alive)
    alive = alive[alive < len(deployment.sensor_ids)]
    length = sample_times(model).size
    ends = np.arange(length - 1, scenario.steps, max(length - 1, 1))
    words: list[Vector] = []
    for end in ends.tolist():
        steps = steps_of(scenario, world.truth, end + 1 - length, end + 1)
        values = sources.amplitudes(received, deployment, steps, level=level, rng=rng)
        words.append(make(model, values.T[alive]).word.astype(np.float64))
    count = len(ends) * alive.size
    return Drawn(
        t_s=np.repeat(scenario.step_s * ends.astype(np.float64), alive.size),
        target=np.full(count, -1, np.int32),
        sensor=np.tile(alive, len(ends)).astype(np.int32),
        value=np.concatenate([np.empty(0), *words]),
        kind=np.full(count, [*KINDS].index("energy_message"), np.int32),
        target_ids=(),
    )
