"""The soft bound's experiment: what it draws, how it counts, its bars in the small."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from trackfield.experiments import pham_soft, pham_soft_paths
from trackfield.experiments.pham_soft import DRAWS, soft, summary
from trackfield.experiments.pham_soft_runs import BATTERY, Outcome, Runs, simulate

STILL = np.zeros(1, bool)


@pytest.fixture(scope="module")
def quick():
    return soft(np.random.default_rng(0), quick=True)


@pytest.mark.parametrize("draw", [*DRAWS.values(), pham_soft_paths.turning])
def test_paths_stay_in_the_field_and_keep_their_pace(draw):
    found = draw(np.random.default_rng(1), 300)
    assert found.shape == (300, 25, 2)
    assert found.min() > 0.0
    assert found.max() < 10.0
    pace = np.linalg.norm(np.diff(found, axis=1), axis=-1)
    assert 0.3 < pace.mean() < 0.5
    starts = found[:, 0]
    sides = [starts[:, 0] < 0.5, starts[:, 0] > 9.5, starts[:, 1] < 0.5, starts[:, 1] > 9.5]
    assert all(side.mean() > 0.15 for side in sides)


def test_a_wandering_target_accelerates_as_it_is_told():
    found = pham_soft_paths.wandering(0.6)(np.random.default_rng(2), 400)
    bend = np.diff(found, 2, axis=1) / pham_soft_paths.SIGMA_M
    # x'' over a step is half of each of two pushes
    assert bend.std() == pytest.approx(0.6 / np.sqrt(2), rel=0.05)
    turned = pham_soft_paths.turning(np.random.default_rng(2), 200)
    heading = np.unwrap(np.arctan2(*np.moveaxis(np.diff(turned, axis=1), -1, 0)[::-1]), axis=1)
    rate = np.abs(np.diff(heading, axis=1))
    assert rate.max() <= 0.5 + 1e-9
    assert rate[rate > 1e-9].min() >= 0.2 - 1e-9
    assert 0.2 < (rate > 1e-9).mean() < 0.7


def runs_of(fields, passes, *, geometry=False, seed=3):
    rng = np.random.default_rng(seed)
    paths = np.stack([DRAWS["wandering"](rng, passes) for _ in range(fields)])
    return Runs(
        10.0 * rng.random((fields, 441, 2)),
        paths,
        np.full(fields, 3.0),
        np.full(fields, 0.6),
        np.ones((fields, 441)),
        np.full(fields, geometry),
    )


def test_the_service_is_kept_at_half_the_energy():
    runs = runs_of(60, 1)
    ours = summary(simulate(runs, np.random.default_rng(4)), slice(None), 1)
    hard = summary(simulate(runs, np.random.default_rng(4), hard=True), slice(None), 1)
    assert ours.failed < 0.04
    assert ours.asked < 0.6 * 3.0
    assert ours.rmse < 1.55 * hard.rmse
    assert 1.7 < ours.nees < 2.4
    assert ours.lost == 0.0
    assert hard.asked == pytest.approx(3.0, abs=0.05)


def test_geometry_alone_empties_its_favourites_first():
    runs = runs_of(1, 60)
    both = Runs(*(np.concatenate([part, part]) for part in runs))
    both = both._replace(geometry=np.array([False, True]))
    ended = simulate(both, np.random.default_rng(5), hard=True, judged=np.zeros(2, int))
    spared, favoured = ended.first_death
    assert 0 < favoured < 2000
    assert spared == 0 or spared > favoured
    assert ended.error.shape == (0, 2)
    assert favoured >= BATTERY  # nobody is asked more than once an interval


def test_a_run_that_ended_takes_no_part():
    runs = runs_of(2, 60, geometry=True)
    ended = simulate(runs, np.random.default_rng(6), hard=True, judged=np.array([3, 1]))
    assert ended.error.shape == (75, 2)
    assert np.isfinite(ended.error[:, 0]).all()
    for run in (0, 1):  # it goes on until its first node is empty
        assert ended.first_death[run] > 75


def test_summaries_count_what_is_there():
    error = np.full((50, 2), 1.0)
    error[3, 0] = error[4, 0] = 20.0
    kept = np.ones((50, 2))
    kept[:5, 0] = 0.0
    outcome = Outcome(np.full((50, 2), 1.5), kept, error, np.full((50, 2), 7.0), np.zeros(2, int))
    first = summary(outcome, slice(0, 1), 2)
    assert (first.asked, first.nees, first.inside) == (1.5, 7.0, 0.0)
    assert first.failed == pytest.approx(0.1)
    assert first.lost == pytest.approx(2 / 50 * 5000)
    assert first.lost_passes == pytest.approx(100.0)
    assert_allclose(first.rmse, np.sqrt((48 + 2 * 400) / 50))
    assert summary(outcome, slice(1, 2), 1).lost == 0.0


def test_the_quick_run_tells_everything(quick):
    tables = pham_soft.tables(quick)
    assert [len(table.rows) for table in tables] == [2, 2, 16, 3]
    for table in tables:
        assert all(len(row) == len(table.columns) for row in table.rows)
    assert len(pham_soft.findings(quick)) == 3  # nobody has died yet
    drawn = pham_soft.figures(quick)
    assert list(drawn) == ["soft_bound"]
    empty = drawn["soft_bound"].axes[1]
    assert not empty.axison
    assert "no node was empty" in empty.texts[0].get_text()


def test_lives_are_told_where_there_are_some(quick):
    ended = {
        kind: pham_soft.Lives(np.array([6000.0]), np.array([3000.0]), np.array([1000.0]))
        for kind in DRAWS
    }
    found = quick._replace(lives=ended, lives_by_bound=((1.0, 1500.0), (3.0, 6000.0)))
    assert pham_soft.tables(found)[1].rows[0][-2:] == ("6.00", "2.00")
    assert len(pham_soft.findings(found)) == 5
    assert "6.00 times geometry alone" in pham_soft.findings(found)[-1]
    axes = pham_soft.figures(found)["soft_bound"].axes[1]
    assert any(list(line.get_ydata()) == [1500.0, 6000.0] for line in axes.lines)
