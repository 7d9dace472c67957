"""What is believed of targets and reports before any is seen: one value for all trackers."""

from __future__ import annotations

from dataclasses import dataclass

from trackfield.raster import Field, Region

USUAL_BIRTHS_PER_S = 0.1
"""In the whole region: what trackers take that cannot learn it."""


@dataclass(frozen=True, slots=True)
class Targets:
    """How targets appear, move and end.

    Between scans `dt_s` apart a target moves by x' = F x + G u, u ~ N(0, accel_sigma_m_s2^2) held
    over each of the dt_s / step_s steps (Oh (6)); one that appears has a velocity of
    `velocity_sigma_m_s` per axis and a position anywhere in the region (or as `birth_map` says).
    Births that are None are learned on line where the tracker can (`USUAL_BIRTHS_PER_S` elsewhere).
    """

    accel_sigma_m_s2: float = 0.15
    velocity_sigma_m_s: float = 1.0
    lifetime_s: float = 50.0  # mean; survival of a step is exp(-step_s / lifetime_s)
    hazard: tuple[float, ...] = ()  # told by age: probability to end in step 1, 2, ... of a life
    births_per_s: float | None = None  # in the whole region
    initial_count: float = 1.0  # expected number of targets when the run begins
    birth_map: Field = 1.0  # relative density of births over the region
    survival_map: Field = 1.0  # factor of a step's survival, below 1 where targets tend to leave


@dataclass(frozen=True, slots=True)
class Reporting:
    """How targets give reports and what else does.

    `p_detection[a]` is the probability that a report of a target has been made and has arrived by
    the time the newest scan is `a` steps later (the last entry holds from there on); a network
    without delay has one entry. What is None is learned on line.
    """

    region: Region
    step_s: float = 1.0
    sigma_m: float | None = None  # of a report that brings no covariance of its own, per axis
    p_detection: tuple[Field, ...] | None = None
    false_per_scan: float | None = None  # expected, in the whole region
    false_map: Field = 1.0  # relative density of false reports over the region


@dataclass(frozen=True, slots=True)
class Scene:
    """Targets and their reports: all that a tracker is told."""

    reporting: Reporting
    targets: Targets = Targets()
