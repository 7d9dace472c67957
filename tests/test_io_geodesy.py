"""The local frame on the Earth: there and back, and against formulas found another way."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from trackfield.io.geodesy import to_geographic, to_local
from trackfield.network.site import Origin

A, B = 6378137.0, 6356752.314245179  # semi-axes of WGS84 [m]

origins = st.builds(
    Origin,
    lat=st.floats(-89.9, 89.9),
    lon=st.floats(-180, 180),
    alt=st.floats(-400, 9000),
    rotation_deg=st.floats(-360, 360),
)
points = st.lists(
    st.tuples(st.floats(-2e5, 2e5), st.floats(-2e5, 2e5), st.floats(-1e3, 1e5)),
    min_size=1,
    max_size=10,
)


@given(origin=origins, listed=points)
def test_there_and_back(origin, listed):
    position = np.array(listed)
    np.testing.assert_allclose(
        to_local(to_geographic(position, origin), origin), position, atol=1e-6
    )


@given(origin=origins, listed=points)
def test_there_and_back_in_the_plane(origin, listed):
    position = np.array(listed)
    position[:, 2] = np.nan
    geographic = to_geographic(position, origin)
    assert np.isnan(geographic[:, 2]).all()
    np.testing.assert_allclose(to_local(geographic, origin), position, rtol=0, atol=1e-6)


def test_the_origin_is_the_origin():
    origin = Origin(lat=-33.9, lon=151.2, alt=12.0, rotation_deg=77.0)
    np.testing.assert_allclose(
        to_geographic(np.zeros((1, 3)), origin), [[151.2, -33.9, 12.0]], rtol=0, atol=1e-9
    )


def on_ellipsoid(lat: float, lon: float) -> np.ndarray:
    """Point of the ellipsoid whose normal has this latitude, by the gradient of x^2/a^2 + ..."""
    normal = np.array(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    )  # a point p with diag(1/a^2, 1/a^2, 1/b^2) p parallel to the normal
    p = np.array([A**2, A**2, B**2]) * normal
    return p / np.sqrt((p**2 / np.array([A**2, A**2, B**2])).sum())


def test_latitude_is_that_of_the_normal_of_the_ellipsoid():
    """Solve for the foot of the perpendicular: p = foot + alt n; no formula of geodesy is used."""
    origin = Origin(lat=52.5, lon=13.4, alt=34.0, rotation_deg=-25.0)
    lat0, lon0, turn = np.radians([origin.lat, origin.lon, origin.rotation_deg])
    up = np.array([np.cos(lat0) * np.cos(lon0), np.cos(lat0) * np.sin(lon0), np.sin(lat0)])
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    x_axis = np.cos(turn) * east + np.sin(turn) * north  # turned counter-clockwise from east
    y_axis = np.cross(up, x_axis)
    centre = on_ellipsoid(lat0, lon0) + origin.alt * up

    position = np.array([[0, 0, 0], [5e3, -2e3, 10.0], [-3e4, 4e4, -5.0], [100.0, 0, 2e4]])
    for local, (lon, lat, alt) in zip(position, to_geographic(position, origin), strict=True):
        point = centre + local[0] * x_axis + local[1] * y_axis + local[2] * up

        def missed(unknown, point=point):
            la, lo, height = unknown
            n = np.array([np.cos(la) * np.cos(lo), np.cos(la) * np.sin(lo), np.sin(la)])
            return on_ellipsoid(la, lo) + height * 1e6 * n - point

        found = least_squares(missed, [lat0, lon0, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        np.testing.assert_allclose(np.radians([lat, lon]), found[:2], rtol=0, atol=1e-12)
        assert abs(alt - found[2] * 1e6) < 1e-5


def test_small_steps_are_those_of_the_radii_of_curvature():
    """A degree of latitude and longitude near the ground, by M and N cos(lat)."""
    origin = Origin(lat=60.0, lon=20.0)
    e2 = 1 - (B / A) ** 2
    w = np.sqrt(1 - e2 * np.sin(np.radians(60.0)) ** 2)
    meridian, parallel = A * (1 - e2) / w**3, A / w * np.cos(np.radians(60.0))
    lon, lat, _ = to_geographic(np.array([[1.0, 1.0, 0.0]]), origin)[0]
    assert abs(np.radians(lat - 60.0) * meridian - 1) < 1e-6
    assert abs(np.radians(lon - 20.0) * parallel - 1) < 1e-6


def test_rotation_turns_the_local_axes_counter_clockwise_from_east():
    east = to_geographic(np.array([[10.0, 0.0, 0.0]]), Origin(lat=10.0, lon=20.0))
    turned = to_geographic(
        np.array([[0.0, -10.0, 0.0]]), Origin(lat=10.0, lon=20.0, rotation_deg=90.0)
    )
    north = to_geographic(
        np.array([[10.0, 0.0, 0.0]]), Origin(lat=10.0, lon=20.0, rotation_deg=90.0)
    )
    np.testing.assert_allclose(turned, east, rtol=0, atol=1e-9)
    assert north[0, 1] > 10.0 + 8e-5
    assert abs(north[0, 0] - 20.0) < 1e-9
