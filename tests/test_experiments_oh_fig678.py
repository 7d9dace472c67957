"""Oh, Figs. 6-8 again: the scene is the paper's, and the scores count what they say."""

import math

import numpy as np
import pytest

from trackfield.experiments import oh_fig678 as oh
from trackfield.metrics.ospa import gospa


@pytest.fixture(scope="module")
def result():
    ticks = []
    found = oh.reproduce(np.random.default_rng(0), quick=True, progress=ticks.append)
    assert ticks == [0.25, 0.5, 0.75, 1.0]
    return found


def test_the_scene_is_the_papers():
    assert oh.sensors().shape == (100, 2)
    assert np.ptp(oh.sensors(), axis=0).tolist() == [45.0, 45.0]
    rng = np.random.default_rng(1)
    share = np.mean([oh.scene(rng).detected.mean() for _ in range(300)])
    assert share == pytest.approx(0.05 + 2 * 0.65 * math.pi * 7.62**2 / 47.5**2, abs=0.02)
    for apart in (5.0, 20.0):
        assert math.dist(*oh.scene(rng, apart_m=apart).targets) == pytest.approx(apart)


def test_scores_are_means_over_scans_and_peeling_wins(result):
    for scores in result.scores.values():
        for one in scores.values():
            for interval in one:
                assert interval.low <= interval.value <= interval.high
        assert scores[oh.PEELING].gospa_m.high < scores[oh.PAPER].gospa_m.low
        assert scores[oh.PEELING].false.value < 0.3 < scores[oh.PAPER].false.value
    anywhere = result.scores[oh.ANYWHERE]
    assert anywhere[oh.PEELING].error_m.value < anywhere[oh.PAPER].error_m.value
    assert len(result.tables) == len(oh.SCENES)
    assert all(len(row) == 5 for table in result.tables for row in table.rows)
    assert len(result.findings) == 2


def test_a_score_by_hand():
    """One run of one rule, counted again."""
    cells = oh.field()
    found = oh.contest(cells, np.random.default_rng(3), runs=1, apart_m=20.0)[oh.PAPER]
    rng = np.random.default_rng(3)
    drawn = oh.scene(rng, apart_m=20.0)
    said = oh.reports(oh.PAPER, cells, drawn.detected, rng=rng)
    one = gospa(drawn.targets, said, cutoff_m=7.62)
    assert found.gospa_m.value == pytest.approx(one.gospa_m)
    assert found.missed.value == one.missed
    assert found.false.value == one.false
    near = np.linalg.norm(said[:, None] - drawn.targets, axis=2).min(axis=0)
    near = near[near < 7.62]
    assert found.error_m.value == pytest.approx(math.sqrt(np.mean(near**2)))


def test_the_figures_show_the_scene(result):
    figures = result.figures()
    assert list(figures) == ["fig6_detections", "fig7_likelihood", "fig8_reports", "fig8_peeling"]
    shown = result.picture
    assert shown.likelihood.values.shape == (50, 50)
    assert (shown.detection_likelihood.values < shown.likelihood.values.max()).any()
    best = np.argmax(shown.likelihood.values)
    place = oh.field().centres[best]
    assert np.linalg.norm(shown.scene.targets - place, axis=1).min() < 7.62
