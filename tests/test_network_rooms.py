"""Rooms: who is where, how likely, and plans that are refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from trackfield.errors import ConfigurationError
from trackfield.network.rooms import room_at, room_faults, room_shares, shares_of_places
from trackfield.network.site import Room, Site
from trackfield.network.site_file import site_from_toml
from trackfield.network.site_writer import site_text


def box(name, x0, y0, x1, y1):
    return Room(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


WEST, EAST = box("west", 0.0, 0.0, 3.0, 4.0), box("east", 3.0, 0.0, 6.0, 4.0)
CORNER = Room("corner", ((0.0, 4.0), (6.0, 4.0), (6.0, 6.0), (2.0, 6.0), (2.0, 9.0), (0.0, 9.0)))
HOME = (WEST, EAST, CORNER)


def test_a_place_is_in_its_room_and_a_wall_belongs_to_the_first():
    places = np.array(
        [[1, 1], [5, 1], [3, 2], [1, 4], [1, 8], [3, 8], [-1, 1], [7, 1], [5.5, 5]], float
    )
    assert room_at(HOME, places).tolist() == [0, 1, 0, 0, 2, -1, -1, -1, 2]
    assert room_at((), places).tolist() == [-1] * 9
    assert room_at(HOME, np.zeros((2, 3, 2))).shape == (2, 3)


@given(st.floats(-1, 7), st.floats(-1, 5), st.floats(0.05, 2.0), st.floats(0.05, 2.0))
def test_shares_are_those_of_a_gaussian(x, y, sx, sy):
    found = room_shares((WEST, EAST), np.array([[x, y]]), np.array([[sx**2, 0.0, sy**2]]))[0]
    across = norm.cdf(4.0, y, sy) - norm.cdf(0.0, y, sy)
    west = (norm.cdf(3.0, x, sx) - norm.cdf(0.0, x, sx)) * across
    east = (norm.cdf(6.0, x, sx) - norm.cdf(3.0, x, sx)) * across
    np.testing.assert_allclose(found, [west, east, 1.0 - west - east], atol=0.025)
    assert found.sum() == pytest.approx(1.0)


def test_shares_follow_a_covariance_that_leans():
    rng = np.random.default_rng(3)
    covariance = np.array([[1.0, -0.8, 1.2], [1.0, 0.8, 1.2], [0.0, 0.0, 0.0]])
    mean = np.array([[2.5, 4.2], [2.5, 4.2], [4.0, 2.0]])
    found = room_shares(HOME, mean, covariance)
    for row in range(2):
        xx, xy, yy = covariance[row]
        drawn = rng.multivariate_normal(mean[row], [[xx, xy], [xy, yy]], 200_000)
        counts = np.bincount(room_at(HOME, drawn) % 4, minlength=4) / 200_000
        np.testing.assert_allclose(found[row], counts, atol=0.02)
    assert found[0, 0] - found[1, 0] > 0.05 or found[1, 0] - found[0, 0] > 0.05
    assert found[2].tolist() == [0.0, 1.0, 0.0, 0.0]


def test_many_rows_give_what_each_gives_alone():
    rng = np.random.default_rng(4)
    mean = rng.uniform(-1, 9, (5000, 2))
    covariance = np.column_stack([np.ones(5000), np.zeros(5000), np.ones(5000)])
    found = room_shares(HOME, mean, covariance)
    for row in (0, 4095, 4096, 4999):
        alone = room_shares(HOME, mean[row : row + 1], covariance[:1])
        np.testing.assert_array_equal(found[row], alone[0])


def test_shares_of_weighted_places():
    places = np.array([[1.0, 1.0], [2.0, 2.0], [5.0, 1.0], [9.0, 9.0]])
    found = shares_of_places(HOME, places, np.array([1.0, 1.0, 1.0, 5.0]))
    np.testing.assert_allclose(found, [0.25, 0.125, 0.0, 0.625])


def test_rooms_that_share_walls_are_sound():
    assert list(room_faults(HOME)) == []
    around = Room(
        "ring", ((-1.0, -1.0), (7.0, -1.0), (7.0, 0.0), (0.0, 0.0), (0.0, 9.0), (-1.0, 9.0))
    )
    assert list(room_faults((*HOME, around))) == []


@pytest.mark.parametrize(
    ("rooms", "expected"),
    [
        ((Room("a", ((0.0, 0.0), (1.0, 1.0))),), (0, "polygon: found 2 corners")),
        (
            (Room("a", ((0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0))),),
            (0, "polygon: found sides that cross"),
        ),
        ((WEST, box("west", 7.0, 0.0, 8.0, 1.0)), (1, "id: found 'west' a second time")),
        ((WEST, box("", 7.0, 0.0, 8.0, 1.0)), (1, "id: found ''")),
        ((WEST, box("b", 2.0, 1.0, 4.0, 2.0)), (1, "polygon: found an overlap with 'west'")),
        ((WEST, box("same", 0.0, 0.0, 3.0, 4.0)), (1, "polygon: found an overlap")),
        ((WEST, box("inner", 1.0, 1.0, 2.0, 2.0)), (1, "polygon: found an overlap")),
        ((box("inner", 1.0, 1.0, 2.0, 2.0), WEST), (1, "polygon: found an overlap with 'inner'")),
        # A plus: no corner of one is inside the other.
        ((box("a", 0.0, 2.0, 6.0, 3.0), box("b", 2.0, 0.0, 3.0, 6.0)), (1, "polygon: found an ov")),
        # All corners on the other's border.
        (
            (WEST, Room("diamond", ((1.5, 0.0), (3.0, 2.0), (1.5, 4.0), (0.0, 2.0)))),
            (1, "polygon: found an overlap"),
        ),
    ],
)
def test_rooms_that_cannot_be_are_refused(rooms, expected):
    ((number, fault),) = room_faults(rooms)
    assert number == expected[0]
    assert fault.startswith(expected[1])


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_an_overlap_is_found_where_places_are_in_both(seed):
    rng = np.random.default_rng(seed)

    def star(name):
        angle = np.sort(rng.uniform(0.0, 2.0 * math.pi, 6)) + np.arange(6) * 1e-3
        radius = rng.uniform(0.5, 2.0, 6)
        centre = rng.uniform(0.0, 4.0, 2)
        corners = centre + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        return Room(name, tuple((float(x), float(y)) for x, y in corners))

    rooms = (star("a"), star("b"))
    faults = list(room_faults(rooms))
    if any("overlap" not in fault for _, fault in faults):
        return  # a star that is no polygon
    x = np.linspace(-2.0, 6.0, 161)
    grid = np.stack(np.meshgrid(x, x), axis=-1)
    both = (room_at(rooms[:1], grid) == 0) & (room_at(rooms[1:], grid) == 0)
    # A grid misses slivers, so that an overlap without a grid point proves nothing.
    assert faults or not both.any()
    if faults and not both.any():
        fine = rng.uniform(-2.0, 6.0, (200_000, 2))
        near = (room_at(rooms[:1], fine) == 0) & (room_at(rooms[1:], fine) == 0)
        assert near.mean() < 0.01


TOML = """
[[sensors]]
sensor_id = "A"
x_m = 0
y_m = 0
[[rooms]]
id = "hall"
polygon = [[0, 0], [4, 0], [4, 3]]
"""


def test_rooms_of_a_site_are_read_and_written(tmp_path):
    site = site_from_toml(TOML, tmp_path)
    assert site.rooms == (Room("hall", ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0))),)
    assert site_from_toml(site_text(site, tmp_path), tmp_path).rooms == site.rooms
    assert Site("s", (), np.empty((0, 3)), ()).rooms == ()


@pytest.mark.parametrize(
    ("rooms", "expected"),
    [
        ("id = 'a'\npolygon = [[0, 0], [1, 1]]", "rooms[2].polygon: found 2 corners, expected at"),
        ("id = 'a'\npolygon = [[0, 0], [1]]", "rooms[2].polygon: found a list, expected at least"),
        ("id = 'a'", "rooms[2].polygon: found nothing"),
        ("polygon = [[0, 0], [1, 0], [0, -1]]", "rooms[2].id: found nothing"),
        ("id = 'hall'\npolygon = [[0, 0], [1, 0], [0, -1]]", "rooms[2].id: found 'hall' a second"),
        ("id = 'a'\npolygon = [[0, 0], [4, 0], [4, 3]]", "found an overlap with 'hall'"),
        ("id = 'a'\npolygon = [[0, 0], [2, 0], [1, 0]]", "rooms[2].polygon: found sides that"),
        ("id = 'a'\nname = 'b'\npolygon = [[0, 0], [1, 0], [0, -1]]", "found an unknown key"),
    ],
)
def test_a_fault_of_a_room_is_told_with_its_place(tmp_path, rooms, expected):
    with pytest.raises(ConfigurationError) as caught:
        site_from_toml(f"{TOML}[[rooms]]\n{rooms}\n", tmp_path)
    assert any(expected in line for line in caught.value.problems), caught.value.problems
