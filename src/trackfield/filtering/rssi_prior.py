"""What is believed of a beacon before it is heard: where it may be, how it walks, what lasts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackfield.filtering.range_tracker import height_prior
from trackfield.filtering.rssi_cloud import Cloud, Fading, UsualPaths, Walk, confined, fade, move
from trackfield.filtering.rssi_field import RssiField, field
from trackfield.filtering.rssi_modes import Mirror, mirror, mirrored
from trackfield.network.site import Site, Target
from trackfield.types import Indices, Matrix


@dataclass(frozen=True, slots=True, eq=False)
class RssiPrior:
    """Strengths of a site and the ways of its beacons; made by `rssi_prior`."""

    field: RssiField
    walk: Walk
    fading: Fading
    mirror: Mirror | None  # where receivers stand on a line, and nobody has surveyed

    def spread(self, rng: np.random.Generator, count: int) -> Cloud:
        """Particles anywhere in the area, which know nothing."""
        area, walk = self.field.area, self.walk
        position = np.empty((3, count))
        position[0] = rng.uniform(area.x_min, area.x_max, count)
        position[1] = rng.uniform(area.y_min, area.y_max, count)
        position[2] = walk.height_m + walk.height_sigma_m * rng.standard_normal(count)
        velocity = walk.pace_m_s * rng.standard_normal((3, count))
        velocity[2] = 0.0
        moving = walk.goes_per_s / (walk.goes_per_s + walk.stops_per_s)
        none = np.empty((0, count))
        return Cloud(
            position,
            velocity,
            rng.random(count) < moving,
            self.fading.offset_db * rng.standard_normal(count),
            np.zeros(count),
            np.empty(0, np.int32),
            none,
            none,
            none,
        )

    def usual(self, receivers: Indices, position: Matrix) -> UsualPaths:
        """Tell what is believed of receivers (S,) before anything was heard in a place."""
        models, shape = self.field.models, (receivers.size, position.shape[1])
        blocked = models.p_blocked[receivers]
        return UsualPaths(
            np.broadcast_to(self.field.unknown(receivers, position), shape),
            models.shadow_m[receivers],
            np.broadcast_to(blocked[:, None], shape),
            models.burst_s[receivers] * (1.0 - blocked),
        )

    def moved(self, cloud: Cloud, dt: float, rng: np.random.Generator) -> Cloud:
        """Carry particles over `dt` [s], and let what lasts fade."""
        moved, far = move(cloud, dt, rng, walk=self.walk, fading=self.fading)
        moved = confined(moved, self.field.area)
        usual = self.usual(moved.receiver, moved.position)
        return fade(moved, far, dt, usual=usual, fading=self.fading)

    def on_either_side(self, cloud: Cloud, rng: np.random.Generator) -> Cloud:
        """Cloud in which each particle is, by chance, in its own place or its mirror image's.

        Without a mirror the cloud itself. So neither place is lost by chance in drawing.
        """
        if self.mirror is None:
            return cloud
        chosen = rng.random(cloud.moves.size) < 0.5
        return mirrored(cloud, self.mirror, chosen=chosen, area=self.field.area)


def rssi_prior(site: Site) -> RssiPrior:
    """Prior of the beacons of `site`; `ConfigurationError` if a sensor measures something else."""
    fading = Fading() if site.tracker.self_calibration else Fading(offset_db=0.0)
    found = field(site)
    line = mirror(site.positions) if found.table is None else None
    return RssiPrior(found, walk(site), fading, line)


def walk(site: Site) -> Walk:
    """How beacons of `site` are carried, from what it says of its targets."""
    target: Target = site.target
    usual = Walk()
    pace = usual.pace_m_s
    if target.accel_sigma_m_s2 is not None:
        pace = target.accel_sigma_m_s2 * math.sqrt(0.5 * usual.velocity_time_s)
    height, sigma = height_prior(site)
    if target.dimensions == 3:
        z = site.positions[:, 2]
        height, sigma = float(z.mean()), max(1.0, 0.5 * float(np.ptp(z)))
    stops = 0.0 if target.motion == "cv" else usual.stops_per_s
    return usual._replace(
        pace_m_s=min(pace, target.max_speed_m_s),
        stops_per_s=stops,
        height_m=height,
        height_sigma_m=sigma,
    )
