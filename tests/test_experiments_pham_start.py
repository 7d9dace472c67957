"""Fig. 5.4: a wrong start is overcome as fast as the paper says, and why; who senses."""

import numpy as np
import pytest

from trackfield.experiments import pham_start
from trackfield.experiments.pham_passage import Hearing
from trackfield.experiments.pham_start import ALONE, OURS, SURE, UNSURE, rmse_m, settle_s
from trackfield.localization.trilateration import ordinary
from trackfield.scheduling.lifetime_candidates import candidates
from trackfield.scheduling.lifetime_search import all_sets, set_traces

BOUND_M2 = 0.03


@pytest.fixture(scope="module")
def field():
    return np.random.default_rng(3).uniform(0.0, 10.0, (441, 2))


@pytest.fixture(scope="module")
def found(field):
    return pham_start.start(field, np.random.default_rng(4), runs=8, cycles=400)


def test_a_filter_sure_of_its_wrong_start_needs_the_papers_time(found):
    errors = found.sharpest.errors
    assert settle_s(errors[SURE]) == pytest.approx(0.3, abs=0.1)
    assert settle_s(errors[UNSURE]) < 0.1
    assert errors[SURE][:, 0].mean() == pytest.approx(-1.5, abs=0.02)
    assert found.x[0] == 9.5
    assert (np.diff(found.x) < 0.0).all()


def test_filters_are_better_than_trilateration_alone(found):
    for started in (found.sharpest, found.cheapest):
        alone = rmse_m(started.errors[ALONE])
        assert rmse_m(started.errors[UNSURE]) < 0.5 * alone
        assert rmse_m(started.errors[OURS]) < rmse_m(started.errors[UNSURE])


def test_traces_are_those_of_the_best_of_all_sets_and_within_the_bound(found, field):
    way = np.column_stack([found.x, 5.0 + 3.0 * np.sin(2.0 * np.pi * found.x / 10.0)])
    near = candidates(field, way[::80], sigma_m=0.1, reach_m=1.4)
    for i, trace in enumerate(found.sharpest.trace[::80]):
        gains = near.part(i, i + 1).gains
        assert trace == pytest.approx(set_traces(gains, all_sets(len(gains), 3)).min())
    assert (found.sharpest.trace <= found.cheapest.trace + 1e-12).all()
    assert found.cheapest.trace.max() <= BOUND_M2 + 1e-12
    assert found.cheapest.trace.mean() > 1.05 * found.sharpest.trace.mean()


def test_fixes_scatter_as_trilateration_says(field):
    way, place = np.array([[9.5, 4.0]]), field[[[3, 80, 200]]]
    distance = np.linalg.norm(way[:, None] - place, axis=-1)
    one = ordinary(place[0], distance[0], sigma_m=0.1)
    who = Hearing(place, distance, np.ones((1, 3), np.bool_))
    started = pham_start.follow(who, way, 4000, rng=np.random.default_rng(1))
    sigma = float(np.sqrt(one.covariance[0, 0]))
    assert started.fix_sigma_m[0] == pytest.approx(sigma, rel=1e-9)
    assert started.errors[ALONE].std() == pytest.approx(sigma, rel=0.05)


def test_settling_is_the_first_time_near_and_may_never_come():
    errors = np.array([[1.5, 0.5, 0.14, 0.2], [-1.5, -0.5, -0.14, 0.2]])
    assert settle_s(errors) == pytest.approx(0.01)
    assert settle_s(errors[:, :2]) == np.inf


def test_without_three_nodes_a_filter_goes_on_as_it_was_going():
    lonely = np.array([[9.5, 4.0], [9.0, 4.5], [0.0, 0.0]])
    found = pham_start.start(lonely, np.random.default_rng(0), runs=2, cycles=20)
    assert found.sharpest.trace.size == 0
    assert np.isnan(found.sharpest.errors[ALONE]).all()
    np.testing.assert_allclose(found.sharpest.errors[OURS], 8.0 - found.x[None].repeat(2, axis=0))


def test_what_is_found_is_told(found):
    table = pham_start.table(found)
    assert len(table.rows) == 8
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert "sure of its wrong start" in pham_start.findings(found)[0]


def test_the_first_second_does_not_count_in_the_rmse_nor_what_is_missing():
    errors = np.full((2, 202), 9.0)
    errors[:, 200:] = [[0.3, np.nan], [0.4, 0.5]]
    assert rmse_m(errors) == pytest.approx(np.sqrt(0.5 / 3))
