"""Track-before-detect: laws of its states, what it refuses, and what it finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benches import load
from trackfield.association.detect import Detect, DetectSettings, ReadingScan
from trackfield.association.detect_field import DetectField, coverage_of, models_of
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.raster import Region
from trackfield.sensing.detection import DetectionModel, columns, coverage

scenario = load(Path(__file__).parents[1] / "benchmarks" / "walker_scenario.py")
GRID, Field, Ways, draw, wrong = (
    scenario.GRID,
    scenario.Field,
    scenario.Ways,
    scenario.draw,
    scenario.wrong,
)
MODEL = DetectionModel(edge_m=1.0)
FIELD = DetectField(GRID, MODEL, delivery=0.9)
QUICK = DetectSettings(particles=500)


@pytest.fixture(scope="module")
def tracker():
    return Detect(FIELD, QUICK)


def track(tracker, run, seed=0):
    """States after every scan."""
    states = [tracker.initial(seed)]
    for t, value in zip(run.times, run.values, strict=True):
        states.append(tracker.step(states[-1], ReadingScan(t, value))[0])
    return states[1:]


def shown(tracker, states, lag=0):
    """What is shown after each step, as track: (x, y)."""
    found = [tracker.estimates(state, lag) for state in states]
    return [
        {int(i): tuple(m[:2]) for i, m in zip(e.track[e.shown], e.mean[e.shown], strict=True)}
        for e in found
    ]


def test_the_same_seed_gives_the_same_run_and_another_one_does_not(tracker):
    run = draw(1, 2)
    first, again, other = (track(tracker, run, seed)[40] for seed in (3, 3, 4))
    assert tracker.encode(first) == tracker.encode(again)
    assert tracker.encode(first) != tracker.encode(other)


def test_a_step_leaves_the_state_before_it_as_it_was(tracker):
    run = draw(2, 2)
    state = track(tracker, run)[30]
    before = tracker.encode(state)
    tracker.step(state, ReadingScan(100.0, run.values[31]))
    assert tracker.encode(state) == before


def test_a_state_that_was_written_goes_on_as_if_it_had_not_been(tracker):
    run = draw(3, 3)
    states = track(tracker, run)
    state = tracker.decode(tracker.encode(states[30]))
    for t, value in zip(run.times[31:], run.values[31:], strict=True):
        state, _ = tracker.step(state, ReadingScan(t, value))
    assert tracker.encode(state) == tracker.encode(states[-1])


def test_bytes_that_are_no_state_are_refused(tracker):
    data = tracker.encode(track(tracker, draw(4, 1))[40])
    small = Detect(DetectField(GRID[:24], MODEL), QUICK)
    for bad in (b"", b"abc", data[:-3], data + b"x", data[:48] + b"\xff" * 8 + data[56:]):
        with pytest.raises(StateError):
            tracker.decode(bad)
    with pytest.raises(StateError, match="another field"):
        small.decode(data)


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        (ReadingScan(np.nan, np.zeros(144, np.int8)), "finite time"),
        (ReadingScan(9.0, np.zeros(143, np.int8)), "one a sensor"),
        (ReadingScan(9.0, np.full(144, 2, np.int8)), "other than"),
        (ReadingScan(1.0, np.zeros(144, np.int8)), "expected one after"),
    ],
)
def test_scans_that_cannot_be_are_refused(tracker, scan, message):
    state, _ = tracker.step(tracker.initial(), ReadingScan(1.0, np.zeros(144, np.int8)))
    with pytest.raises(InputError, match=message):
        tracker.step(state, scan)


def test_every_fault_of_a_field_is_told():
    bad = DetectField(
        np.full((3, 2), np.nan),
        columns([MODEL] * 4),
        delivery=1.5,
        region=Region(0.0, 0.0, -1.0, 1.0),
        step_s=0.0,
    )
    with pytest.raises(ConfigurationError) as caught:
        models_of(bad)
    told = " ".join(caught.value.problems)
    assert all(word in told for word in ("sensors", "models", "delivery", "region", "step_s"))
    with pytest.raises(ConfigurationError, match="shape"):
        models_of(DetectField(np.zeros((0, 2)), MODEL))


def test_the_raster_holds_the_coverage_of_any_shape():
    models = columns(
        [
            DetectionModel(edge_m=1.0),
            DetectionModel(radius_m=9.0, width_deg=90.0, heading_deg=30.0, edge_m=0.5),
            DetectionModel(polygon=((0.0, 0.0), (8.0, 0.0), (8.0, 6.0)), edge_m=0.5),
        ]
    )
    field = DetectField(np.array([[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]]), models)
    raster = coverage_of(field, models_of(field))
    x_min, y_min, cell, rows, columns_ = raster.grid
    dense = np.zeros((rows * columns_, 3))
    dense[np.repeat(np.arange(rows * columns_), np.diff(raster.start)), raster.sensor] = (
        raster.covered
    )
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.integers(columns_, size=500), rng.integers(rows, size=500)])
    quarter = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * cell / 4.0
    at = np.array([x_min, y_min]) + (places[:, None] + 0.5) * cell + quarter
    expected = coverage(models, field.sensors, positions=at).mean(axis=1)
    np.testing.assert_allclose(dense[places[:, 1] * columns_ + places[:, 0]], expected, atol=1e-12)
    assert (dense.max(axis=0) == 1.0).all()


def test_an_explanation_names_the_sensors_about_the_track():
    tracker = Detect(FIELD)
    run = draw(5, 1)
    states = track(tracker, run)
    here = np.flatnonzero(~np.isnan(run.truth[:, 0, 0]))[20]
    estimates = tracker.estimates(states[here])
    (one,) = estimates.track[estimates.shown]
    why = tracker.explain(states[here], int(one))
    assert why is not None
    assert (np.diff(why.log_ratio) <= 0).all()
    near = np.linalg.norm(GRID[why.sensors[:5]] - run.truth[here, 0], axis=1)
    assert why.log_ratio[4] > 0.5
    assert near.max() < 7.62 + 5 * 1.2 + 2.0
    assert tracker.explain(states[here], 9999) is None


def test_hindsight_is_nearer_to_the_truth_and_refuses_what_it_does_not_keep():
    tracker = Detect(FIELD)
    errors = np.zeros((2, 0))
    for seed in range(3):
        run = draw(seed, 1)
        states = track(tracker, run)
        live, late = shown(tracker, states), shown(tracker, states, 5)[5:]
        for s, truth in enumerate(run.truth[:-5, 0]):
            if live[s] and late[s] and not np.isnan(truth[0]):
                pair = [np.hypot(*(next(iter(at[s].values())) - truth)) for at in (live, late)]
                errors = np.column_stack([errors, pair])
    rms = np.sqrt((np.minimum(errors, 6.0) ** 2).mean(axis=1))
    assert rms[1] < 0.8 * rms[0] < 1.2
    with pytest.raises(InputError, match="lag"):
        tracker.estimates(tracker.initial(), 6)


def test_nodes_that_say_nothing_are_found_out():
    tracker = Detect(FIELD)
    run = draw(7, 3)
    dead, stuck = tracker.nodes(track(tracker, run)[-1])
    assert dead[run.dead].min() > 0.3
    assert np.median(dead[np.setdiff1d(np.arange(144), run.dead)]) < 0.03
    assert stuck.max() < 0.05


def test_a_node_that_always_says_one_is_found_out_and_starts_nothing():
    tracker = Detect(FIELD, QUICK)
    rng = np.random.default_rng(0)
    state = tracker.initial()
    for t in range(1, 60):
        value = np.where(rng.random(144) < 0.045, 1, -1).astype(np.int8)
        value[50] = 1
        state, _ = tracker.step(state, ReadingScan(float(t), value))
        assert not tracker.estimates(state).shown.any()
    assert tracker.nodes(state)[1][50] > 0.99


@pytest.mark.parametrize(("k", "least"), [(1, 6), (2, 6), (3, 5)])
def test_most_runs_are_right(k, least):
    tracker = Detect(FIELD)
    runs = [draw(100 + seed, k) for seed in range(6)]
    faults = [wrong(shown(tracker, track(tracker, run)), run) for run in runs]
    assert sum(not fault for fault in faults) >= least, faults


def test_sensors_that_say_zero_are_heard_too():
    tracker = Detect(DetectField(GRID, MODEL, delivery=0.9, says_zero=True))
    runs = [draw(200 + seed, 2, field=Field(says_zero=True)) for seed in range(3)]
    assert [wrong(shown(tracker, track(tracker, run)), run) for run in runs] == [[]] * 3


def test_walkers_on_other_ways_are_followed():
    tracker = Detect(FIELD)
    ways = Ways("cross", speed_m_s=(0.8, 1.6), turning=0.1, stops=True)
    faults = [
        wrong(shown(tracker, track(tracker, run)), run)
        for run in (draw(300 + seed, 1, ways=ways) for seed in range(6))
    ]
    assert sum(not fault for fault in faults) >= 5, faults
