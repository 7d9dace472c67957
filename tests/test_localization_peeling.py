"""Peeling of binary scans: the likelihood against the dense one, places against enumeration."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from trackfield.errors import InputError
from trackfield.localization.detection_belief import Known, Scan, belief_in, known, log_ratio_map
from trackfield.localization.detection_cells import (
    cluster_reports,
    detection_cells,
    detection_likelihoods,
)
from trackfield.localization.detection_pairs import pair_log_ratios, split
from trackfield.localization.peeling import peel
from trackfield.raster import Region
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionModel

GRID = np.stack(np.meshgrid(5.0 * np.arange(10), 5.0 * np.arange(10)), axis=-1).reshape(-1, 2)
REGION = Region(-2.5, -2.5, 47.5, 47.5)
MODEL = DetectionModel()
CELLS = detection_cells(MODEL, GRID, region=REGION)


def draw(rng, targets, model=MODEL, **options):
    return detection.simulate(model, GRID, paths=targets[None], rng=rng, **options).received[0]


@pytest.mark.parametrize("edge", [0.0, 4.0])
def test_the_ratio_is_that_of_the_dense_likelihoods(edge):
    rng = np.random.default_rng(0)
    model = DetectionModel(edge_m=edge)
    cells = detection_cells(model, GRID, region=REGION, cell_m=5.0)
    z, delivery = rng.random(100) < 0.3, rng.uniform(0.5, 1.0, 100)
    others = detection.coverage(model, GRID, positions=np.array([[10.0, 11.0], [14.0, 13.0]]))
    given_others = Known(np.prod(1 - 0.7 * others, axis=0), np.prod(1 - others, axis=0))
    found = log_ratio_map(cells, Scan(z, delivery), given_others)
    before = detection.probability(model, others, delivery=delivery)
    for cell, place in enumerate(cells.centres):
        more = np.vstack([others, detection.coverage(model, GRID, positions=place)])
        after = detection.probability(model, more, delivery=delivery)
        expected = detection.log_likelihood(after, z) - detection.log_likelihood(before, z)
        assert found[cell] == pytest.approx(expected.sum(), abs=1e-9)


def test_pairs_are_those_of_the_dense_likelihoods():
    rng = np.random.default_rng(11)
    z, delivery = rng.random(100) < 0.3, rng.uniform(0.5, 1.0, 100)
    place = belief_in(CELLS, np.array([1000, 1001]), weight=np.array([0.3, 0.7]), odds=1.0)
    others = known(CELLS, [place])
    window = rng.choice(2500, 12, replace=False)
    alone, pairs = pair_log_ratios(CELLS, Scan(z, delivery), others, window=window)
    c = detection.coverage(MODEL, GRID, positions=CELLS.centres[window])

    def log_p(*more):
        everyone = np.vstack([place.coverage, *more])
        P = detection.probability(MODEL, everyone, delivery=delivery)
        return detection.log_likelihood(P, z).sum()

    for a in range(12):
        assert alone[a] == pytest.approx(log_p(c[a]) - log_p(), abs=1e-9)
        for b in range(12):
            assert pairs[a, b] == pytest.approx(log_p(c[a], c[b]) - log_p(), abs=1e-9)


def test_two_side_by_side_are_split_by_their_joint_posterior():
    truth = np.array([[17.0, 22.0], [28.0, 22.0]])
    z = detection.inside(MODEL, GRID, positions=truth).any(axis=0)
    nobody = known(CELLS, [])
    middle = truth.mean(axis=0)
    scan = Scan(z, np.ones(100))
    parts = split(CELLS, scan, nobody, near=middle, prior=1e-3)
    assert parts is not None
    order = np.argsort([part.position[0] for part in parts])
    for k, target in zip(order, truth, strict=True):
        assert math.dist(parts[k].position, target) < 1.5
    lonely = detection.inside(MODEL, GRID, positions=middle)
    assert split(CELLS, scan._replace(detected=lonely), nobody, near=middle, prior=1e-3) is None
    # The sum over pairs that decides, written out.
    near = np.flatnonzero(np.linalg.norm(CELLS.centres - middle, axis=1) <= 1.3 * 7.62)
    alone, pairs = pair_log_ratios(CELLS, scan, nobody, window=near)
    expected = 1e-3 * np.exp(pairs).sum() / 2 / np.exp(alone).sum()
    assert 1e-3 * parts[0].odds == pytest.approx(expected, rel=1e-9)
    total = parts[0].coverage + parts[1].coverage
    weight = np.exp(pairs) / np.exp(pairs).sum()
    held = detection.inside(MODEL, GRID, positions=CELLS.centres[near])
    np.testing.assert_allclose(total, 2 * weight.sum(axis=0) @ held, atol=1e-9)


def test_pairs_of_a_fine_grid_are_thinned_and_stay_bounded():
    fine = detection_cells(MODEL, GRID, region=Region(5, 5, 40, 40), cell_m=0.25)
    truth = np.array([[16.0, 22.0], [27.0, 22.0]])
    z = detection.inside(MODEL, GRID, positions=truth).any(axis=0)
    middle = truth.mean(axis=0)
    found = split(fine, Scan(z, np.ones(100)), known(fine, []), near=middle, prior=1e-4)
    assert found is not None
    xs = sorted(part.position[0] for part in found)
    np.testing.assert_allclose(xs, [16.0, 27.0], atol=1.5)
    coarse = split(CELLS, Scan(z, np.ones(100)), known(CELLS, []), near=middle, prior=16e-4)
    assert coarse is not None  # 16 fine cells are one coarse one: the same share for two
    assert math.log(1e-4 * found[0].odds) == pytest.approx(
        math.log(16e-4 * coarse[0].odds), abs=0.6
    )


def test_close_targets_are_told_apart_more_often_than_by_peeling_alone(monkeypatch):
    counts = {}
    for name in ("split", "peeled"):
        if name == "peeled":
            monkeypatch.setattr("trackfield.localization.peeling.split", lambda *_, **__: None)
        rng = np.random.default_rng(12)
        counts[name] = 0
        for _ in range(50):
            x = rng.uniform(15, 30, 2)
            z = draw(rng, np.array([x, x + 6.4]))
            counts[name] += len(peel(CELLS, z).position) == 2
    assert counts["split"] > 1.3 * counts["peeled"]


def test_a_lonely_report_is_the_posterior_by_enumeration():
    rng = np.random.default_rng(1)
    z = draw(rng, np.array([[21.0, 24.0]]))
    found = peel(CELLS, z)
    assert len(found.position) == 1
    inside = detection.inside(MODEL, GRID, positions=CELLS.centres)
    rate = np.where(inside, 0.7, 0.05)
    likelihood = np.where(z, rate, 1 - rate).prod(axis=1)
    best = CELLS.centres[int(np.argmax(likelihood))]
    near = np.linalg.norm(CELLS.centres - best, axis=1) <= 7.62
    weight = np.where(near, likelihood, 0.0)
    nothing = np.where(z, 0.05, 0.95).prod()
    odds = weight.sum() / nothing / len(weight)
    weight /= weight.sum()
    mean = weight @ CELLS.centres
    spread = CELLS.centres - mean
    P = (weight[:, None] * spread).T @ spread + np.eye(2) / 12
    np.testing.assert_allclose(found.position[0], mean, atol=1e-9)
    np.testing.assert_allclose(found.covariance[0], [P[0, 0], P[0, 1], P[1, 1]], atol=1e-9)
    assert found.confidence[0] == pytest.approx(odds / (1 + odds))


def matched(reports, truth, cut=7.62):
    apart = np.linalg.norm(reports[:, None] - truth, axis=2)
    rows, columns = linear_sum_assignment(np.minimum(apart, cut))
    near = apart[rows, columns] < cut
    return rows[near], columns[near]


def test_peeling_is_nearer_and_raises_fewer_false_reports_than_the_papers_rule():
    rng = np.random.default_rng(2)
    errors, false, nees = {"paper": [], "peel": []}, {"paper": 0, "peel": 0}, []
    missed = 0
    for _ in range(100):
        truth = rng.uniform(2.5, 42.5, (2, 2))
        z = draw(rng, truth)
        clusters = detection_likelihoods(CELLS, z)
        peeled = peel(CELLS, z)
        reports = {
            "paper": cluster_reports(CELLS, clusters, rng, radius_m=7.62),
            "peel": peeled.position,
        }
        for name, found in reports.items():
            rows, columns = matched(found, truth)
            errors[name] += list(np.linalg.norm(found[rows] - truth[columns], axis=1))
            false[name] += len(found) - rows.size
        rows, columns = matched(peeled.position, truth)
        missed += 2 - rows.size
        for row, column in zip(rows, columns, strict=True):
            e, (xx, xy, yy) = peeled.position[row] - truth[column], peeled.covariance[row]
            nees.append(e @ np.linalg.solve([[xx, xy], [xy, yy]], e))
    rmse = {name: math.sqrt(np.mean(np.square(e))) for name, e in errors.items()}
    assert rmse["peel"] < 0.8 * rmse["paper"]
    assert rmse["peel"] < 2.6
    assert false["peel"] < 0.12 * 100 < false["paper"]
    assert missed < 0.35 * 100
    assert 1.5 < np.mean(nees) < 3.0


def test_silence_and_a_few_false_alarms_give_no_report():
    assert peel(CELLS, np.zeros(100, bool)).position.shape == (0, 2)
    rng = np.random.default_rng(3)
    counts = [len(peel(CELLS, rng.random(100) < 0.05).position) for _ in range(100)]
    assert sum(counts) <= 12


def test_targets_apart_do_not_disturb_each_other():
    rng = np.random.default_rng(4)
    truth = np.array([[10.0, 10.0], [36.0, 34.0]])
    both = draw(rng, truth)
    found = peel(CELLS, both)
    order = np.argsort(found.position[:, 0])
    assert len(order) == 2
    assert np.linalg.norm(found.position[order] - truth, axis=1).max() < 4.0
    left = GRID.sum(axis=1) < 45
    alone = peel(CELLS, both & left, delivery=left.astype(float))
    np.testing.assert_allclose(alone.position[0], found.position[order[0]], atol=0.3)


def test_a_node_known_to_be_dead_says_nothing():
    rng = np.random.default_rng(5)
    alive = np.ones(100, bool)
    alive[[44, 45, 54, 55]] = False
    errors = {True: [], False: []}
    for _ in range(60):
        truth = rng.uniform(18.0, 27.0, (1, 2))
        z = draw(rng, truth, alive=alive)
        for told in (True, False):
            found = peel(CELLS, z, delivery=alive.astype(float) if told else 1.0)
            if len(found.position):
                apart = np.linalg.norm(found.position - truth, axis=1).min()
                errors[told].append(float(apart))
    assert len(errors[True]) >= len(errors[False])
    assert np.mean(errors[True]) < 0.9 * np.mean(errors[False])


def test_reports_come_with_sectors_polygons_and_soft_edges():
    square = ((-7.0, -7.0), (7.0, -7.0), (7.0, 7.0), (-7.0, 7.0))
    kinds = (
        DetectionModel(edge_m=2.0),
        DetectionModel(polygon=square),
        DetectionModel(radius_m=10.0, width_deg=200.0, heading_deg=45.0),
    )
    models = detection.columns([kinds[i % 3] for i in range(100)])
    cells = detection_cells(models, GRID, region=REGION)
    rng = np.random.default_rng(6)
    errors = []
    for _ in range(40):
        truth = rng.uniform(8, 37, (1, 2))
        found = peel(cells, draw(rng, truth, model=models)).position
        errors += [float(np.linalg.norm(found - truth, axis=1).min())] if len(found) else []
    assert len(errors) > 34
    assert np.median(errors) < 2.5


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_any_scan_gives_reports_in_the_region_with_honest_forms(seed, share):
    z = np.random.default_rng(seed).random(100) < share
    found = peel(CELLS, z, most_targets=4)
    assert len(found.position) <= 4
    assert REGION.contains(found.position).all()
    xx, xy, yy = found.covariance.T
    assert (xx > 0).all()
    assert (xx * yy > xy**2).all()
    assert ((found.confidence > 0.5) & (found.confidence <= 1.0)).all()


def test_a_field_larger_than_the_region_and_bad_input():
    far = detection_cells(MODEL, GRID, region=Region(500, 500, 510, 510))
    assert peel(far, np.ones(100, bool)).position.shape == (0, 2)
    with pytest.raises(InputError, match="expected true or false"):
        peel(CELLS, np.ones(99, bool))
    for count in (0.0, math.nan):
        with pytest.raises(InputError, match="expected_targets: found"):
            peel(CELLS, np.ones(100, bool), expected_targets=count)
