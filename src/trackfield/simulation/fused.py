"""Signals fused where they are heard: a scenario's readings become reports, and who sends them."""

from __future__ import annotations

import math

import numpy as np

from trackfield.errors import InputError
from trackfield.localization import centroid, source_fit
from trackfield.localization.centroid import Election
from trackfield.simulation.deployment import Deployment
from trackfield.simulation.scenario import Scenario
from trackfield.simulation.sensed import Steps
from trackfield.types import Indices, Matrix, Reports


def fuse(
    scenario: Scenario, deployment: Deployment, steps: Steps, values: Matrix
) -> tuple[Reports, Indices]:
    """Locate the sources of signals (m, n), step by step; reports, and the nodes that send them.

    By maximum likelihood, or by the centroid of Oh (12) among those that are loud enough.
    """
    model = scenario.signal
    if model is None:
        raise InputError("found a scenario without signals, expected [signal] to be fused")
    spoken = deployment.network.alive & (values >= loud_from(scenario))
    election = Election(sensing_range_m=model.max_range_m)
    if scenario.sensors is not None and scenario.sensors.threshold is not None:
        election = election._replace(threshold=scenario.sensors.threshold)
    found = [
        centroid.locate(deployment.told, z, election=election)
        if scenario.fusion == "centroid"
        else source_fit.locate(model, deployment.told, values=z)
        for z in np.where(spoken, values, np.nan)
    ]
    counts = np.array([len(sources.position) for sources in found])
    total = int(counts.sum())
    position = np.full((total, 3), np.nan)
    position[:, :2] = np.concatenate([sources.position.reshape(-1, 2) for sources in found])
    reports = Reports(
        t_s=np.repeat(steps.t_s, counts),
        arrival_s=np.full(total, np.nan),
        position=position,
        covariance=np.concatenate([sources.covariance.reshape(-1, 3) for sources in found]),
        confidence=np.full(total, np.nan),
    )
    return reports, np.concatenate([sources.leader for sources in found]).astype(np.int32)


def loud_from(scenario: Scenario) -> float:
    """Tell from which strength on a sensor says what it hears."""
    sensors = scenario.sensors
    told = None if sensors is None else sensors.threshold
    return -math.inf if told is None else told
