"""The experiments on pursuit: races that steering wins, assignments that others lose."""

from __future__ import annotations

import numpy as np
import pytest

from benches import load
from conftest import ROOT
from trackfield.experiments import oh_pursuit
from trackfield.experiments.oh_pursuit import BOXES, NOISES, OBJECTIVES, SIZES, WAYS, race

BARS = {  # plain over robust on filtered readings, by noise and box; measured, less .05
    ((0.3, 0.15), 1.0): 1.10,
    ((0.3, 0.15), 0.5): 1.30,
    ((0.6, 0.3), 1.0): 1.30,
    ((0.6, 0.3), 0.5): 1.55,
    ((1.0, 0.5), 1.0): 1.50,
    ((1.0, 0.5), 0.5): 2.10,
}


@pytest.mark.parametrize(("noise", "box"), BARS)
def test_robust_steering_captures_sooner_and_always(noise, box):
    mean = {}
    for way in WAYS:
        rng = np.random.default_rng(41)
        run = race(way, noise, box, rng=rng, runs=200)
        assert np.isfinite(run.captured_s).all() or way == "plain"
        mean[way] = run.captured_s[np.isfinite(run.captured_s)].mean()
    assert mean["plain"] / mean["robust, filtered"] >= BARS[noise, box]
    assert mean["robust, filtered"] <= 1.02 * mean["robust"] < 1.02 * mean["plain"]


def test_without_noise_all_ways_are_one():
    runs = [race(way, (1e-9, 1e-9), 0.5, rng=np.random.default_rng(3), runs=30) for way in WAYS[1:]]
    np.testing.assert_allclose(runs[0].captured_s, runs[1].captured_s)
    assert runs[0].path.shape == (len(runs[0].path), 30, 4)


def test_the_whole_experiment_says_what_it_found():
    ticks = []
    found = oh_pursuit.pursued(quick=True, first_seed=5, tick=lambda: ticks.append(0))
    assert len(ticks) == 3
    contest, races = oh_pursuit.tables(found)
    assert [row[0] for row in contest.rows] == list(OBJECTIVES)
    assert len(races.rows) == len(NOISES) * len(BOXES)
    for size in SIZES:
        assert found.contest["bottleneck"][size].value == 1.0
        assert found.contest["greedy"][size].value >= found.contest["sum"][size].low >= 1.0
    assert len(oh_pursuit.findings(found)) == 3
    assert found.captures in {(0,), (1,), (2,)}


def test_the_benchmark_plays_games_and_takes_times():
    bench = load(ROOT / "benchmarks" / "bench_pursuit.py")
    kept = bench.games(bench.crowd, 1)
    assert kept.apart_m >= 1.0
    assert kept.clear_m >= 0.5
    assert kept.evaders == 8
    assert bench.demonstration(3).pursuit is not None
    assert bench.assignment_s(20) > 0.0
    assert bench.coordination_s(5) > 0.0
