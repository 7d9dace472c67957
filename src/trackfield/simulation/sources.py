"""What sensors hear of targets that are sources of unknown power: amplitudes, step by step."""

from __future__ import annotations

import numpy as np

from trackfield.sensing import amplitude
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.simulation.deployment import Deployment
from trackfield.simulation.scenario import Scenario
from trackfield.simulation.sensed import Steps
from trackfield.simulation.targets import lives_of
from trackfield.simulation.world import World, stream
from trackfield.types import Matrix, Vector


def levels(world: World) -> Vector:
    """Amplitude at 1 m of each target of a world (k,)."""
    lives = lives_of(world.scenario, stream(world.seed, "targets"))  # those of the truth again
    return np.array([life.level for life in lives])


def clocks(world: World) -> Vector:
    """How far each sensor's clock is ahead (n,) [s], once and for all."""
    model = world.scenario.amplitude or world.scenario.energy_message
    count = len(world.deployment.sensor_ids)
    if model is None or model.clock_sigma_s == 0.0:
        return np.zeros(count)
    return model.clock_sigma_s * stream(world.seed, "errors").standard_normal(count)


def clocks_differ(scenario: Scenario) -> bool:
    """Tell whether the sensors' clocks disagree."""
    model = scenario.amplitude or scenario.energy_message
    return model is not None and model.clock_sigma_s > 0.0


def amplitudes(
    model: AmplitudeModel,
    deployment: Deployment,
    steps: Steps,
    *,
    level: Vector,
    rng: np.random.Generator,
) -> Matrix:
    """Draw the amplitudes (m, n) that sensors measure of targets of `level` (k,), Berger (2).

    Energies of several targets add up: sqrt(sum of squares), as of sources that do not know of each
    other. Where nobody is near, a sensor hears its noise.
    """
    place = deployment.network.positions
    energy = np.zeros((len(steps.t_s), len(deployment.sensor_ids)))
    for k in range(steps.target.shape[1]):
        there = np.flatnonzero(steps.target[:, k] >= 0)
        own = level[steps.target[there, k], None]
        r = np.linalg.norm(steps.position[there, k, None] - place[: energy.shape[1]], axis=-1)
        received = amplitude.strength(model, r, power=own**2)
        energy[there] += np.where(r <= model.max_range_m, received, 0.0) ** 2
    return amplitude.noisy(model, np.sqrt(energy), rng=rng)
