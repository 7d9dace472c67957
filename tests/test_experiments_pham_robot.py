"""Chapter 4 of Pham's dissertation: what the reproduction says is what its runs are."""

from __future__ import annotations

import numpy as np
import pytest

from trackfield.experiments import pham_robot
from trackfield.experiments.pham_robot_loop import ERROR_M, Setting, run_loop
from trackfield.experiments.pham_robot_paths import KINDS, NOISES_M, RANGES_M, SENSING_M, wander


@pytest.fixture(scope="module")
def found():
    return pham_robot.robot(np.random.default_rng(5), quick=True)


def test_ways_are_longer_than_the_shortest_and_shorter_than_the_rules(found):
    assert [(one.noise_m, one.range_m) for one in found.ratios] == [
        (noise, comm) for noise in NOISES_M for comm in RANGES_M
    ]
    for one in found.ratios:
        assert one.ahead.mean() < one.rule.mean()
        if one.noise_m == 0.0:
            assert (one.ahead >= 1.0 - 1e-9).all()
            assert one.ahead.mean() <= 1.03
    assert [one.kind for one in found.wandering] == list(KINDS)


def test_the_robot_hears_all_sensors_that_sense_the_target(found):
    for loop in found.loops:
        reach = loop.setting.comm_m - SENSING_M - ERROR_M
        away = np.linalg.norm(loop.robot - loop.filtered, axis=1)
        assert (away <= reach * (1.0 + 1e-9)).all()
        senses = np.linalg.norm(loop.nodes - loop.target[:, None], axis=-1) <= SENSING_M
        hears = np.linalg.norm(loop.nodes - loop.robot[:, None], axis=-1) <= loop.setting.comm_m
        assert np.array_equal(loop.heard, senses.sum(axis=1))
        assert np.array_equal(loop.in_hop, (senses & hears).sum(axis=1))
        assert loop.hop_kept >= 0.98
        assert loop.length_m >= loop.optimum_m
        assert (loop.selected == 3).all()


def test_a_robot_that_nobody_tells_anything_stays_in_hope():
    """Without sensors in its hop the filter coasts; nothing fails."""
    lonely = run_loop(np.random.default_rng(0), Setting(1.56, ahead=True))
    assert np.isfinite(lonely.filtered).all()


def test_traffic_adds_up(found):
    own, over, masters = found.traffic
    loop = next(one for one in found.loops if one.setting == Setting(2.5, ahead=True))
    assert own == (loop.selected.sum(), 0, 0, 0)
    assert over.readings == own.readings
    assert masters.hand_overs >= np.sum(np.diff(loop.master) != 0)
    assert own.total < over.total < masters.total


def test_tables_findings_and_figures_tell_it(found):
    ratios, walks, loops, traffic = pham_robot.tables(found)
    assert len(ratios.rows) == len(NOISES_M) * len(RANGES_M)
    assert len(walks.rows) == len(KINDS)
    assert float(loops.rows[1][2]) == pytest.approx(found.loops[1].length_m, abs=0.01)
    assert len(traffic.rows) == 3
    said = " ".join(pham_robot.findings(found))
    worst = max(one.ahead.mean() for one in found.ratios if one.noise_m == 0.0)
    assert f"{worst:.3f} with 0 m noise" in said
    assert "not recovered" in said
    figures = pham_robot.figures(found)
    assert set(figures) == {"fig4_7", "fig4_8", "fig4_9", "robot_ways"}
    assert all(len(figure.axes) for figure in figures.values())


@pytest.mark.parametrize("kind", KINDS)
def test_wandering_targets_are_as_fast_as_told(kind):
    track = wander(np.random.default_rng(1), kind, 50)
    steps = np.linalg.norm(np.diff(track, axis=0), axis=1)
    assert track.shape == (51, 2)
    assert steps == pytest.approx(np.full(50, 0.2))
    turns = np.unwrap(np.arctan2(*np.diff(track, axis=0).T[::-1]))
    assert (np.ptp(turns) < 1e-9) == (kind == "straight")
