"""Track-before-detect when the network or the clock misbehaves, and when nobody is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benches import load
from trackfield.association.detect import Detect, DetectSettings, ReadingScan
from trackfield.association.detect_field import DetectField, models_of
from trackfield.errors import ConfigurationError
from trackfield.sensing.detection import DetectionModel

scenario = load(Path(__file__).parents[1] / "benchmarks" / "walker_scenario.py")
GRID, draw, follow, wrong = scenario.GRID, scenario.draw, scenario.follow, scenario.wrong
WEST = GRID[:, 0] < 27.0
MODEL = DetectionModel(edge_m=1.0)


def tracker(*, group=0, **settings):
    return Detect(DetectField(GRID, MODEL, delivery=0.9, group=group), DetectSettings(**settings))


def noise(rng, q=0.045):
    return np.where(rng.random(144) < q, 1, -1).astype(np.int8)


def test_tracks_outlive_a_burst_in_which_all_sensors_speak():
    run = draw(9600, 2)
    run.values[30:35] = 1
    assert wrong(follow(tracker(), run), run) == []


def test_a_burst_over_an_empty_field_starts_nothing():
    detect, rng = tracker(), np.random.default_rng(0)
    state = detect.initial()
    for t in range(60):
        state, _ = detect.step(state, ReadingScan(float(t), noise(rng, 0.9 if t > 50 else 0.045)))
        assert not detect.estimates(state).shown.any()


def test_a_group_that_is_cut_off_says_nothing_about_targets_and_nodes():
    run = draw(9601, 2)
    run.values[25:35, WEST] = -1
    detect = tracker(group=WEST.astype(np.int32))
    assert wrong(follow(detect, run), run) == []
    alone = tracker()
    assert wrong(follow(alone, run), run) != []  # not told of the groups, silence counts
    state = detect.initial()
    for t, value in zip(run.times, run.values, strict=True):
        state, _ = detect.step(state, ReadingScan(t, value))
    assert detect.nodes(state)[0][np.setdiff1d(np.arange(144), run.dead)].max() < 0.5


@pytest.mark.parametrize("gap_s", [60.0, 1e9])
def test_after_a_gap_the_clock_goes_on_and_nothing_is_made_up(gap_s):
    detect, rng = tracker(), np.random.default_rng(1)
    state = detect.initial()
    for k in range(20):
        t = float(k) if k < 10 else gap_s + k
        state, _ = detect.step(state, ReadingScan(t, noise(rng)))
        estimates = detect.estimates(state)
        assert not estimates.shown.any()
        assert np.isfinite(estimates.mean).all()


def test_an_empty_field_shows_nothing_and_stays_small():
    detect, rng = tracker(particles=500), np.random.default_rng(2)
    state, sizes, members = detect.initial(), [], 0
    for t in range(1000):
        state, info = detect.step(state, ReadingScan(float(t), noise(rng)))
        members = max(members, info.counts["members"])
        assert not detect.estimates(state).shown.any()
        if t % 100 == 99:
            sizes.append(len(detect.encode(state)))
    assert members < 8
    assert max(sizes) < 4 * min(sizes)


def test_work_is_bounded_by_the_most_targets():
    detect = tracker(particles=300, most_targets=5, group_size=3)
    run = draw(1, 8, ways=scenario.Ways("cross"))
    state = detect.initial()
    for t, value in zip(run.times, run.values, strict=True):
        state, info = detect.step(state, ReadingScan(t, value))
        assert info.counts["members"] <= 5
        assert info.counts["largest_group"] <= 3


def test_rates_of_the_field_are_learned():
    detect = tracker(learn_readings=50.0)
    field = scenario.Field(DetectionModel(p_detection=0.55, p_false=0.08))
    state, info = detect.initial(), None
    t = 0.0
    for seed in range(3):
        for value in draw(seed, 3, field=field).values:
            t += 1.0
            state, info = detect.step(state, ReadingScan(t, value))
    assert info is not None
    assert 0.75 < info.learned["p_factor"] < 0.97  # places are chosen where sensors speak: slow
    assert 1.3 < info.learned["q_factor"] < 1.8


@pytest.mark.parametrize("group", [-1, 0.5, np.zeros(3, np.int32), 1000])
def test_groups_that_cannot_be_are_refused(group):
    with pytest.raises(ConfigurationError, match="group"):
        models_of(DetectField(GRID, MODEL, group=group))
