"""Cells, likelihoods and clusters of binary detections, Oh (13), Algorithms 1 and 2."""

import itertools
import math

import numpy as np
import pytest

from trackfield.errors import ConfigurationError, InputError
from trackfield.localization.detection_cells import (
    cell_likelihood,
    cluster_reports,
    detection_cells,
    detection_likelihoods,
    likelihood_map,
)
from trackfield.raster import Region
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionModel

GRID = np.stack(np.meshgrid(5.0 * np.arange(10), 5.0 * np.arange(10)), axis=-1).reshape(-1, 2)
REGION = Region(-2.5, -2.5, 47.5, 47.5)
MODEL = DetectionModel()
CELLS = detection_cells(MODEL, GRID, region=REGION)


def scan(seed, *targets):
    rng = np.random.default_rng(seed)
    paths = np.array(targets, float).reshape(1, -1, 2)
    return detection.simulate(MODEL, GRID, paths=paths, rng=rng).received[0]


def test_likelihoods_of_all_outcomes_sum_to_one():
    p, q = np.array([0.7, 0.6, 0.9]), np.array([0.05, 0.1, 0.2])
    for inside in itertools.product([False, True], repeat=3):
        total = sum(
            math.exp(cell_likelihood(np.array(z), np.array(inside), p=p, q=q).total)
            for z in itertools.product([False, True], repeat=3)
        )
        assert total == pytest.approx(1.0)


def test_a_certain_sensor_gives_no_infinity():
    found = cell_likelihood(np.array([False]), np.array([True]), p=np.ones(1), q=np.zeros(1))
    assert math.isfinite(found.total)


def test_the_map_is_the_formula_cell_by_cell():
    z = scan(0, (20.0, 20.0), (31.0, 12.0))
    found = likelihood_map(CELLS, z)
    for cell in range(0, 2500, 97):
        expected, by_target = 1.0, 1.0
        for i, (x, y) in enumerate(GRID):
            inside = math.dist((x, y), CELLS.centres[cell]) <= 7.62
            rate = 0.7 if inside else 0.05
            factor = rate if z[i] else 1 - rate
            expected *= factor
            by_target *= factor if inside else 1.0
        assert math.exp(found.total[cell]) == pytest.approx(expected, rel=1e-9)
        assert math.exp(found.detection[cell]) == pytest.approx(by_target, rel=1e-9)
    np.testing.assert_allclose(found.total, found.detection + found.false_detection)


def test_the_likelihood_is_highest_near_a_lonely_target():
    z = detection.inside(MODEL, GRID, positions=np.array([22.0, 23.0]))
    best = CELLS.centres[int(np.argmax(likelihood_map(CELLS, z).total))]
    assert math.dist(best, (22.0, 23.0)) < 1.5


def test_detection_likelihoods_are_those_of_sensors_that_share_out_the_cells():
    """Algorithm 1 as it is written: each sensor, its own cells, itself and its neighbours."""
    z = scan(1, (20.0, 20.0), (35.0, 10.0))
    apart = np.linalg.norm(CELLS.centres[:, None] - GRID, axis=2)
    owner = np.argmin(apart, axis=1)
    expected = np.zeros(len(owner))
    for i in range(len(GRID)):
        neighbours = np.flatnonzero(np.linalg.norm(GRID - GRID[i], axis=1) < 2 * 7.62)
        for cell in np.flatnonzero(owner == i):
            covering = [j for j in neighbours if apart[cell, j] <= 7.62]
            if sum(z[j] for j in covering) >= 3:
                expected[cell] = math.prod(0.7 if z[j] else 0.3 for j in covering)
    found = detection_likelihoods(CELLS, z)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert 0 < np.count_nonzero(found) < found.size
    assert np.count_nonzero(detection_likelihoods(CELLS, z, least=5)) < np.count_nonzero(found)


def test_every_cell_is_in_the_cluster_of_the_first_seed_that_is_near():
    z = scan(2, (12.0, 12.0), (35.0, 35.0))
    likelihoods = detection_likelihoods(CELLS, z)
    found = cluster_reports(CELLS, likelihoods, np.random.default_rng(3), radius_m=7.62)
    rng = np.random.default_rng(3)
    left = [int(cell) for cell in np.flatnonzero(likelihoods)]
    expected = []
    while left:
        seed = CELLS.centres[rng.choice(np.array(left))]
        near = []
        for cell in left:
            dx, dy = (max(0.0, abs(a) - 1.0) for a in CELLS.centres[cell] - seed)
            if math.hypot(dx, dy) < 7.62:
                near.append(cell)
        mass = sum(likelihoods[cell] for cell in near)
        expected.append(sum(likelihoods[cell] * CELLS.centres[cell] for cell in near) / mass)
        left = [cell for cell in left if cell not in near]
    np.testing.assert_allclose(found, expected)
    assert len(found) >= 2


def test_silence_gives_no_report():
    likelihoods = detection_likelihoods(CELLS, np.zeros(100, bool))
    assert not likelihoods.any()
    rng = np.random.default_rng(0)
    assert cluster_reports(CELLS, likelihoods, rng, radius_m=7.62).shape == (0, 2)


def test_cells_know_sectors_polygons_and_soft_edges_of_each_sensor(monkeypatch):
    rng = np.random.default_rng(4)
    square = ((-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0))
    kinds = (MODEL, DetectionModel(width_deg=90.0, edge_m=1.0), DetectionModel(polygon=square))
    models = detection.columns([kinds[i] for i in rng.integers(0, 3, 100)])
    monkeypatch.setattr("trackfield.localization.detection_cells._BLOCK", 1000)  # many blocks
    cells = detection_cells(models, GRID, region=REGION, cell_m=2.0)
    dense = np.zeros((len(cells.centres), 100))
    dense[cells.cell, cells.sensor] = cells.coverage
    expected = detection.coverage(models, GRID, positions=cells.centres)
    np.testing.assert_array_equal(dense, expected)
    assert cells.shape == (25, 25)
    assert cells.reach_m == pytest.approx(8.12)
    assert 0 < (cells.coverage < 1).sum() < cells.coverage.size


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"region": Region(0, 0, 0, 5)}, "region: found"),
        ({"region": Region(0, 0, math.inf, 5)}, "region: found"),
        ({"cell_m": 0.0}, "cell_m: found 0"),
        ({"cell_m": math.nan}, "cell_m: found nan"),
        ({"cell_m": 1e-3}, "at most 1000000 cells"),
        ({"sensors": np.full((2, 2), np.nan)}, "sensors: found a position that is not a number"),
    ],
)
def test_a_region_that_cannot_be_cut_is_refused(change, words):
    given = {"sensors": GRID, "region": REGION, "cell_m": 1.0, **change}
    with pytest.raises(InputError, match=words):
        detection_cells(MODEL, given.pop("sensors"), **given)


def test_wrong_models_and_scans_are_refused():
    with pytest.raises(ConfigurationError, match="radius_m"):
        detection_cells(DetectionModel(radius_m=0.0), GRID, region=REGION)
    for z in (np.zeros(99, bool), np.zeros(100)):
        with pytest.raises(InputError, match="expected true or false of each of 100 sensors"):
            likelihood_map(CELLS, z)
