"""Fisher information of ranges: the curvature of a divergence, known special cases, maps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.localization.bounds import range_bound, range_information
from trackfield.localization.range_likelihood import RangeScan, problem, terms
from trackfield.sensing.range import RangeModel, columns, distance, expected, variance

MIXED = columns(
    [
        RangeModel(0.1, 0.02, 0.1, 0.3),
        RangeModel(0.0, -0.1, 0.2, 0.1),
        RangeModel(0.3, 0.0, 0.05, 0.0, correlated_sigma_m=0.1),
        RangeModel(0.0, 0.0, 0.1, 0.5),
    ]
)


def divergence(models, sensors, at, other):
    """Kullback-Leibler divergence between the readings at two positions, summed over sensors."""
    r, s = distance(sensors, at), distance(sensors, other)
    v, w = variance(models, r), variance(models, s)
    gap = expected(models, r) - expected(models, s)
    return np.sum(0.5 * (v / w + gap**2 / w - 1.0 + np.log(w / v)))


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_information_is_the_curvature_of_the_divergence(seed, d):
    rng = np.random.default_rng(seed)
    sensors, p = rng.uniform(0, 5, (4, d)), rng.uniform(6, 9, d)
    J = range_information(sensors, p, models=MIXED)
    h = 2e-4

    def far(step):
        return divergence(MIXED, sensors, p, p + step) + divergence(MIXED, sensors, p, p - step)

    eye = h * np.eye(d)
    curvature = np.array(
        [[far(eye[i] + eye[j]) - far(eye[i] - eye[j]) for j in range(d)] for i in range(d)]
    )
    np.testing.assert_allclose(J, curvature / (4 * h**2), rtol=1e-3, atol=1e-4 * np.abs(J).max())


def test_additive_noise_alone_gives_the_sum_of_directions():
    sensors = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]])
    p = np.array([0.7, 0.4])
    u = (p - sensors) / np.linalg.norm(p - sensors, axis=1)[:, None]
    J = range_information(sensors, p, models=RangeModel(sigma_m=0.2, scale=0.1))
    np.testing.assert_allclose(J, 1.21 / 0.04 * u.T @ u)


def test_a_map_is_its_points_and_agrees_with_the_fisher_matrix_of_the_search():
    rng = np.random.default_rng(30)
    sensors, grid = rng.uniform(0, 5, (4, 2)), rng.uniform(0, 5, (7, 3, 2))
    J = range_information(sensors, grid, models=MIXED)
    assert J.shape == (7, 3, 2, 2)
    given_problem = problem(RangeScan(sensors, np.ones((21, 4)), MIXED))
    search = terms(given_problem, grid.reshape(21, 2), exact=True).fisher
    np.testing.assert_allclose(J.reshape(21, 2, 2), search, rtol=1e-12)
    bound = range_bound(sensors, grid, models=MIXED)
    assert bound.determined.all()
    np.testing.assert_allclose(bound.covariance, np.linalg.inv(J), rtol=1e-8)


def test_a_known_height_takes_the_block_of_the_plane():
    rng = np.random.default_rng(31)
    sensors, p = rng.uniform(0, 5, (4, 3)), rng.uniform(0, 5, 2)
    flat = range_information(sensors, p, models=MIXED, height_m=1.5)
    full = range_information(sensors, np.append(p, 1.5), models=MIXED)
    np.testing.assert_allclose(flat, full[:2, :2])
    with pytest.raises(InputError, match="known height"):
        range_information(sensors, np.zeros(3), models=MIXED, height_m=1.5)


def test_every_sensor_adds_information_and_none_beyond_its_reach():
    rng = np.random.default_rng(32)
    sensors, p = rng.uniform(0, 5, (6, 2)), np.array([2.0, 2.0])
    near = RangeModel(sigma_m=0.1, max_range_m=3.0)
    heard = distance(sensors, p) <= 3.0
    assert 0 < heard.sum() < 6
    np.testing.assert_allclose(
        range_information(sensors, p, models=near),
        range_information(sensors[heard], p, models=RangeModel(sigma_m=0.1)),
    )
    for n in range(2, 6):
        less = range_information(sensors[:n], p, models=RangeModel(sigma_m=0.1))
        more = range_information(sensors[: n + 1], p, models=RangeModel(sigma_m=0.1))
        assert np.linalg.eigvalsh(more - less).min() > -1e-9


def test_where_a_direction_is_free_the_bound_is_huge_and_says_so():
    sensors = np.array([[0.0, 0.0], [4.0, 0.0]])
    points = np.array([[2.0, 0.0], [2.0, 1.0], [0.0, 0.0]])
    models = RangeModel(sigma_m=0.0, sigma_scale=0.1)
    bound = range_bound(sensors, points, models=models)
    assert bound.determined.tolist() == [False, True, False]
    assert np.isfinite(bound.covariance).all()
