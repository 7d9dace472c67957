"""What the tracker of angles starts from: how targets move, where they are, what silence says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.filtering.angle_readings import AngleSensors, Says
from trackfield.filtering.angle_start import Search
from trackfield.filtering.angle_step import AngleMotions
from trackfield.network.site import Site

_STRAIGHT = 0.0003  # density of acceleration [m^2/s^3] of targets that go straight
_BENDING = 0.012  # of those that turn gently,
_MANOEUVRING = 0.5  # and of others
_STAYS_S = (10.0, 5.0, 2.0)  # how long each lasts
_FIELD_M = 10.0  # in smaller fields targets are slower too: densities fall with the square
_CROSSING_S = 2.0  # a usual target takes so long to cross the field, or longer


class AngleSettings(NamedTuple):
    """What a tracker of angles starts from.

    `search` says where to look for targets and how fast they are; a track of which nothing was
    heard for `drop_s` ends. `silence`: all sensors with a threshold sample at the times of the
    scans, so that those that are not in one say that little turns.
    """

    motions: AngleMotions
    search: Search
    drop_s: float
    silence: bool

    @property
    def dimensions(self) -> int:
        """Of the space that targets move in."""
        return self.search.lower.size


def settings(site: Site, sensors: AngleSensors) -> AngleSettings:
    """Settle what the tracker of a site starts from, see `create`."""
    d = site.target.dimensions
    place = site.positions[:, :d] if d == 2 else sensors.place
    size = float(np.ptp(place, axis=0).max()) if len(place) else 0.0
    if not size > 0.0:
        raise ConfigurationError(
            [f"site {site.name}: found sensors at one place, which tells angles no distance"]
        )
    if d == 3 and not np.any(sensors.says == Says.MOTION):
        raise ConfigurationError(
            [
                f"site {site.name}: found target.dimensions 3 and no sensor of kind 'motion', "
                "expected 2: bearings and angular rates are about the vertical and tell no height"
            ]
        )
    margin = 0.5 * size
    speed = min(site.target.max_speed_m_s, size / _CROSSING_S)
    search = Search(place.min(axis=0) - margin, place.max(axis=0) + margin, speed)
    silence = bool(np.any(sensors.threshold > 0.0))
    return AngleSettings(_motions(site, size), search, site.tracker.drop_s, silence)


def _motions(site: Site, size_m: float) -> AngleMotions:
    told = site.target.accel_sigma_m_s2
    small = min(1.0, size_m / _FIELD_M) ** 2
    manoeuvring = small * _MANOEUVRING if told is None else told**2
    if site.target.motion == "cv":
        return AngleMotions((manoeuvring,), (1.0,))
    straight = min(small * _STRAIGHT, manoeuvring)
    bending = min(small * _BENDING, manoeuvring)
    return AngleMotions((straight, bending, manoeuvring), _STAYS_S)
