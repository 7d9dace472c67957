"""Who should sense a target at one place: the best k of a site's sensors, and what others know."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.localization.information import site_gains
from trackfield.network.site import Site
from trackfield.scheduling.criteria import Criterion, Known, known
from trackfield.scheduling.selection import Selection, select
from trackfield.types import Indices, Matrix, Vector


class PointPlan(NamedTuple):
    """Sensors for a target at `position` (d,) [m], by what their readings leave unknown.

    `reach` (m,) are the site's sensors that say something of the place, `distance_m` (m,) theirs;
    `chosen` (k,) are the selected ones and `selection` what is known of them (its own numbers are
    places in `reach`); `nearest` is what as many nearest ones know, `all` what all in reach do.
    """

    position: Vector
    reach: Indices
    distance_m: Vector
    chosen: Indices
    selection: Selection
    nearest: Known
    all: Known


def plan_point(
    site: Site,
    position: Vector,
    k: int,
    *,
    criterion: Criterion = "A",
    velocity: Vector | None = None,
) -> PointPlan:
    """Select k sensors of `site` for a target at `position` (d,) [m], d the site's dimensions.

    Angular rates tell a place only of a target whose `velocity` (d,) [m/s] is known. `InputError`
    for a position of another size, and for a site without sensors.
    """
    d = site.target.dimensions
    p = np.asarray(position, np.float64)
    if p.shape != (d,) or not np.isfinite(p).all():
        raise InputError(f"position: found {p.tolist()}, expected {d} finite coordinates")
    if not site.sensor_ids:
        raise InputError(f"site {site.name}: found no sensors, expected some to select from")
    state = p if velocity is None else np.concatenate([p, np.asarray(velocity, np.float64)])
    gains = site_gains(site, state)[:, :d]
    reach = np.flatnonzero(gains.any(axis=1)).astype(np.int32)
    distance = _distance(site, p)[reach]
    own, nothing = gains[reach], np.zeros((d, d))
    selection = select(own, k, criterion=criterion)
    near = np.argsort(distance, kind="stable")[:k]
    return PointPlan(
        p,
        reach,
        distance,
        reach[selection.sensors],
        selection,
        known(own[near], prior=nothing, criterion=criterion),
        known(own, prior=nothing, criterion=criterion),
    )


def _distance(site: Site, position: Vector) -> Vector:
    """Distances (n,) [m] of all sensors, heights counted where both sides have one."""
    offsets: Matrix = site.positions[:, : position.size] - position
    if position.size == 2 and site.target.height_m is not None:
        rise = np.nan_to_num(site.positions[:, 2] - site.target.height_m)
        offsets = np.column_stack([offsets, rise])
    return np.linalg.norm(offsets, axis=1)
