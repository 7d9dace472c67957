"""What a run of readings looks like beside its site, looked at chunk by chunk."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackfield.network.geometry import geometry
from trackfield.network.kinds import families
from trackfield.network.needs import needs
from trackfield.network.site import Site
from trackfield.network.timing import Timing, no_rows, timed
from trackfield.types import Matrix, Readings, Vector

_LARGE, _SMALL = 50.0, 1 / 200  # of the field's diagonal: ranges beyond are in another unit


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A run so far: when readings came, how many of each sensor (n,).

    `medians` (k, 2) holds number and median value of every chunk; `window_s` is how late a reading
    may come.
    """

    site: Site
    timing: Timing
    per_sensor: Vector
    medians: Matrix
    targets: tuple[str, ...]
    window_s: float

    @property
    def family(self) -> str | None:
        """The family of kinds that the site measures, if it is one."""
        present = families(self.site.models)
        return present[0] if len(present) == 1 else None


def empty_survey(site: Site) -> Survey:
    """Begin a survey for a run on `site`."""
    survey = Survey(
        site=site,
        timing=no_rows(4),
        per_sensor=np.zeros(len(site.sensor_ids)),
        medians=np.empty((0, 2)),
        targets=(),
        window_s=site.tracker.window_s,
    )
    if survey.family not in ("signal", "detection", None):
        return survey
    return replace(survey, window_s=site.tracker.window_steps * (site.reports.step_s or 1.0))


def surveyed(survey: Survey, readings: Readings) -> Survey:
    """Add a chunk of readings, whose sensors are those of the site."""
    if not len(readings):
        return survey
    t = readings.t_s
    rows = np.column_stack([t, readings.sensor, readings.kind, readings.target]).astype(float)
    return replace(
        survey,
        timing=timed(survey.timing, t, rows, window_s=survey.window_s),
        per_sensor=survey.per_sensor
        + np.bincount(readings.sensor, minlength=len(survey.site.sensor_ids)),
        medians=np.vstack([survey.medians, [len(readings), np.median(readings.value)]]),
        targets=readings.target_ids,
    )


def heard(survey: Survey) -> tuple[str, ...]:
    """Name the sensors that said anything."""
    ids = survey.site.sensor_ids
    return tuple(name for name, count in zip(ids, survey.per_sensor, strict=True) if count)


def median_value(survey: Survey) -> float:
    """Find the typical reading: the median over chunks of their medians, by size."""
    order = np.argsort(survey.medians[:, 1])
    weight = np.cumsum(survey.medians[order, 0])
    return float(survey.medians[order[np.searchsorted(weight, 0.5 * weight[-1])], 1])


def unit_suspicion(survey: Survey) -> str | None:
    """Say if readings seem to be in another unit than they should; None if not."""
    if not survey.timing.rows:
        return None
    typical = median_value(survey)
    if survey.family == "rssi":
        return _of_strengths(typical)
    span = geometry(survey.site).span_m
    if span <= 0.0 or survey.family != "range":
        return None
    if _SMALL * span <= typical <= _LARGE * span:
        return None
    kind = "large" if typical > span else "small"
    return (
        f"ranges are {typical:g} m in the middle, on a field of {span:g} m: far too {kind}; are "
        "both in metres? a factor of 1000 makes millimetres or kilometres of them"
    )


def _of_strengths(typical: float) -> str | None:
    if typical < 0.0:
        return None
    return (
        f"strengths are {typical:g} dBm in the middle: beacons are heard with less than 0 dBm; is "
        "the sign missing, or are they a quality of some other scale?"
    )


def data_problems(survey: Survey) -> tuple[str, ...]:
    """Say what keeps a run from being tracked: nothing said, too few sensors, a line, units."""
    if not survey.timing.rows:
        return ("found no readings, expected at least three of three sensors",)
    speaking = heard(survey)
    problems: list[str] = []
    if len(speaking) < len(survey.site.sensor_ids):
        found = needs(survey.site, speaking).problems
        problems += [f"of the sensors that say anything: {problem}" for problem in found]
    suspicion = unit_suspicion(survey)
    return (*problems, suspicion) if suspicion else tuple(problems)
