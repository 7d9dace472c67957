"""What a run of readings looks like beside its site, looked at chunk by chunk."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trackfield.network.geometry import geometry
from trackfield.network.site import Site
from trackfield.types import Matrix, Readings, Vector

_TAIL = 4096  # readings of the last chunk that are remembered, to find their copies
_LARGE, _SMALL = 50.0, 1 / 200  # of the field's diagonal: ranges beyond are in another unit


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Counts of a run so far: readings in all and per sensor (n,), those repeated or late.

    `medians` (k, 2) holds number and median value of every chunk; `late_s` is how far behind the
    newest one a reading came at most, `behind` how many came more than the site's window behind.
    """

    site: Site
    readings: int
    per_sensor: Vector
    first_s: float
    last_s: float
    longest_gap_s: float
    repeated: int
    unordered: int
    late_s: float
    behind: int
    medians: Matrix
    targets: tuple[str, ...]
    tail: Matrix


def empty_survey(site: Site) -> Survey:
    """Begin a survey for a run on `site`."""
    return Survey(
        site=site,
        readings=0,
        per_sensor=np.zeros(len(site.sensor_ids)),
        first_s=math.inf,
        last_s=-math.inf,
        longest_gap_s=0.0,
        repeated=0,
        unordered=0,
        late_s=0.0,
        behind=0,
        medians=np.empty((0, 2)),
        targets=(),
        tail=np.empty((0, 4)),
    )


def surveyed(survey: Survey, readings: Readings) -> Survey:
    """Add a chunk of readings, whose sensors are those of the site."""
    if not len(readings):
        return survey
    t = readings.t_s
    newest = np.maximum.accumulate(np.maximum(t, survey.last_s))
    before = np.concatenate([[survey.last_s], newest[:-1]])
    late = np.where(np.isfinite(before), before - t, 0.0)
    forward = np.where(np.isfinite(before), newest - before, 0.0)
    rows = np.column_stack([t, readings.sensor, readings.kind, readings.target]).astype(float)
    known = np.concatenate([survey.tail, rows])
    new = _distinct(known) - _distinct(survey.tail)
    return replace(
        survey,
        readings=survey.readings + len(readings),
        per_sensor=survey.per_sensor
        + np.bincount(readings.sensor, minlength=len(survey.site.sensor_ids)),
        first_s=min(survey.first_s, float(t.min())),
        last_s=float(newest[-1]),
        longest_gap_s=max(survey.longest_gap_s, float(forward.max())),
        repeated=survey.repeated + len(readings) - new,
        unordered=survey.unordered + int(np.count_nonzero(late > 0.0)),
        late_s=max(survey.late_s, float(late.max())),
        behind=survey.behind + int(np.count_nonzero(late > survey.site.tracker.window_s)),
        medians=np.vstack([survey.medians, [len(readings), np.median(readings.value)]]),
        targets=readings.target_ids,
        tail=known[-_TAIL:],
    )


def _distinct(rows: Matrix) -> int:
    """Count the rows (n, k) that differ."""
    ordered = rows[np.lexsort(rows.T)]
    return len(rows) - int(np.count_nonzero((ordered[1:] == ordered[:-1]).all(axis=1)))


def heard(survey: Survey) -> tuple[str, ...]:
    """Name the sensors that said anything."""
    ids = survey.site.sensor_ids
    return tuple(name for name, count in zip(ids, survey.per_sensor, strict=True) if count)


def median_range(survey: Survey) -> float:
    """Find the typical reading [m]: the median over chunks of their medians, by size."""
    order = np.argsort(survey.medians[:, 1])
    weight = np.cumsum(survey.medians[order, 0])
    return float(survey.medians[order[np.searchsorted(weight, 0.5 * weight[-1])], 1])


def unit_suspicion(survey: Survey) -> str | None:
    """Say if ranges and places of sensors seem to be in different units; None if not."""
    span = geometry(survey.site).span_m
    if not survey.readings or span <= 0.0:
        return None
    typical = median_range(survey)
    if _SMALL * span <= typical <= _LARGE * span:
        return None
    kind = "large" if typical > span else "small"
    return (
        f"ranges are {typical:g} m in the middle, on a field of {span:g} m: far too {kind}; are "
        "both in metres? a factor of 1000 makes millimetres or kilometres of them"
    )


def data_problems(survey: Survey) -> tuple[str, ...]:
    """Say what keeps a run from being tracked: nothing said, too few sensors, a line, units."""
    if not survey.readings:
        return ("found no readings, expected at least three of three sensors",)
    speaking = heard(survey)
    problems: list[str] = []
    if len(speaking) < len(survey.site.sensor_ids):
        found = geometry(survey.site, speaking).problems
        problems += [f"of the sensors that say anything: {problem}" for problem in found]
    suspicion = unit_suspicion(survey)
    return (*problems, suspicion) if suspicion else tuple(problems)
