"""A scenario: a field of sensors, what moves in it, the network, and what goes wrong; plain values.

The keys of a scenario's file are the fields of these classes, and its bounds stand in their types:
a field added here is a key there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from trackfield.network.channel import Channel
from trackfield.network.energy import Energy
from trackfield.network.kinds import KINDS, SensorModel
from trackfield.network.site import Group, SchedulingSettings
from trackfield.pursuit.assignment import Objective
from trackfield.raster import Region
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.rssi import RssiModel
from trackfield.sensing.signal import SignalModel

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=0)]
Name = Annotated[str, Field(min_length=1)]
Point = tuple[Number, Number]  # x, y [m]
Span = tuple[NotNegative, NotNegative]  # from, to

Layout = Literal["grid", "hexagonal", "random", "listed"]
Motion = Literal["random", "walk", "crossing", "row"]
FaultKind = Literal["silent", "burst", "clock_jump", "stuck"]
Carried = Literal["readings", "reports"]
Fusion = Literal["fit", "centroid"]
MIXED = ("bearing", "angular_rate", "motion")  # kinds that may stand in one field
VehicleKind = Literal["thruster", "runner", "car"]
Sight = Literal["tracks", "exact"]


@dataclass(frozen=True, slots=True)
class Sensors:
    """Where sensors stand: on a grid in the middle of the region, anywhere in it, or as listed.

    A grid has squares, or is hexagonal: rows shifted by half a spacing, the fewest that cover.
    """

    layout: Layout = "grid"
    spacing_m: Positive = 5.0  # of a grid, square or hexagonal
    count: Count = 0  # of random ones
    positions: tuple[Point, ...] = ()  # of listed ones [m]
    jitter_m: NotNegative = 0.0  # per axis, known: the site says where they stand
    misplaced_m: NotNegative = 0.0  # per axis, unknown: the site says where they should stand
    dead: Count = 0  # sensors, drawn, that neither sense nor relay
    threshold: Number | None = None  # signals below it are not said


@dataclass(frozen=True, slots=True)
class Reports:
    """Targets give positions themselves, with an error, now and then, among false ones."""

    sigma_m: Positive = 0.4  # per axis
    p_detection: Probability = 0.9
    false_per_scan: NotNegative = 0.0  # expected, anywhere in the region


@dataclass(frozen=True, slots=True)
class Party:
    """Targets that come and move in one way.

    `count` targets come for certain, `at_start` of them with the run and the others at a random
    time in `enter_s`; `births_per_s` more come at random all the time. What a motion does not name
    here does not concern it:

    - random: anywhere in the region, with a random heading (`inset_m`);
    - walk: along `path`, or to random places in the region (`inset_m`, `go_s`, `stop_s`);
    - crossing: from one border straight to another, past the region's centre (`within_m`, `go_s`,
      `stop_s`);
    - row: side by side from `start` (`heading_deg`, `spacing_m`).

    All of them are driven by accelerations N(0, accel_sigma_m_s2^2) held over a step, Oh (9).
    """

    motion: Motion = "random"
    count: Count = 0
    at_start: Count = 0
    births_per_s: NotNegative = 0.0
    enter_s: Span = (0.0, 0.0)
    lifetime_s: Span | None = None  # uniform; without it, a target stays
    mean_lifetime_s: Positive | None = None  # exponential, instead
    least_s: NotNegative = 0.0  # a target that would leave earlier is drawn again
    speed_m_s: Span = (1.0, 1.0)  # uniform
    accel_sigma_m_s2: NotNegative = 0.0
    border: Literal["leave", "bounce"] = "leave"
    inset_m: NotNegative = 0.0
    path: tuple[Point, ...] = ()
    go_s: Span | None = None  # how long a walker walks between stops
    stop_s: Span = (0.0, 0.0)  # how long it stops
    within_m: NotNegative = 0.0
    start: Point | None = None  # the middle of the row; else that of the region
    heading_deg: Number = 0.0
    spacing_m: Positive = 1.0
    evade_m_s2: NotNegative = 0.0  # thrust, per axis, by which they flee from pursuers, Oh (10)
    level: Positive = 1.0  # amplitude at 1 m of the source that each of them is


@dataclass(frozen=True, slots=True)
class Pursuer:
    """A pursuer, at rest when the run begins."""

    at: Point  # [m]
    heading_deg: Number = 0.0  # of a car, counter-clockwise from east


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What pursuers must go around; evaders, sensors and radio do not mind it."""

    corners: tuple[Point, ...]  # of a polygon [m]


@dataclass(frozen=True, slots=True)
class Pursuit:
    """What pursuers are, what they know, and when an evader is captured.

    - thruster: `thrust_m_s2` and `speed_m_s` of an axis, its actuators wrong by `error_m_s2`; keeps
      `apart_m` from the others and `clear_m` from obstacles, whatever happens;
    - runner: turns at once, goes at `speed_m_s`;
    - car: `speed_m_s`, `steering_deg`, `wheel_base_m`.

    They know `tracks` of the sensors' readings, or the `exact` truth. A target is captured that was
    within `capture_m` of one pursuer in `confirm_steps` steps in a row, and is gone. The other keys
    are those of `pursuit.settings.PursuitSettings`.
    """

    vehicle: VehicleKind = "thruster"
    sight: Sight = "tracks"
    speed_m_s: Positive = 3.0
    thrust_m_s2: Positive = 1.0
    error_m_s2: NotNegative = 0.0
    apart_m: NotNegative = 1.0
    clear_m: NotNegative = 0.5
    steering_deg: Annotated[float, Field(gt=0.0, lt=90.0)] = 35.0
    wheel_base_m: Positive = 0.3
    capture_m: Positive = 2.0
    confirm_steps: Annotated[int, Field(ge=1)] = 1
    objective: Objective = "bottleneck"
    margin: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.1
    double: bool = True
    evader_accel_m_s2: NotNegative = 0.1
    doubt_sigmas: NotNegative = 0.5
    most_sigma_m: Positive = 10.0
    forget_s: Positive = 10.0


@dataclass(frozen=True, slots=True)
class Fault:
    """What goes wrong with some nodes from `from_s` to `to_s`, by the time of what they sense.

    - silent: a `group`, or sensors, send nothing;
    - burst: false reports, or false detections, are `factor` times as many everywhere;
    - clock_jump: the times that a group, or sensors, tell are off by `jump_s`;
    - stuck: sensors say `value` in every step.

    Sensors are named, or `count` of them drawn.
    """

    kind: FaultKind
    from_s: NotNegative = 0.0
    to_s: Positive | None = None  # the end of the run
    group: Name | None = None
    sensors: tuple[Name, ...] = ()
    count: Count = 0
    factor: Annotated[float, Field(ge=1.0, allow_inf_nan=False)] = 100.0
    jump_s: Number = 0.0
    value: Number = 1.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """A world to simulate; one section says what is sensed.

    That is one of `signal`, `detection`, `range`, `rssi`, `bearing`, `angular_rate`, `motion`,
    `amplitude`, `energy_message`, `reports`; but cameras, turn rates and motion (`MIXED`) may stand
    in one field, where sensors are of these kinds in turn. Ranges, strengths of beacons and those
    three name their target. Amplitudes of several targets add up as energies do.

    Steps are at 0, step_s, 2 step_s, ... before `duration_s`. The network carries `readings`, or
    the `reports` that are made of them beside the sensors; if not said, reports where signals are
    sensed (they are fused where they are heard) or reports are given, else readings. With `fusion`,
    signals become reports, by a maximum-likelihood fit or by the centroid of Oh (12). With
    `scheduling`, sensors say what they measure only while they are told to sense, in closed loop
    with a tracker; `energy` is what they spend. With `pursuit`, `pursuers` chase the targets.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)

    duration_s: Positive
    region: tuple[Number, Number, Number, Number]  # x_min, y_min, x_max, y_max [m]
    name: Name = "scenario"
    step_s: Positive = 1.0
    seed: Count = 0
    sensors: Sensors | None = None
    signal: SignalModel | None = None
    detection: DetectionModel | None = None
    range: RangeModel | None = None
    rssi: RssiModel | None = None
    bearing: BearingModel | None = None
    angular_rate: AngularRateModel | None = None
    motion: MotionRateModel | None = None
    amplitude: AmplitudeModel | None = None
    energy_message: EnergyMessageModel | None = None
    reports: Reports | None = None
    targets: tuple[Party, ...] = ()
    groups: tuple[Group, ...] = ()
    network: Channel | None = None
    carries: Carried | None = None
    fusion: Fusion | None = None
    faults: tuple[Fault, ...] = ()
    scheduling: SchedulingSettings | None = None
    energy: Energy | None = None
    pursuit: Pursuit | None = None
    pursuers: tuple[Pursuer, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def area(self) -> Region:
        """The region."""
        return Region(*self.region)

    @property
    def steps(self) -> int:
        """How many scans there are."""
        return max(1, math.ceil(self.duration_s / self.step_s - 1e-9))

    @property
    def models(self) -> dict[str, SensorModel]:
        """Models of the sensors by kind; several kinds are those of sensors in turn."""
        found = {kind: getattr(self, kind) for kind in KINDS}
        return {kind: model for kind, model in found.items() if model is not None}

    @property
    def tagged(self) -> dict[str, SensorModel]:
        """Those of the models whose readings name their target."""
        return {kind: model for kind, model in self.models.items() if KINDS[kind].tagged}

    @property
    def carried(self) -> Carried:
        """What the network carries."""
        if self.carries is not None:
            return self.carries
        return "readings" if self.signal is None and self.reports is None else "reports"
