"""What goes wrong in a scenario, done to what sensors say: whom it strikes, when, and what then."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.simulation.deployment import Deployment
from trackfield.simulation.scenario import Fault, FaultKind, Scenario
from trackfield.types import Indices, Vector


class Strike(NamedTuple):
    """A fault, and the nodes (n,) of the network that it strikes."""

    fault: Fault
    nodes: NDArray[np.bool_]


def strikes(
    scenario: Scenario, deployment: Deployment, rng: np.random.Generator
) -> tuple[Strike, ...]:
    """Find whom each fault strikes; those that are counted are drawn."""
    names = {group.id: place for place, group in enumerate(scenario.groups)}
    numbers = {name: place for place, name in enumerate(deployment.sensor_ids)}
    count = len(deployment.network.positions)
    found: list[Strike] = []
    for fault in scenario.faults:
        nodes = np.zeros(count, np.bool_)
        if fault.group is not None:
            nodes |= deployment.network.routes.group == names[fault.group]
        nodes[[numbers[name] for name in fault.sensors]] = True
        nodes[rng.choice(count, fault.count, replace=False)] = True
        found.append(Strike(fault, nodes))
    return tuple(found)


def struck(kind: FaultKind, all_strikes: tuple[Strike, ...], t_s: Vector, node: Indices) -> Vector:
    """Add up what faults of a kind do to messages of nodes (n,) at `t_s` (n,).

    A silent one counts 1, a jump of the clock its `jump_s`.
    """
    total = np.zeros(t_s.size)
    for fault, nodes in all_strikes:
        if fault.kind == kind:
            amount = fault.jump_s if kind == "clock_jump" else 1.0
            total += amount * (nodes[node] & active(fault, t_s))
    return total


def active(fault: Fault, t_s: Vector) -> NDArray[np.bool_]:
    """Tell at which times (n,) a fault is there."""
    end = np.inf if fault.to_s is None else fault.to_s
    return (t_s >= fault.from_s) & (t_s < end)


def bursts(all_strikes: tuple[Strike, ...], t_s: Vector) -> Vector:
    """Factor (n,) of what is false at `t_s` (n,)."""
    factor = np.ones(t_s.size)
    for fault, _ in all_strikes:
        if fault.kind == "burst":
            factor = np.where(active(fault, t_s), factor * fault.factor, factor)
    return factor
