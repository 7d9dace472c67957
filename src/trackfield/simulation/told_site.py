"""The site of a simulated world: what a tracker is told of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackfield.network.energy import Energy
from trackfield.network.kinds import kind_of
from trackfield.network.site import Group, ReportSettings, SchedulingSettings, Site, Target
from trackfield.simulation.deployment import models_in_turn
from trackfield.simulation.world import World
from trackfield.types import Columns, Names


def site_of(world: World, *, sensors_file: Path | None = None) -> Site:
    """Tell what the people who set a field up would know: no dead nodes, no misplaced ones.

    Sensors stand where they were put down, with the model that they really have; how targets move
    is told if all of them move alike. `sensors_file` is where the sensors' places are written.
    """
    scenario, deployment = world.scenario, world.deployment
    count = len(deployment.sensor_ids)
    models = models_in_turn(scenario)
    names = [group.id for group in scenario.groups] or [None]
    own = [names[int(place)] for place in deployment.network.routes.group[:count]]
    reports = ReportSettings()  # tagged targets need none
    if not scenario.tagged:
        reports = ReportSettings(region=scenario.area, step_s=scenario.step_s)
    if scenario.reports is not None:
        reports = ReportSettings(
            sigma_m=scenario.reports.sigma_m,
            p_detection=scenario.reports.p_detection,
            false_per_scan=scenario.reports.false_per_scan,
            region=scenario.area,
            step_s=scenario.step_s,
        )
    accel = {party.accel_sigma_m_s2 for party in scenario.targets}
    return Site(
        name=scenario.name,
        sensor_ids=deployment.sensor_ids,
        positions=np.column_stack([deployment.told, np.full(count, np.nan)]),
        models=models,
        target=Target(accel_sigma_m_s2=(accel.pop() or None) if len(accel) == 1 else None),
        groups=tuple(Group(g.id, g.x_m, g.y_m) for g in scenario.groups),
        model_names=tuple(kind_of(model) for model in models) or ("",) * count,
        sensor_groups=tuple(own),
        sensors_file=sensors_file,
        reports=reports,
        network=scenario.network,
        scheduling=scenario.scheduling or SchedulingSettings(),
        energy=scenario.energy or Energy(),
    )


def sensor_columns(world: World) -> Columns:
    """Columns of sensors.csv."""
    deployment, groups = world.deployment, world.scenario.groups
    own = deployment.network.routes.group
    columns: dict[str, NDArray[Any] | Names] = {
        "sensor_id": Names(np.arange(own.size, dtype=np.int32), deployment.sensor_ids),
        "x_m": deployment.told[:, 0],
        "y_m": deployment.told[:, 1],
    }
    kinds = tuple(world.scenario.models)
    if len(kinds) > 1:
        turn = np.arange(own.size, dtype=np.int32) % len(kinds)
        columns["model"] = Names(turn.astype(np.int32), kinds)
    if groups:
        columns["group"] = Names(own, tuple(group.id for group in groups))
    return columns
