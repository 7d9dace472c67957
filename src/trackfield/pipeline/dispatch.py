"""Which operator serves which data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from trackfield.errors import InputError
from trackfield.filtering import angle_tracker, rssi_tracker
from trackfield.filtering.scans import ScanFilter, State
from trackfield.network.kinds import KINDS, Family
from trackfield.network.site import Site
from trackfield.pipeline.fronts import Source, Table
from trackfield.pipeline.runs import ReadingsTracker
from trackfield.pipeline.scanned import ScanTracker
from trackfield.pipeline.tagged import Tracker
from trackfield.pipeline.trajectories import TrajectoryTracker
from trackfield.pipeline.untagged import Feed
from trackfield.types import Readings, Reports

_UNKNOWN: dict[Family, Source] = {"signal": "signal", "detection": "detection"}


def tracker_of(
    site: Site,
    family: Family,
    *,
    lag_s: float = 0.0,
    lag_steps: int = 0,
    every_s: float = 0.0,
) -> ReadingsTracker:
    """Make the operator of readings of a family; `ConfigurationError` if the site is not of it."""
    asked: dict[str, Any] = {"lag_s": lag_s, "lag_steps": lag_steps, "every_s": every_s}
    if family == "range":
        return Tracker(site, **asked)
    if family in ("amplitude", "energy_message"):
        return TrajectoryTracker(site, **asked)
    if family == "rssi":
        return _scanned(site, rssi_tracker.create, asked)
    if family == "angle":
        return _scanned(site, angle_tracker.create, asked)
    raise InputError(f"found readings of kind {family!r}, whose targets have no names")


def _scanned(
    site: Site, create: Callable[[Site], ScanFilter[State]], asked: Mapping[str, Any]
) -> ScanTracker[State]:
    """Put an operator around a filter; targets that have models of their own have their own."""
    own = {
        name: create(replace(site, models=models)) for name, models in site.target_models.items()
    }
    return ScanTracker(site, create(site), own=own, **asked)


def feed_of(table: Table, *, seed: int = 0) -> Feed | None:
    """Tell by the first rows of a run how it is tracked; None where `tracker_of` says it.

    Binary sensors that say 0 at all say it always.
    """
    source = source_of(table)
    if source is None:
        return None
    says_zero = (
        source == "detection" and isinstance(table, Readings) and bool(np.any(table.value == 0.0))
    )
    return Feed(source, seed, says_zero)


def source_of(table: Table) -> Source | None:
    """Tell what a table of unknown targets is; None for readings that `tracker_of` tracks.

    `InputError` where there are readings that are not tracked together.
    """
    return "reports" if isinstance(table, Reports) else _UNKNOWN.get(family_of(table))


def family_of(readings: Readings) -> Family:
    """Tell which family the readings of a run are of, by its first rows; no rows are ranges.

    `InputError` where there are several families: they are tracked one at a time.
    """
    present = [readings.kinds[int(kind)] for kind in np.unique(readings.kind)]
    families: list[Family] = list(dict.fromkeys(KINDS[kind].family for kind in present))
    if len(families) > 1:
        raise InputError(
            f"found readings of kinds {', '.join(present)}, expected one kind: "
            "but for bearing, angular_rate and motion, they are tracked one kind at a time"
        )
    return families[0] if families else "range"
