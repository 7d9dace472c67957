"""A beacon that may as well be in two places: clouds in parts, and receivers on a line."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from trackfield.filtering import rssi_tracker
from trackfield.filtering.rssi_cloud import Cloud
from trackfield.filtering.rssi_modes import mirror, mirrored, parted
from trackfield.filtering.scans import Scan
from trackfield.network.site import Site
from trackfield.raster import Region
from trackfield.sensing import rssi
from trackfield.sensing.rssi import RssiModel
from trackfield.types import Status

PLAIN = RssiModel(sigma_db=3.0)


def normal(n, place, sigma, rng):
    return np.asarray(place, float)[:, None] + sigma * rng.standard_normal((2, n))


def even(n):
    return np.full(n, 1.0 / n)


def two(rng, *, apart_m, light=0.5, sigma=0.5, turn=0.6):
    """Draw particles of equal weight in two places, the second of the share `light`."""
    count = round(1000 * light)
    way = apart_m * np.array([math.cos(turn), math.sin(turn)])
    return np.hstack([normal(1000 - count, (2, 1), sigma, rng), normal(count, way, sigma, rng)])


@given(st.integers(0, 1000), st.floats(0.0, 3.2), st.floats(0.2, 3.0))
@settings(max_examples=40)
def test_one_place_of_any_shape_is_not_two(seed, turn, stretch):
    rng = np.random.default_rng(seed)
    c, s = math.cos(turn), math.sin(turn)
    way = np.array([[c, -s], [s, c]]) @ np.diag([3.0, 3.0 * stretch])
    assert not parted(way @ rng.standard_normal((2, 1000)), even(1000))
    assert not parted(way @ rng.uniform(-1, 1, (2, 1000)), even(1000))


@pytest.mark.parametrize(
    ("place", "found"),
    [
        ({"apart_m": 16.0}, True),
        ({"apart_m": 16.0, "light": 0.1}, True),
        ({"apart_m": 16.0, "light": 0.02}, False),
        ({"apart_m": 6.0}, False),
        ({"apart_m": 16.0, "sigma": 2.0}, False),
    ],
)
def test_two_places_far_apart_for_their_size_are_two(place, found):
    rng = np.random.default_rng(3)
    assert parted(two(rng, **place) - [[0.0], [1.0]], even(1000)) == found


def test_places_less_than_a_metre_apart_are_one():
    rng = np.random.default_rng(4)
    far = two(rng, apart_m=9.0, sigma=0.2)
    assert parted(far, even(1000))
    assert not parted(0.05 * far, even(1000))


def test_weights_count_as_copies_do():
    rng = np.random.default_rng(5)
    place = np.hstack([normal(500, (0, 0), 0.5, rng), normal(500, (9, 0), 0.5, rng)])
    w = np.repeat([0.97, 0.03], 500) / 500
    assert parted(place, even(1000))
    assert not parted(place, w)
    assert not parted(np.zeros((2, 3)), even(3))
    assert not parted(np.zeros((2, 1)), even(1))


def test_receivers_on_a_line_have_a_mirror():
    row = np.array([[0.0, 1, 2], [3, 4, 2], [9, 10, 2]])
    found = mirror(row)
    assert found is not None
    assert_allclose(abs(found.along), math.sqrt(0.5))
    assert mirror(row[:1]) is not None
    assert mirror(np.vstack([row, [[5, 0, 2]]])) is None


def test_images_sound_the_same_and_images_of_images_are_the_place():
    rng = np.random.default_rng(6)
    row = np.array([[0.0, 1, 2], [3, 4, 2], [9, 10, 2]])
    line, n = mirror(row), 40
    assert line is not None
    none = np.empty((0, n))
    cloud = Cloud(
        rng.uniform(0, 10, (3, n)),
        rng.standard_normal((3, n)),
        np.ones(n, bool),
        np.zeros(n),
        np.zeros(n),
        np.empty(0, np.int32),
        none,
        none,
        none,
    )
    wide, every = Region(-99.0, -99.0, 99.0, 99.0), np.ones(n, bool)
    image = mirrored(cloud, line, chosen=every, area=wide)
    assert_allclose(
        rssi.distance(row, image.position.T), rssi.distance(row, cloud.position.T), atol=1e-9
    )
    later = rssi.distance(row, (image.position + image.velocity).T)
    assert_allclose(later, rssi.distance(row, (cloud.position + cloud.velocity).T), atol=1e-9)
    again = mirrored(image, line, chosen=every, area=wide)
    assert_allclose(again.position, cloud.position, atol=1e-9)
    assert_allclose(again.velocity, cloud.velocity, atol=1e-9)
    half = mirrored(cloud, line, chosen=np.arange(n) < 20, area=Region(0.0, 0.0, 10.0, 10.0))
    assert_array_equal(half.position[:, 20:], cloud.position[:, 20:])
    assert np.all((half.position[:2] >= 0.0) & (half.position[:2] <= 10.0))
    moved = (half.position != cloud.position).any(axis=0)
    assert 0 < moved.sum() < 20


def heard(positions, place, *, seed, scans=60):
    """Statuses and squared errors in deviations of a beacon that stands, after 5 s."""
    at = np.array(positions, float)
    site = Site("row", tuple(map(str, range(len(at)))), at, (PLAIN,) * len(at))
    tracker = rssi_tracker.create(site, particles=500, seed=seed)
    rng, state = np.random.default_rng(seed), tracker.start()
    mean = rssi.expected(PLAIN, np.hypot(*(at[:, :2] - place).T))
    who, rows = np.arange(len(at), dtype=np.int32), []
    for k in range(scans):
        value = mean + 3.0 * rng.standard_normal(who.size)
        state = tracker.step(state, Scan(0.5 * k, who, value, np.full(who.size, np.nan)))
        shown = tracker.shown(state, 0.5 * k)
        xx, xy, yy = shown.covariance
        off = shown.position[:2] - place
        rows.append((shown.status, off @ np.linalg.solve([[xx, xy], [xy, yy]], off)))
    return rows[10:]


@pytest.mark.parametrize(
    ("positions", "place"),
    [
        ([(0, 0, 2), (20, 0, 2)], (15.7, 4.8)),
        ([(0, 0, 2), (10, 0, 2), (20, 0, 2)], (15.7, 4.8)),
        ([(0, 0, 2), (10, 10, 2), (20, 20, 2)], (15.7, 4.8)),
        ([(0, 0, 2)], (4.0, 3.0)),
    ],
)
def test_of_two_images_neither_is_told_for_sure(positions, place):
    rows = [row for seed in (1, 2) for row in heard(positions, place, seed=seed)]
    tentative = np.mean([status == Status.TENTATIVE for status, _ in rows])
    assert tentative >= 0.9
    wrong = [square > 9.2 for status, square in rows if status == Status.CONFIRMED]
    assert not any(wrong)


def test_with_a_receiver_beside_the_line_the_place_is_told():
    rows = heard([(0, 0, 2), (20, 0, 2), (10, 12, 2)], (8.0, 5.0), seed=1)
    assert all(status == Status.CONFIRMED for status, _ in rows)
    assert np.mean([square < 9.2 for _, square in rows]) >= 0.9


def test_a_survey_or_a_receiver_beside_the_line_takes_the_mirror_away():
    at = np.array([(0.0, 0, 2), (20, 0, 2), (10, 12, 2)])
    site = Site("three", ("A", "B", "C"), at, (PLAIN,) * 3)
    assert rssi_tracker.create(site).prior.mirror is None
    row = replace(site, positions=at * [1.0, 0.0, 1.0])
    assert rssi_tracker.create(row).prior.mirror is not None
