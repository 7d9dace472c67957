"""The site: sensors, their models, the targets and the tracker's settings, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix

MotionName = Literal["imm", "cv"]
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
    """What is known of every target before it is seen."""

    motion: MotionName = "imm"
    accel_sigma_m_s2: float | None = None  # None: the default tracker's own modes
    dimensions: Dimensions = 2
    height_m: float | None = None  # known height of targets in a 2-D site with 3-D sensors
    max_speed_m_s: float = 15.0


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """How the tracker treats time and silence."""

    window_s: float = 1.0  # how late a reading may come and still count
    drop_s: float = 300.0  # a track without readings for this long ends
    self_calibration: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A field of sensors: names, positions (n, 3) [m] (z NaN: the plane of the targets), models.

    `models` has one entry a sensor. `model_names` and `sensor_groups` say, sensor by sensor, which
    model and group it names in the site's file (empty: all the default model, no group);
    `sensors_file` is where the positions came from, None if they stood in the site's own file.
    `target_models` holds, for targets that were calibrated by themselves, what takes the place of
    `models`: an error belongs to the pair of anchor and tag.
    """

    name: str
    sensor_ids: tuple[str, ...]
    positions: Matrix
    models: tuple[RangeModel, ...]
    target: Target = field(default_factory=Target)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    origin: Origin | None = None
    groups: tuple[Group, ...] = ()
    model_names: tuple[str, ...] = ()
    sensor_groups: tuple[str | None, ...] = ()
    sensors_file: Path | None = None
    target_models: Mapping[str, tuple[RangeModel, ...]] = field(
        default_factory=dict[str, tuple[RangeModel, ...]]
    )
