"""A start without a prior: found as an exhaustive grid finds it, and says what it cannot know."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from trackfield.errors import InputError
from trackfield.localization.range_likelihood import RangeScan
from trackfield.localization.range_mle import mle
from trackfield.localization.range_start import Degeneracy, locate
from trackfield.sensing.range import RangeModel, columns, distance, expected, simulate, variance

MODEL = RangeModel(bias_m=0.1, scale=0.01, sigma_m=0.1, sigma_scale=0.01)


def drawn(rng, n, d, *, model=MODEL, height_m=None):
    D = 3 if height_m is not None else d
    sensors, truth = rng.uniform(0, 10, (n, D)), rng.uniform(-1, 11, D)
    if height_m is not None:
        truth[2] = height_m
    z = simulate(model, sensors, path=truth[None], rng=rng).value[0]
    return RangeScan(sensors, z, model, height_m), truth[:d]


def costs(scan, positions):
    """Minus the log likelihood at positions (k, d), by SciPy."""
    full = positions
    if scan.height_m is not None:
        full = np.column_stack([positions, np.full(len(positions), scan.height_m)])
    r = distance(scan.sensors, full)
    sigma = np.sqrt(variance(scan.models, r))
    return -norm.logpdf(scan.ranges, expected(scan.models, r), sigma).sum(axis=1)


@pytest.mark.parametrize(
    ("n", "d", "height_m", "loud"),
    [
        (3, 2, None, 1.0),
        (3, 2, None, 5.0),
        (4, 2, None, 5.0),
        (8, 2, None, 5.0),
        (4, 2, 1.0, 2.0),
        (4, 3, None, 1.0),
        (6, 3, None, 5.0),
    ],
)
def test_nothing_on_an_exhaustive_grid_is_likelier(n, d, height_m, loud):
    rng = np.random.default_rng(23)
    model = RangeModel(0.1, 0.01, 0.1 * loud, 0.01 * loud)
    steps = 121 if d == 2 else 31
    axes = [np.linspace(-8.0, 18.0, steps)] * d
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, d)
    missed = 0
    for _ in range(60):
        scan, _ = drawn(rng, n, d, model=model, height_m=height_m)
        found = locate(scan)
        best = found.candidates[0].position
        missed += costs(scan, best[None])[0] > costs(scan, grid).min() + 1e-9
        listed = [c.cost for c in found.candidates]
        assert listed == sorted(listed)
    assert missed == 0


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(3, 2), (4, 2), (4, 3), (7, 3)]))
def test_exact_ranges_give_the_exact_position(seed, size):
    rng = np.random.default_rng(seed)
    scan, truth = drawn(rng, *size, model=RangeModel(sigma_m=0.01))
    scan = scan._replace(ranges=distance(scan.sensors, truth))
    off = [np.linalg.norm(c.position - truth) for c in locate(scan).candidates]
    assert min(off) < 1e-5


@pytest.mark.parametrize(
    ("sensors", "ranges", "loud", "best"),
    [
        ([[7.5, 2.3], [9.3, 6.4], [1.5, 2.3]], [6.2, 8.8, 0.7], 1.0, [1.45, 2.97]),
        (
            [[1.9, 8.1], [0.7, 0.2], [8.8, 1.2], [3.2, 0.1], [6.0, 0.6]],
            [9.1, 8.9, 2.1, 6.0, 2.8],
            3.0,
            [8.46, 2.73],
        ),
        (
            [[6.7, 9.7, 8.1], [8.7, 6.3, 0.1], [4.7, 4.3, 9.3], [0.3, 7.1, 0.1]],
            [5.2, 9.7, 2.2, 10.9],
            1.0,
            [6.55, 4.78, 8.98],
        ),
    ],
)
def test_the_lifted_start_finds_what_the_mirrored_ones_miss(sensors, ranges, loud, best):
    model = RangeModel(0.1, 0.01, 0.1 * loud, 0.01 * loud)
    found = locate(RangeScan(np.array(sensors), np.array(ranges), model))
    assert np.linalg.norm(found.candidates[0].position - best) < 0.4


def test_a_start_on_the_line_of_sensors_does_not_hide_the_two_sides():
    sensors = np.array([[0.8, 0.0], [1.37, 0.0], [8.07, 0.0]])
    scan = RangeScan(sensors, np.array([1.68, 0.45, 7.58]), RangeModel(sigma_m=0.5))
    sides = sorted(c.position[1] for c in locate(scan).candidates)
    np.testing.assert_allclose(sides, [-1.068, 1.068], atol=0.01)


def test_two_sensors_in_the_plane_give_both_meeting_points():
    sensors = np.array([[0.0, 0.0], [4.0, 0.0]])
    found = locate(RangeScan(sensors, np.array([3.0, 3.0]), RangeModel(sigma_m=0.05)))
    assert found.degenerate is Degeneracy.MIRROR
    assert "mirror image" in found.degenerate.value
    assert found.ambiguous
    heights = sorted(c.position[1] for c in found.candidates)
    np.testing.assert_allclose(heights, [-math.sqrt(5.0), math.sqrt(5.0)], atol=1e-6)
    assert found.candidates[0].cost == pytest.approx(found.candidates[1].cost, abs=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_flat_sensors_keep_the_mirror_image_however_many_they_are(d):
    rng = np.random.default_rng(24)
    scan, truth = drawn(rng, 7, d)
    sensors = scan.sensors.copy()
    sensors[:, -1] = 0.3 * sensors[:, 0] + 2.0  # a line, a plane
    turned = np.linalg.qr(rng.normal(size=(d, d)))[0]
    scan = scan._replace(sensors=sensors @ turned, ranges=distance(sensors @ turned, truth) * 1.01)
    found = locate(scan)
    assert found.degenerate is Degeneracy.MIRROR
    assert found.ambiguous
    assert len(found.candidates) == 2
    r = [distance(scan.sensors, c.position) for c in found.candidates]
    np.testing.assert_allclose(r[0], r[1], atol=1e-6)
    assert min(np.linalg.norm(c.position - truth) for c in found.candidates) < 0.5


def test_nearly_flat_sensors_list_the_image_too():
    sensors = np.column_stack([np.linspace(0.0, 10.0, 5), [0.0, 0.02, 0.0, -0.02, 0.01]])
    truth = np.array([3.0, 2.0])
    model = RangeModel(sigma_m=0.05)
    found = locate(RangeScan(sensors, distance(sensors, truth), model))
    assert found.degenerate is Degeneracy.NONE
    assert found.ambiguous
    sides = {round(float(c.position[1])) for c in found.candidates}
    assert sides == {-2, 2}


def test_circles_that_do_not_meet_give_one_point_between_them_and_its_misfit():
    sensors = np.array([[0.0, 0.0], [4.0, 0.0]])
    found = locate(RangeScan(sensors, np.array([1.0, 2.0]), RangeModel(sigma_m=0.05)))
    assert len(found.candidates) == 1
    np.testing.assert_allclose(found.candidates[0].position, [1.5, 0.0], atol=1e-4)
    assert found.candidates[0].cost == pytest.approx(100.0)
    assert not found.candidates[0].determined


@pytest.mark.parametrize("sensors", [np.zeros((1, 2)), np.ones((3, 2))])
def test_one_place_only_tells_the_circle(sensors):
    n = len(sensors)
    found = locate(RangeScan(sensors, np.full(n, 5.0), RangeModel(sigma_m=0.01)))
    assert found.degenerate is Degeneracy.CIRCLE
    assert found.candidates == ()
    assert found.ambiguous
    np.testing.assert_allclose(found.locus.centre, sensors[0])
    assert found.locus.radius_m == pytest.approx(5.0, abs=1e-4)
    assert found.locus.axes.shape == (2, 2)


def test_the_radius_is_freed_of_the_noise_and_weighs_the_readings():
    models = columns([RangeModel(sigma_m=1.0), RangeModel(sigma_m=1e4)])
    found = locate(RangeScan(np.zeros((2, 2)), np.array([5.0, 9.0]), models))
    assert found.locus.radius_m == pytest.approx(math.sqrt(25.0 - 1.0), abs=1e-5)


def test_a_line_in_space_tells_a_circle_around_it_and_a_point_a_sphere():
    sensors = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 3.0], [0.0, 0.0, 8.0]])
    truth = np.array([3.0, 4.0, 2.0])
    model = RangeModel(sigma_m=0.001)
    found = locate(RangeScan(sensors, distance(sensors, truth), model))
    assert found.degenerate is Degeneracy.CIRCLE
    np.testing.assert_allclose(found.locus.centre, [0.0, 0.0, 2.0], atol=1e-5)
    assert found.locus.radius_m == pytest.approx(5.0, abs=1e-5)
    np.testing.assert_allclose(found.locus.axes[2], 0.0, atol=1e-12)
    one = locate(RangeScan(sensors[:1], np.array([2.0]), model))
    assert one.degenerate is Degeneracy.SPHERE
    assert one.locus.axes.shape == (3, 3)


def test_a_mast_of_sensors_over_a_target_of_known_height_tells_a_circle():
    sensors = np.array([[1.0, 2.0, 4.0], [1.0, 2.0, 9.0]])
    ranges = np.hypot(3.0, np.array([3.0, 8.0]))
    found = locate(RangeScan(sensors, ranges, RangeModel(sigma_m=0.001), height_m=1.0))
    assert found.degenerate is Degeneracy.CIRCLE
    np.testing.assert_allclose(found.locus.centre, [1.0, 2.0])
    assert found.locus.radius_m == pytest.approx(3.0, abs=1e-4)


@pytest.mark.parametrize(("n", "d", "outliers"), [(8, 2, 1), (8, 2, 2), (8, 3, 1), (19, 2, 2)])
def test_gross_readings_are_found_and_set_aside(n, d, outliers):
    rng = np.random.default_rng(25)
    model = RangeModel(sigma_m=0.1, sigma_scale=0.01)
    right = named = 0
    runs = 40
    for _ in range(runs):
        scan, truth = drawn(rng, n, d, model=model)
        wrong = rng.choice(n, outliers, replace=False)
        spoiled = scan.ranges.copy()
        spoiled[wrong] += rng.uniform(2.0, 8.0, outliers)
        kept = np.delete(np.arange(n), wrong)
        oracle = mle(RangeScan(scan.sensors[kept], scan.ranges[kept], model), truth)
        found = locate(scan._replace(ranges=spoiled), outliers=outliers)
        gap = np.linalg.norm(found.candidates[0].position - oracle.position)
        right += gap < 2.0 * math.sqrt(np.trace(oracle.covariance))
        named += not found.used[wrong].any()
    assert right >= 0.95 * runs
    assert named >= 0.95 * runs


def test_another_choice_of_outliers_that_does_as_well_is_told():
    sensors = np.array([[0.0, 0.0], [3.0, 0.0], [7.0, 0.0], [2.0, 6.0], [6.0, -5.0]])
    here, image = np.array([4.0, 3.0]), np.array([4.0, -3.0])
    ranges = distance(sensors, here)
    ranges[4] = distance(sensors, image)[4]  # sensors 0 to 2 cannot tell, 3 and 4 disagree
    scan = RangeScan(sensors, ranges, RangeModel(sigma_m=0.05))
    found = locate(scan, outliers=1)
    assert found.ambiguous
    assert found.used.sum() == 4
    ranges[4] = distance(sensors, here)[4] + 4.0
    assert not locate(scan._replace(ranges=ranges), outliers=1).ambiguous


def test_without_enough_readings_for_proof_none_is_set_aside():
    rng = np.random.default_rng(26)
    scan, _ = drawn(rng, 4, 2)
    spoiled = scan._replace(ranges=scan.ranges + np.array([0.0, 0.0, 0.0, 5.0]))
    assert locate(spoiled, outliers=2).used.all()


def test_a_clean_scan_seldom_loses_a_reading_and_then_hardly_moves():
    rng = np.random.default_rng(27)
    dropped = 0
    for _ in range(40):
        scan, _ = drawn(rng, 8, 2)
        found, plain = locate(scan, outliers=1), locate(scan)
        dropped += not found.used.all()
        gap = np.linalg.norm(found.candidates[0].position - plain.candidates[0].position)
        assert gap < 4.0 * math.sqrt(np.trace(plain.candidates[0].covariance))
    assert dropped <= 4


def test_far_coordinates_cost_no_digits():
    rng = np.random.default_rng(28)
    scan, _ = drawn(rng, 6, 2)
    offset = np.array([5e5, 4e6])
    here = locate(scan).candidates[0]
    there = locate(scan._replace(sensors=scan.sensors + offset)).candidates[0]
    np.testing.assert_allclose(there.position - offset, here.position, atol=1e-6)


def test_several_scans_at_once_are_refused():
    with pytest.raises(InputError, match="expected one"):
        locate(RangeScan(np.eye(3)[:, :2], np.ones((2, 3))))
