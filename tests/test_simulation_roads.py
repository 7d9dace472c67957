import math

import numpy as np
import pytest

from trackfield.sensing.range import Nlos, RangeModel
from trackfield.simulation import roads


def rng(seed=0):
    return np.random.default_rng(seed)


def test_the_roads_are_those_of_the_paper():
    ab = np.array([1.0, 0.3]) / math.hypot(1.0, 0.3)
    b = np.array([0.0, 2.0]) + 40.0 * ab
    c = b + 30.0 * np.array([ab[1], -ab[0]])  # a right turn
    d = b + 30.0 * np.array([math.cos(math.radians(-10)), math.sin(math.radians(-10))])
    for end, goal in (("C", c), ("D", d)):
        way = np.array([0.0, 20.0, roads.road_length(end)])
        points, tangents = roads.centre_line(end, way)
        np.testing.assert_allclose(points[0], [0.0, 2.0])
        np.testing.assert_allclose(points[1], [0.0, 2.0] + 20.0 * ab)
        np.testing.assert_allclose(points[2], goal, atol=1e-9)
        np.testing.assert_allclose(tangents[2], (goal - b) / 30.0, atol=1e-12)


@pytest.mark.parametrize("end", ["C", "D"])
def test_the_centre_line_is_smooth_with_a_corner_of_two_and_a_half_metres(end):
    way = np.arange(0.0, roads.road_length(end), 0.001)
    points, tangents = roads.centre_line(end, way)
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0, atol=1e-12)
    moved = np.diff(points, axis=0) / 0.001
    np.testing.assert_allclose(moved, tangents[:-1], atol=5e-4)
    heading = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
    curvature = np.abs(np.diff(heading)) / 0.001
    assert curvature.max() == pytest.approx(1 / 2.5, rel=1e-6)
    assert np.median(curvature) == 0.0


def test_a_hundred_sensors_stand_in_pairs_beside_the_roads():
    placed = roads.sensors(rng(), jitter_m=0.0)
    assert placed.shape == (100, 2)
    way = np.arange(0.0, 75.0, 0.01)
    lines = np.concatenate([roads.centre_line(end, way)[0] for end in ("C", "D")])
    nearest = np.array([np.linalg.norm(lines - s, axis=1).min() for s in placed])
    # Exactly 2 m from the middle of a road but near the corner, where the roads part.
    assert (np.abs(nearest - 2.0) < 0.01).sum() >= 90
    assert nearest.min() > 0.8
    moved = roads.sensors(rng()) - placed
    assert moved.std() == pytest.approx(0.2, rel=0.2)


@pytest.mark.parametrize("end", ["C", "D"])
def test_a_drive_follows_the_road_at_its_speed_and_three_sensors_hear_it(end):
    drive = roads.follow_road(rng(1), end)
    speed = np.linalg.norm(drive.truth[:, 2:], axis=1)
    assert speed.mean() == pytest.approx(math.hypot(1, 0.3), abs=0.02)
    assert 0.01 < speed.std() < 0.04
    steps = np.diff(np.vstack([drive.start, drive.truth])[:, :2], axis=0) / 0.1
    np.testing.assert_allclose(steps, drive.truth[:, 2:], atol=0.05)
    np.testing.assert_allclose(drive.t_s, 0.1 * np.arange(1, len(drive.truth) + 1))
    heard = (~np.isnan(roads.ranges(rng(2), drive, runs=1)[0])).sum(axis=1)
    assert np.mean(heard >= 3) > 0.99
    assert np.linalg.norm(drive.truth[-1, :2] - roads.centre_line(end, drive.t_s[-1:])[0]) < 5.0


def test_matched_drives_have_the_noise_of_the_model():
    seeded = rng(3)
    drives = [roads.matched(seeded, steps=50) for _ in range(300)]
    accel = np.array([np.diff(d.truth[:, 2:], axis=0) / 0.1 for d in drives])
    np.testing.assert_allclose(accel.var(axis=(0, 1)), [0.025, 0.01], rtol=0.05)
    one = np.vstack([drives[0].start, drives[0].truth])
    accel = np.diff(one[:, 2:], axis=0) / 0.1
    moved = one[:-1, :2] + 0.1 * one[:-1, 2:] + 0.005 * accel
    np.testing.assert_allclose(one[1:, :2], moved, atol=1e-12)
    np.testing.assert_array_equal(drives[0].accel_variance, np.tile([0.025, 0.01], (50, 1)))


def test_matched_drives_are_heard_by_three_sensors_all_along():
    seeded = rng(4)
    for _ in range(10):
        drive = roads.matched(seeded, steps=200)
        heard = (~np.isnan(roads.ranges(seeded, drive, runs=1)[0])).sum(axis=1)
        assert np.mean(heard >= 3) > 0.97


def test_ranges_have_additive_and_multiplicative_noise_and_end_at_three_metres():
    drive = roads.follow_road(rng(5), "D")
    z = roads.ranges(rng(6), drive, runs=60)
    r = np.linalg.norm(drive.truth[:, None, :2] - drive.sensors, axis=-1)
    np.testing.assert_array_equal(np.isnan(z), np.broadcast_to(r > 3.0, z.shape))
    error = (z - r)[~np.isnan(z)] / np.sqrt(
        1e-3 + 1e-3 * np.broadcast_to(r, z.shape)[~np.isnan(z)] ** 2
    )
    assert error.mean() == pytest.approx(0.0, abs=0.01)
    assert error.std() == pytest.approx(1.0, abs=0.01)


def test_blocked_readings_are_late_by_a_metre_on_average():
    drive = roads.follow_road(rng(7), "D")
    exact = RangeModel(sigma_m=1e-9, max_range_m=3.0)
    z = roads.ranges(rng(8), drive, runs=20, model=exact, nlos=Nlos(0.1, 1.0))
    r = np.linalg.norm(drive.truth[:, None, :2] - drive.sensors, axis=-1)
    late = (z - r)[~np.isnan(z)]
    assert np.mean(late > 1e-6) == pytest.approx(0.1, abs=0.01)
    assert late[late > 1e-6].mean() == pytest.approx(1.0, abs=0.05)


def test_starts_are_wrong_by_what_was_asked():
    drive = roads.follow_road(rng(9), "D")
    starts = roads.starts(rng(10), drive, runs=4000)
    np.testing.assert_allclose(starts.mean(axis=0), [0.0, 2.0, 1.0, 0.3], atol=0.01)
    np.testing.assert_allclose(starts.std(axis=0), 0.1, rtol=0.05)


def test_the_same_seed_gives_the_same_world():
    first, second = (roads.follow_road(rng(11), "C") for _ in range(2))
    np.testing.assert_array_equal(first.truth, second.truth)
    np.testing.assert_array_equal(
        roads.ranges(rng(12), first, runs=2), roads.ranges(rng(12), second, runs=2)
    )
