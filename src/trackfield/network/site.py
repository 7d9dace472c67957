"""The site: sensors, their models, the targets and the tracker's settings, as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from trackfield.errors import ConfigurationError
from trackfield.network.channel import Channel
from trackfield.network.energy import Energy
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.kinds import SensorModel, kind_of
from trackfield.raster import Region
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix

MotionName = Literal["imm", "cv"]
MethodName = Literal["bernoulli", "jipda", "mcmcda", "gnn", "nearest"]
PolicyName = Literal["accuracy", "nearest", "soft", "all"]
WatchName = Literal["empty", "always", "never"]
Dimensions = Literal[2, 3]


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the local frame stands on the Earth; x east, y north before the turn."""

    lat: float  # [deg]
    lon: float  # [deg]
    alt: float = 0.0  # [m]
    rotation_deg: float = 0.0  # counter-clockwise, from east to the local x axis


@dataclass(frozen=True, slots=True)
class Group:
    """A tracking group: a region's leader and where it stands [m]."""

    id: str
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Target:
    """What is known of every target before it is seen.

    How many there are, and for how long, matters only where readings name no target.
    """

    motion: MotionName = "imm"
    accel_sigma_m_s2: float | None = None  # None: the default of the tracker
    dimensions: Dimensions = 2
    height_m: float | None = None  # known height of targets in a 2-D site with 3-D sensors
    max_speed_m_s: float = 15.0
    velocity_sigma_m_s: float = 1.0  # of a target that appears, per axis
    lifetime_s: float = 50.0  # mean
    births_per_s: float | None = None  # in the whole region; None: learned
    initial_count: float = 1.0  # expected number of targets when the run begins


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """How the tracker treats time and silence.

    `method`, `window_steps` and `by_group` are for targets without identities, the others for
    tagged ones.
    """

    window_s: float = 1.0  # how late a reading may come and still count
    drop_s: float = 300.0  # a track without readings for this long ends
    self_calibration: bool = True
    method: MethodName = "bernoulli"  # how reports are given to targets
    window_steps: int = 10  # how late a report may come and still count
    by_group: bool = False  # each group tracks its own region, and a base unites the tracks


@dataclass(frozen=True, slots=True)
class ReportSettings:
    """How reports come about, positions that name no target; None is learned or derived."""

    sigma_m: float | None = None  # of a report that brings no sigma of its own, per axis
    p_detection: float | None = None  # that a target is reported in a step
    false_per_scan: float | None = None  # expected false reports a step, in the whole region
    region: Region | None = None  # what is watched
    step_s: float | None = None  # between scans


@dataclass(frozen=True, slots=True)
class SchedulingSettings:
    """Who senses next, and who is awake around the targets.

    `policy` chooses the sensors of a target among those that hear it: those that leave least
    uncertainty (accuracy), the nearest, as few as keep a bound (soft), or all.
    """

    policy: PolicyName = "accuracy"
    sensors: int = 4  # that sense one target; with "soft": at most; with "all" it says nothing
    bound_m2: float | None = None  # "soft": trace of the position's covariance; None: 3 sigma^2
    interval_s: float = 1.0  # between commands
    burst: int = 1  # measurements of which a node that senses tells the mean
    reach_m: float | None = None  # how far nodes sense; None: what their models say
    near: float = 1.2  # radius R_1 of the region that is awake, over that of the nearest sensors
    far: float = 1.5  # radius R_2 of its sector ahead of the target, over the same
    alpha_deg: float = 36.0  # half the opening of that sector
    ahead_s: float | None = None  # how long before they are needed nodes wake; None: an interval
    watch: WatchName = "empty"  # when the border is watched: while nobody is tracked, always, never
    sweep_s: float = 5.0  # for how long all sense when a run begins, or a track ends inside
    hysteresis: float = 0.2  # how much less another node must cost, of 1, to become master
    energy_weight: float = 1.0  # how much nodes with little energy are spared; 0: not at all


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that follows targets and hears the sensors that sense them.

    With a `wheel_base_m` it is a car; else it turns on the spot.
    """

    comm_m: float | None = None  # a hop of its radio; None: network.hop_m
    sensing_m: float | None = None  # how far sensors sense; None: what their models say
    error_m: float = 0.0  # how far a target may be from where it is told to be
    max_speed_m_s: float = math.inf
    wheel_base_m: float | None = None
    max_steering_deg: float = 35.0
    radius_m: float = 0.3  # to be kept from obstacles


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What nobody drives through: a polygon of corners [x, y] [m]."""

    polygon: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Room:
    """A room, for answers by room: a polygon of corners [x, y] [m]. Rooms do not overlap."""

    id: str
    polygon: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A field of sensors: names, positions (n, 3) [m] (z NaN: the plane of the targets), models.

    There may be no sensors where data are reports. `network` is None where messages simply arrive.
    `models` has one entry a sensor. `model_names` and `sensor_groups` say, sensor by sensor, which
    model and group it names in the site's file (empty: all the default model, no group);
    `sensors_file` is where the positions came from, None if they stood in the site's own file.
    `target_models` holds, for targets that were calibrated by themselves, what takes the place of
    `models`: an error belongs to the pair of anchor and tag. `survey` is how strongly the sensors
    heard a beacon at known places, `survey_file` where that was read.
    """

    name: str
    sensor_ids: tuple[str, ...]
    positions: Matrix
    models: tuple[SensorModel, ...]
    target: Target = field(default_factory=Target)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    origin: Origin | None = None
    groups: tuple[Group, ...] = ()
    model_names: tuple[str, ...] = ()
    sensor_groups: tuple[str | None, ...] = ()
    sensors_file: Path | None = None
    target_models: Mapping[str, tuple[SensorModel, ...]] = field(
        default_factory=dict[str, tuple[SensorModel, ...]]
    )
    reports: ReportSettings = field(default_factory=ReportSettings)
    network: Channel | None = None
    scheduling: SchedulingSettings = field(default_factory=SchedulingSettings)
    energy: Energy = field(default_factory=Energy)
    robot: Robot = field(default_factory=Robot)
    obstacles: tuple[Obstacle, ...] = ()
    survey: Fingerprints | None = None
    survey_file: Path | None = None
    rooms: tuple[Room, ...] = ()


def range_models(site: Site, target_id: str | None = None) -> tuple[RangeModel, ...]:
    """Models of the sensors for any target, or for one, where all of them measure ranges.

    `ConfigurationError` names the first sensor that does not.
    """
    models = site.models if target_id is None else site.target_models.get(target_id, site.models)
    ranges = tuple(model for model in models if isinstance(model, RangeModel))
    if len(ranges) < len(models):
        place, other = next(
            (i, model) for i, model in enumerate(models) if not isinstance(model, RangeModel)
        )
        raise ConfigurationError(
            [
                f"site {site.name}: found sensor {site.sensor_ids[place]!r} of kind "
                f"{kind_of(other)!r}, expected 'range' of all: ranges are what tagged targets are "
                "tracked and calibrated by"
            ]
        )
    return ranges
