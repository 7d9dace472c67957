"""Trilateration, Pham (2.4)-(2.5), (3.13)-(3.15), corrected: dense algebra and Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.localization import trilateration
from trackfield.localization.bounds import range_bound
from trackfield.sensing.range import RangeModel, distance

seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from([2, 3])


def field(seed, d, n=6):
    rng = np.random.default_rng(seed)
    sensors, target = rng.uniform(0, 10, (n, d)), rng.uniform(0, 10, d)
    return sensors, target, np.abs(distance(sensors, target) + 0.1 * rng.normal(size=n))


def test_rows_are_the_pairs_in_order():
    sensors, _, d = field(1, 3, n=4)
    pairs = trilateration.pair_system(sensors, d)
    rows = [(i, j) for i in range(4) for j in range(i + 1, 4)]
    for row, (i, j) in enumerate(rows):
        np.testing.assert_allclose(pairs.matrix[row], 2 * (sensors[i] - sensors[j]))
        lift = sensors[i] @ sensors[i] - sensors[j] @ sensors[j] - d[i] ** 2 + d[j] ** 2
        assert pairs.right[row] == pytest.approx(lift)


@given(seeds, dimensions)
def test_least_squares_over_all_pairs_is_the_centred_regression(seed, d):
    sensors, _, ranges = field(seed, d)
    pairs = trilateration.pair_system(sensors, ranges)
    dense = np.linalg.lstsq(pairs.matrix, pairs.right, rcond=None)[0]
    found = trilateration.ordinary(sensors, ranges)
    scale = np.linalg.cond(pairs.matrix) ** 2
    np.testing.assert_allclose(found.position, dense, atol=1e-12 * scale * 100)


@given(seeds, dimensions)
def test_blue_is_generalised_least_squares_with_the_singular_pair_covariance(seed, d):
    sensors, _, ranges = field(seed, d)
    found = trilateration.blue(sensors, ranges, sigma_m=0.3)
    pairs = trilateration.pair_system(sensors, ranges)
    # the weights of the estimate are those at the measured distances
    i, j = np.triu_indices(len(sensors), 1)
    signs = np.zeros((len(i), len(sensors)))
    signs[range(len(i)), i], signs[range(len(i)), j] = 1.0, -1.0
    phi = signs @ np.diag(4 * ranges**2 * 0.09 + 2 * 0.3**4) @ signs.T
    weight = np.linalg.pinv(phi, rcond=1e-10)
    normal = pairs.matrix.T @ weight @ pairs.matrix
    dense = np.linalg.solve(normal, pairs.matrix.T @ weight @ pairs.right)
    scale = np.linalg.cond(normal)
    np.testing.assert_allclose(found.position, dense, atol=1e-10 * scale)
    np.testing.assert_allclose(
        found.covariance, np.linalg.inv(normal), rtol=1e-9 * scale, atol=1e-12 * scale
    )


@given(seeds, dimensions)
def test_theta_is_the_pair_covariance_carried_through_least_squares(seed, d):
    sensors, target, ranges = field(seed, d)
    A = trilateration.pair_system(sensors, ranges).matrix
    phi = trilateration.pair_covariance(sensors, target, sigma_m=0.2)
    G = np.linalg.pinv(A)
    theta = trilateration.ordinary_covariance(sensors, target, sigma_m=0.2)
    np.testing.assert_allclose(theta, G @ phi @ G.T, rtol=1e-7, atol=1e-9)


def test_covariances_are_exact_even_where_the_noise_is_large():
    sensors, target, _ = field(3, 2)
    rng = np.random.default_rng(4)
    runs, sigma = 200_000, 1.0
    true = distance(sensors, target)
    ranges = true + sigma * rng.normal(size=(runs, len(true)))
    i, j = np.triu_indices(len(sensors), 1)
    squares = ranges**2
    pairs = squares[:, j] - squares[:, i]
    phi = trilateration.pair_covariance(sensors, target, sigma_m=sigma)
    np.testing.assert_allclose(np.cov(pairs.T), phi, atol=0.03 * np.abs(phi).max())

    centred = sensors - sensors.mean(axis=0)
    half = 0.5 * (np.sum(centred**2, axis=1) - squares)
    estimates = np.linalg.solve(centred.T @ centred, centred.T @ half.T).T + sensors.mean(axis=0)
    np.testing.assert_allclose(estimates[0], trilateration.ordinary(sensors, ranges[0]).position)
    np.testing.assert_allclose(estimates.mean(axis=0), target, atol=0.02)  # unbiased
    theta = trilateration.ordinary_covariance(sensors, target, sigma_m=sigma)
    np.testing.assert_allclose(np.cov(estimates.T), theta, atol=0.03 * np.abs(theta).max())


def test_first_order_leaves_out_the_fourth_power_of_the_noise():
    sensors, target, _ = field(6, 2)
    for covariance in (trilateration.ordinary_covariance, trilateration.blue_covariance):
        small = covariance(sensors, target, sigma_m=1e-4)
        first = covariance(sensors, target, sigma_m=2.0, first_order=True)
        np.testing.assert_allclose(first, 4e8 * small, rtol=1e-6, atol=1e-9)
        assert np.trace(covariance(sensors, target, sigma_m=2.0)) > np.trace(first) * 1.01


@given(seeds, dimensions)
def test_ordinary_is_never_better_than_blue_nor_blue_than_the_bound_of_the_ranges(seed, d):
    sensors, target, _ = field(seed, d)
    found = trilateration.traces(sensors, target)
    assert found.ordinary >= found.blue * (1 - 1e-9)
    assert found.blue >= found.crlb * (1 - 1e-9)
    blue = trilateration.blue_covariance(sensors, target, sigma_m=0.1, first_order=True)
    bound = range_bound(sensors, target, models=RangeModel(sigma_m=0.1)).covariance
    gap = np.linalg.eigvalsh(blue - bound)
    assert gap.min() > -1e-9 * np.abs(blue).max()  # in every direction


def test_one_more_node_can_harm_plain_differencing_but_not_the_best_weights():
    sensors = np.array([[0.0, 0.0], [1.8, 0.0], [1.9, 0.3], [2.0, 0.4], [2.3, 0.6], [9.0, 1.0]])
    target = np.array([0.9, 0.83])
    fewer = trilateration.traces(sensors[:-1], target)
    more = trilateration.traces(sensors, target)
    assert more.blue <= fewer.blue
    assert more.crlb <= fewer.crlb
    far = np.vstack([sensors[:-1], [2.0, 30.0]])
    assert trilateration.traces(far, target).crlb <= fewer.crlb


@given(seeds, dimensions)
def test_exact_ranges_give_the_target(seed, d):
    sensors, target, _ = field(seed, d)
    ranges = distance(sensors, target)
    condition = np.linalg.cond(sensors - sensors.mean(axis=0)) ** 2
    for found in (trilateration.ordinary(sensors, ranges), trilateration.blue(sensors, ranges)):
        assert found.determined
        np.testing.assert_allclose(found.position, target, atol=1e-12 * condition * 10)


def test_each_sensor_may_have_its_own_noise():
    sensors, _, ranges = field(5, 2)
    sigma = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 1e4])  # the last one says nothing
    found = trilateration.blue(sensors, ranges, sigma_m=sigma)
    without = trilateration.blue(sensors[:5], ranges[:5], sigma_m=0.1)
    np.testing.assert_allclose(found.position, without.position, atol=1e-6)
    np.testing.assert_allclose(found.covariance, without.covariance, rtol=1e-6)


def test_sensors_on_a_line_are_told_and_leave_a_huge_finite_variance():
    sensors = np.array([[0.0, 0.0], [1.0, 1.0], [3.0, 3.0]])
    found = trilateration.ordinary(sensors, np.array([2.0, 2.0, 3.0]))
    assert not found.determined
    assert np.isfinite(found.position).all()
    assert np.isfinite(found.covariance).all()
    assert np.trace(found.covariance) > 1e6
    along = np.array([1.0, 1.0])  # which is known as on a line of its own
    alone = trilateration.ordinary(np.array([[0.0], [2.0], [6.0]]) / 2**0.5, np.array([2, 2, 3.0]))
    assert along @ found.position / 2**0.5 == pytest.approx(alone.position[0])
    here = trilateration.ordinary(np.ones((3, 2)), np.ones(3))
    np.testing.assert_allclose(here.position, 1.0)
    assert not here.determined


@pytest.mark.parametrize(
    ("sensors", "ranges", "message"),
    [
        (np.zeros((1, 2)), np.ones(1), "n >= 2"),
        (np.zeros((3, 2)), np.ones(2), "expected"),
        (np.eye(3), np.array([1.0, np.nan, 1.0]), "finite"),
        (np.eye(3), np.array([1.0, -1.0, 1.0]), "not negative"),
    ],
)
def test_bad_input_is_refused(sensors, ranges, message):
    with pytest.raises(InputError, match=message):
        trilateration.ordinary(sensors, ranges)
