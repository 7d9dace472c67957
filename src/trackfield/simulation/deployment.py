"""A scenario's sensors set up: where they are told to stand, where they do, and their network."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.network.channel import Channel
from trackfield.network.kinds import SensorModel
from trackfield.network.layouts import Lattice, lattice, lattice_count, random_places
from trackfield.network.topology import Network, Routes, lay_out, misplaced
from trackfield.raster import Region
from trackfield.simulation.scenario import Scenario
from trackfield.types import Matrix, Vector

_LATTICES: dict[str, Lattice] = {"grid": "square", "hexagonal": "hexagonal"}


class Deployment(NamedTuple):
    """Sensors `told` (n, 2) [m] to stand where a site says; `network` knows where they really do.

    Without sensors, the nodes of the network are the tier-2 nodes themselves, or one base.
    """

    sensor_ids: tuple[str, ...]
    told: Matrix
    network: Network


def deploy(scenario: Scenario, rng: np.random.Generator) -> Deployment:
    """Set up the sensors; `ConfigurationError` where none of them reaches a tier-2 node."""
    channel = scenario.network or Channel()
    leaders = np.array([(group.x_m, group.y_m) for group in scenario.groups]).reshape(-1, 2)
    sensors = scenario.sensors
    if sensors is None:
        return Deployment((), np.empty((0, 2)), _base(scenario, channel, leaders))
    told = _places(scenario, rng)
    told = told + sensors.jitter_m * rng.standard_normal(told.shape)
    there = misplaced(told, sensors.misplaced_m, rng=rng)
    dead = rng.choice(len(told), sensors.dead, replace=False)
    network = lay_out(channel, there, leaders, dead=dead.tolist())
    if network.cut_off.size == network.alive.sum():
        raise ConfigurationError(
            [
                f"network.hop_m: found {channel.hop_m:g}, with which no sensor reaches its tier-2 "
                "node, expected a longer hop"
            ]
        )
    return Deployment(sensor_names(len(told)), told, network)


def sensor_count(scenario: Scenario) -> int:
    """How many sensors there are."""
    sensors = scenario.sensors
    if sensors is None:
        return 0
    if sensors.layout == "random":
        return sensors.count
    if sensors.layout == "listed":
        return len(sensors.positions)
    return lattice_count(scenario.area, sensors.spacing_m, layout=_LATTICES[sensors.layout])


def sensor_names(count: int) -> tuple[str, ...]:
    """Names of sensors: s0, s1, ..."""
    return tuple(f"s{i}" for i in range(count))


def models_in_turn(scenario: Scenario) -> tuple[SensorModel, ...]:
    """Model of each sensor: of several kinds, they have one after the other in turn."""
    every = tuple(scenario.models.values())
    return tuple(every[i % len(every)] for i in range(sensor_count(scenario))) if every else ()


def _places(scenario: Scenario, rng: np.random.Generator) -> Matrix:
    """Places (n, 2) [m] of the layout."""
    sensors, region = scenario.sensors, scenario.area
    if sensors is None or sensors.layout == "listed":
        return np.array(sensors.positions if sensors else (), np.float64).reshape(-1, 2)
    if sensors.layout == "random":
        return random_places(region, sensors.count, rng=rng)
    return lattice(region, sensors.spacing_m, layout=_LATTICES[sensors.layout])


def middle_of(region: Region) -> Vector:
    """Middle (2,) [m] of a region."""
    return np.array([region.x_min + region.x_max, region.y_min + region.y_max]) / 2.0


def _base(scenario: Scenario, channel: Channel, leaders: Matrix) -> Network:
    """Nodes that are their own leaders: what they hear needs no hop."""
    nodes = leaders if len(leaders) else middle_of(scenario.area)[None]
    own = np.arange(len(nodes), dtype=np.int32)
    return Network(channel, nodes, np.ones(len(nodes), np.bool_), Routes(own, np.zeros_like(own)))
