"""The local frame on the Earth: WGS84 longitude and latitude of local metres, and back.

The local plane touches the ellipsoid at the origin, so a point 10 km away with z = 0 stands about
8 m above it. Formulas after Hofmann-Wellenhof, GNSS (2008), 8.2; latitude after Bowring (1976).
"""

from __future__ import annotations

import numpy as np

from trackfield.network.site import Origin
from trackfield.types import Matrix, Vector

_A = 6378137.0  # semi-major axis [m]
_F = 1 / 298.257223563  # flattening
_B = _A * (1 - _F)
_E2 = _F * (2 - _F)
_EP2 = _E2 / (1 - _E2)
_ROUNDS = 3  # of Bowring's iteration: full precision up to far above the ground


def to_geographic(position: Matrix, origin: Origin) -> Matrix:
    """Longitude [deg], latitude [deg], altitude [m] of local points, (n, 3) of (n, 3) [m].

    A point of unknown height (z NaN) is taken in the plane z = 0, and its altitude is NaN.
    """
    turn = _turn(origin)
    height = np.isnan(position[:, 2])
    local = np.where(np.isnan(position), 0.0, position)
    cartesian = _centre(origin) + local @ turn.T
    x, y, z = cartesian.T
    across = np.hypot(x, y)
    reduced = np.arctan2(z * _A, across * _B)
    lat = reduced
    for _ in range(_ROUNDS):
        lat = np.arctan2(
            z + _EP2 * _B * np.sin(reduced) ** 3, across - _E2 * _A * np.cos(reduced) ** 3
        )
        reduced = np.arctan2(_B * np.sin(lat), _A * np.cos(lat))
    normal = _A * np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    alt = across * np.cos(lat) + z * np.sin(lat) - normal
    return np.column_stack(
        [np.degrees(np.arctan2(y, x)), np.degrees(lat), np.where(height, np.nan, alt)]
    )


def to_local(geographic: Matrix, origin: Origin) -> Matrix:
    """Local points [m] of longitude [deg], latitude [deg], altitude [m], (n, 3) of (n, 3).

    A point of unknown altitude (NaN) is put where its vertical meets the plane z = 0; its z is NaN.
    """
    lon, lat = np.radians(geographic[:, 0]), np.radians(geographic[:, 1])
    unknown = np.isnan(geographic[:, 2])
    alt = np.where(unknown, 0.0, geographic[:, 2])
    turn = _turn(origin)
    local = (_cartesian(lon, lat, alt) - _centre(origin)) @ turn
    up = _up(lon, lat) @ turn
    local -= np.where(unknown, local[:, 2] / up[:, 2], 0.0)[:, None] * up
    local[unknown, 2] = np.nan
    return local


def _cartesian(lon: Vector, lat: Vector, alt: Vector) -> Matrix:
    """Earth-centred, Earth-fixed coordinates, (n, 3) [m]."""
    normal = _A / np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    across = (normal + alt) * np.cos(lat)
    return np.column_stack(
        [across * np.cos(lon), across * np.sin(lon), (normal * (1 - _E2) + alt) * np.sin(lat)]
    )


def _up(lon: Vector, lat: Vector) -> Matrix:
    """Outward verticals in the Earth's frame, (n, 3)."""
    return np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def _centre(origin: Origin) -> Vector:
    lon, lat = np.radians([origin.lon]), np.radians([origin.lat])
    return _cartesian(lon, lat, np.array([origin.alt]))[0]


def _turn(origin: Origin) -> Matrix:
    """Directions of the local axes in the Earth's frame, one a column."""
    lon, lat, turn = np.radians([origin.lon, origin.lat, origin.rotation_deg])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    up = _up(np.array([lon]), np.array([lat]))[0]
    return np.column_stack(
        [np.cos(turn) * east + np.sin(turn) * north, np.cos(turn) * north - np.sin(turn) * east, up]
    )
