"""What a site tells a scheduler: its nodes, how targets move, and who may watch the border."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.filtering.range_tracker import MANOEUVRING
from trackfield.motion import ConstantVelocity
from trackfield.network.kinds import SensorModel
from trackfield.network.site import Site, Target
from trackfield.pipeline.scene import watched
from trackfield.raster import Region
from trackfield.scheduling.scheduler import Scheduler
from trackfield.scheduling.serving import Sensors, sensors_of
from trackfield.scheduling.watch import Watch, watch_border
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.range import RangeModel

_SHIFTS = 30  # of the border's watch, at most
_CELLS_TO_A_REACH = 8.0
_MOST_CELLS = 1e6


def scheduler_of(site: Site) -> Scheduler:
    """Make the scheduler that a site asks for; `ConfigurationError` for a site without sensors."""
    if not site.sensor_ids:
        raise ConfigurationError([f"site {site.name}: found no sensors that could be scheduled"])
    settings = site.scheduling
    told = settings.reach_m
    reach = np.array([reach_of(model) if told is None else told for model in site.models])
    models = site.models
    if settings.burst > 1:
        models = tuple(
            averaged(model, settings.burst) if isinstance(model, RangeModel) else model
            for model in site.models
        )
    sensors = sensors_of(site.positions[:, :2], models, reach)
    region = watched(site) or _around(sensors)
    motion = ConstantVelocity(accel_density(site.target))
    watch = None if settings.watch == "never" else _watch(site, sensors, region)
    return Scheduler(sensors, settings, motion, region, watch)


def accel_density(target: Target) -> float:
    """Density q [m^2/s^3] of a target's white acceleration: as the tracker of ranges has it."""
    told = target.accel_sigma_m_s2
    return MANOEUVRING.accel_density if told is None else told**2


def averaged(model: RangeModel, burst: int) -> RangeModel:
    """Model of the mean of `burst` measurements: its white noise is less, and no other error."""
    less = math.sqrt(burst)
    return replace(model, sigma_m=model.sigma_m / less, sigma_scale=model.sigma_scale / less)


def reach_of(model: SensorModel) -> float:
    """How far a sensor senses [m]; infinite where its model knows no limit."""
    if isinstance(model, DetectionModel):
        return float(detection.reach(model)[0])
    return math.inf if isinstance(model, EnergyMessageModel) else model.max_range_m


def _around(sensors: Sensors) -> Region:
    """Region of sensors in one line, or of a single one: as far as they reach."""
    reach = sensors.farthest_m
    low, high = sensors.nodes.positions.min(axis=0), sensors.nodes.positions.max(axis=0)
    return Region(*(low - reach).tolist(), *(high + reach).tolist())


def _watch(site: Site, sensors: Sensors, region: Region) -> Watch:
    """Who sees all that comes in at the site's highest speed, within an interval."""
    cell_m = max(sensors.farthest_m / _CELLS_TO_A_REACH, math.sqrt(region.area / _MOST_CELLS))
    depth_m = site.target.max_speed_m_s * site.scheduling.interval_s
    return watch_border(
        sensors.nodes,
        region,
        reach_m=sensors.reach_m,
        depth_m=depth_m,
        most=_SHIFTS,
        cell_m=cell_m,
    )
