"""What a site tells a tracker of unknown targets: their scene."""

from __future__ import annotations

import math

import numpy as np

from trackfield.association.model import Reporting, Scene, Targets
from trackfield.errors import ConfigurationError
from trackfield.network.detection_by_age import detection_maps
from trackfield.network.site import Site
from trackfield.network.topology import Network, lay_out
from trackfield.raster import Field, Region

_SIGNAL_P = 0.98  # of a source fit: it hardly misses a target that stands alone
_SIGNAL_FALSE_M2 = 1e-5  # per m^2 and scan; less, and leftovers of losses become tracks


def scene(site: Site, *, of_signals: bool = False) -> Scene:
    """Make the scene of a site: targets, and how they give reports; what is open stays None.

    `of_signals`: reports are source fits, of which more is known. `ConfigurationError` lists what
    is missing.
    """
    problems: list[str] = []
    region = watched(site)
    if region is None:
        problems.append(
            f"site {site.name}: reports.region: found nothing and no sensors that span a region, "
            "expected [x_min, y_min, x_max, y_max] in metres"
        )
    step_s = site.reports.step_s
    if step_s is None:
        problems.append(
            f"site {site.name}: reports.step_s: found nothing, expected the time between scans in "
            "seconds (trackfield.settled derives it from data)"
        )
    if site.network is not None and not site.sensor_ids:
        problems.append(
            f"site {site.name}: network: found no sensors whose messages could travel, "
            "expected [[sensors]] or sensors_file"
        )
    if region is None or step_s is None or problems:
        raise ConfigurationError(problems)
    told = site.reports
    p, false = told.p_detection, told.false_per_scan
    if of_signals:
        # What is fitted is what has arrived: lost readings make a fit worse, and seldom undo it.
        by_age = (_SIGNAL_P if p is None else p,)
        false = _SIGNAL_FALSE_M2 * region.area if false is None else false
    else:
        by_age = _by_age(site, region, step_s=step_s, p_sensing=p)
    reporting = Reporting(
        region=region,
        step_s=step_s,
        sigma_m=told.sigma_m,
        p_detection=by_age,
        false_per_scan=false,
    )
    return Scene(reporting, targets(site))


def targets(site: Site) -> Targets:
    """Tell what a site says of targets, and the defaults for what it does not."""
    told = site.target
    accel = told.accel_sigma_m_s2
    return Targets(
        accel_sigma_m_s2=Targets().accel_sigma_m_s2 if accel is None else accel,
        velocity_sigma_m_s=min(told.velocity_sigma_m_s, told.max_speed_m_s),
        lifetime_s=told.lifetime_s,
        births_per_s=told.births_per_s,
        initial_count=told.initial_count,
    )


def watched(site: Site) -> Region | None:
    """Region of a site: as told, or the sensors' bounding box and half their spacing around it."""
    if site.reports.region is not None:
        return site.reports.region
    places = site.positions[:, :2]
    if len(places) < 2:
        return None
    low, high = places.min(axis=0), places.max(axis=0)
    width, height = (float(side) for side in high - low)
    margin = 0.5 * math.sqrt(width * height / len(places))
    if margin <= 0.0:
        return None
    return Region(*(low - margin).tolist(), *(high + margin).tolist())


def network_of(site: Site) -> Network | None:
    """Lay out the site's radio network with its groups' leaders; None if none is told."""
    if site.network is None:
        return None
    leaders = np.array([(group.x_m, group.y_m) for group in site.groups]).reshape(-1, 2)
    return lay_out(site.network, site.positions, leaders)


def _by_age(
    site: Site, region: Region, *, step_s: float, p_sensing: float | None
) -> tuple[Field, ...] | None:
    """Map detection by age; over a network, sensing is sure unless told otherwise."""
    network = network_of(site)
    if network is not None:
        return detection_maps(
            network, region, step_s=step_s, p_sensing=1.0 if p_sensing is None else p_sensing
        )
    return None if p_sensing is None else (p_sensing,)
