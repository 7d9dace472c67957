"""A simulated world: a scenario and a seed to a field, its targets, and whom the faults strike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfield.simulation.deployment import Deployment, deploy
from trackfield.simulation.faults import Strike, strikes
from trackfield.simulation.scenario import Scenario
from trackfield.simulation.targets import truth_of
from trackfield.types import Truth

_LISTED = 10  # sensors, at most, that a message names
_STREAMS = ("deployment", "targets", "faults", "errors", "sensing", "network", "pursuit")


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """What a scenario came to with a seed; a tracker is told nothing of it but the site.

    Each part has its own stream of random numbers: another network, say, leaves the truth and what
    was sensed as they are.
    """

    scenario: Scenario
    seed: int
    deployment: Deployment
    truth: Truth
    strikes: tuple[Strike, ...]


def make_world(scenario: Scenario, *, seed: int | None = None) -> World:
    """Draw the field, the targets and whom the faults strike; with the scenario's seed if None.

    `ConfigurationError` where the scenario cannot come true (no way to any tier-2 node, targets
    that never stay).
    """
    seed = scenario.seed if seed is None else seed
    deployment = deploy(scenario, stream(seed, "deployment"))
    return World(
        scenario=scenario,
        seed=seed,
        deployment=deployment,
        truth=truth_of(scenario, stream(seed, "targets")),
        strikes=strikes(scenario, deployment, stream(seed, "faults")),
    )


def stream(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one part of a world, independent of those of the others."""
    return np.random.default_rng([_STREAMS.index(name), seed])


def doubts(world: World) -> tuple[str, ...]:
    """Say what may not be as it was meant: sensors that nobody hears, a world without targets."""
    found: list[str] = []
    deployment = world.deployment
    names = [deployment.sensor_ids[int(place)] for place in deployment.network.cut_off]
    if names:
        some = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
        found.append(
            f"{len(names)} of {len(deployment.sensor_ids)} sensors cannot reach their tier-2 "
            f"node, and nothing of them arrives: {some}"
        )
    if not len(world.truth):
        found.append("no target ever appears")
    return tuple(found)
