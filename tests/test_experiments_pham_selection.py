"""Pham, Figs. 3.5-3.8: what rules cost against all sets, and what the tables and figures say."""

import itertools

import numpy as np
import pytest

from trackfield.experiments import pham_selection as experiment
from trackfield.experiments import pham_surface
from trackfield.localization.trilateration import traces
from trackfield.network.layouts import paraboloid


@pytest.fixture(scope="module")
def found():
    return experiment.run(np.random.default_rng(1), quick=True)


def test_the_best_three_of_the_figure_are_the_best_of_all_threes(found):
    for k, target in enumerate(experiment.TARGETS):
        near = np.flatnonzero(np.linalg.norm(found.nodes - target, axis=1) <= experiment.REACH_M)
        best = min(
            itertools.combinations(near.tolist(), 3),
            key=lambda chosen: traces(found.nodes[list(chosen)], target).crlb,
        )
        assert found.chosen["best three"][k].tolist() == list(best)
        for rule in experiment.RULES:
            chosen = found.chosen[rule][k]
            assert set(chosen.tolist()) <= set(near.tolist())
            reached = traces(found.nodes[chosen], target).crlb
            assert found.traces[rule][k] == pytest.approx(reached)


def test_the_printed_step_costs_most_where_there_is_little_choice(found):
    printed, corrected, greedy = found.ratios.mean.T
    assert (found.ratios.mean >= 1.0).all()
    np.testing.assert_allclose(corrected, greedy, rtol=1e-9)
    assert (printed > corrected).all()
    assert printed[0] - corrected[0] > 5 * (printed[-1] - corrected[-1])
    assert corrected[-1] == pytest.approx(1.12, abs=0.01)  # of 24, as known


def test_the_way_stays_half_a_metre_above_the_surface():
    flown = pham_surface.flight(np.random.default_rng(3))
    height = paraboloid(pham_surface.BOX)
    np.testing.assert_allclose(flown.nodes[:, 2], height(flown.nodes[:, :2]), atol=1e-9)
    above = flown.position[:, 2] - height(flown.position[:, :2])
    np.testing.assert_allclose(above, pham_surface.ABOVE_M)
    assert len(flown.nodes) == 441


def test_ranges_beat_differences_and_the_best_four_have_the_least_bound(found):
    tracked = found.tracked
    four, best = tracked["Function-3D, ranges"], tracked["best four, ranges"]
    fixed = tracked["Function-3D, trilateration"]
    assert best.bound.mean() < four.bound.mean()
    assert four.squared.mean() < 0.5 * fixed.squared.mean()
    assert fixed.squared.mean() < fixed.fix_squared.mean()
    assert np.isnan(four.fix_squared).all()
    assert (best.asked == 4).all()
    everybody = tracked["all in reach, ranges"]
    assert (everybody.asked == everybody.reached).all()
    warned = best.reached - 4
    power = 4 * 2400 + best.reached * 1000 + 1400 + warned * 830 + (441 - best.reached) * 130
    np.testing.assert_allclose(best.power_mw, power)


def test_tables_stand_beside_the_paper(found):
    for table in experiment.tables(found):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    rules, contest, space = experiment.tables(found)
    assert [row[0] for row in rules.rows] == list(experiment.RULES)
    assert [row[0] for row in contest.rows] == [str(n) for n in experiment.COUNTS]
    assert len(space.rows) == 6


def test_findings_say_what_is_wrong_and_what_is_unknown(found):
    text = " ".join(experiment.findings(found))
    for words in ("wrong way round", "cannot be checked", "no way, noise, reach", "60 degrees"):
        assert words in text


def test_figures_are_drawn(found):
    figures = experiment.figures(found)
    assert set(figures) == {"fig3_5", "selection_rules", "fig3_6", "fig3_7", "fig3_8"}
    assert all(len(figure.axes) == 1 for figure in figures.values())
    for figure in figures.values():
        figure.canvas.draw()
