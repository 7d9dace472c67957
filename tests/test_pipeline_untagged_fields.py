"""Signals and detections of unknown targets: found, late or not, restored, and refused if wrong."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import field_runs
from trackfield.association.detect import ReadingScan
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.metrics.many import score_many
from trackfield.network.channel import Channel
from trackfield.network.site import Target
from trackfield.pipeline.detections import RewoundDetect, detector
from trackfield.pipeline.dispatch import feed_of, source_of
from trackfield.pipeline.fronts import SignalFront
from trackfield.pipeline.scene import scene
from trackfield.pipeline.slots import Late
from trackfield.pipeline.untagged import Feed, UntaggedTracker, track_unknown
from trackfield.sensing.range import RangeModel
from trackfield.types import select_rows
from untagged_runs import assert_same_rows

SIGNALS = field_runs.signals()
SPARSE = field_runs.detections()
FULL = field_runs.detections(says_zero=True)


def tracked(case, feed, order=None, **options):
    site, readings, _ = case
    table = readings if order is None else select_rows(readings, order)
    return track_unknown(site, [table], feed, **options)


def test_walkers_are_found_by_their_signals():
    run = tracked(SIGNALS, Feed("signal"))
    score = score_many(SIGNALS[2], run.tracks)
    assert score.clear_mot.mota > 0.93
    assert score.clear_mot.switches == 0
    assert score.clear_mot.motp_m < 0.3
    assert run.counts["accepted"] == len(SIGNALS[1])


@pytest.mark.parametrize(("case", "says_zero"), [(SPARSE, False), (FULL, True)])
def test_a_walker_is_found_by_detections(case, says_zero):
    feed = feed_of(case[1], seed=3)
    assert feed == Feed("detection", 3, says_zero)
    run = tracked(case, feed)
    score = score_many(case[2], run.tracks)
    assert score.clear_mot.mota > 0.82
    assert score.clear_mot.switches <= 1  # its first seconds can be taken for another track
    assert score.clear_mot.motp_m < 1.5


def shuffled(readings, seed=0, most=3):
    """Order of arrival of readings that are late by up to `most` steps, not the last ones."""
    rng = np.random.default_rng(seed)
    early = readings.t_s < readings.t_s.max() - most
    delay = np.where(
        early & (rng.random(len(readings)) < 0.2), rng.integers(1, most + 1, len(readings)), 0
    )
    return np.argsort(readings.t_s + delay, kind="stable")


def test_late_detections_end_as_if_they_had_been_on_time():
    order = shuffled(SPARSE[1])
    late = tracked(SPARSE, Feed("detection"), order)
    assert late.counts["delayed"] > 20
    timely = tracked(SPARSE, Feed("detection"))
    last = timely.tracks.t_s == timely.tracks.t_s.max()
    assert np.count_nonzero(last) >= 1
    np.testing.assert_array_equal(
        late.tracks.position[late.tracks.t_s == late.tracks.t_s.max()],
        timely.tracks.position[last],
    )
    assert len(late.tracks) != len(timely.tracks) or not np.array_equal(
        late.tracks.position, timely.tracks.position
    )


def test_late_signals_bring_the_sources_that_were_missing():
    site, readings, truth = SIGNALS
    front = SignalFront(site)
    rows = front.rows(readings, {}).rows[:144]  # the first step
    places = truth.position[:2, :2]
    near = np.linalg.norm(site.positions[:, :2] - places[0], axis=1) < 13.0
    order = np.argsort(near, kind="stable")
    sorted_rows = rows[order]
    late = Late(0, sorted_rows, int(np.count_nonzero(~near)))
    before = front.scan(0.0, sorted_rows[: late.given], 7)
    added = front.late(0.0, late, 8)
    assert before.position == pytest.approx(places[1:], abs=0.5)
    assert added.position == pytest.approx(places[:1], abs=0.5)
    assert (before.number.tolist(), added.number.tolist()) == ([7], [8])
    run = tracked(SIGNALS, Feed("signal"), shuffled(readings), lag_steps=4)
    assert score_many(truth, run.tracks).clear_mot.mota > 0.9


def test_a_sensor_that_speaks_twice_in_a_step_says_the_mean():
    site, readings, _ = SIGNALS
    front = SignalFront(site)
    rows = front.rows(readings, {}).rows[:144]
    more, less = rows.copy(), rows.copy()
    more[:, 0] += 0.1
    more[:, 2] += 1.0
    less[:, 2] -= 1.0
    twice = front.scan(0.0, np.concatenate([more, less]), 0)
    once = front.scan(0.0, rows, 0)
    np.testing.assert_allclose(twice.position, once.position)


@pytest.mark.parametrize(
    ("case", "feed"), [(SIGNALS, Feed("signal")), (SPARSE, Feed("detection", seed=5))]
)
def test_runs_are_cut_and_restored_bit_by_bit(case, feed):
    site, readings, _ = case
    whole = track_unknown(site, [readings], feed).tracks
    cuts = [0, 7, len(readings) // 3, len(readings) // 2, len(readings)]
    tracker, parts = UntaggedTracker(site, feed), []
    for i, j in pairwise(cuts):
        parts.append(tracker.process(select_rows(readings, np.arange(i, j))))
        again = UntaggedTracker(site, feed)
        again.restore(tracker.snapshot())
        tracker = again
    parts.append(tracker.finish())
    for name in ("t_s", "position", "covariance", "status", "track"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


def test_readings_for_a_step_that_was_passed_over_are_counted_by_the_detector():
    site = SPARSE[0]
    rewound = detector(site, scene(site), seed=0, says_zero=False)
    first = ReadingScan(0.0, np.full(81, -1, np.int8))
    state, _ = rewound.step(rewound.initial(), first)
    _, info = rewound.step(state, first._replace(t_s=5.0), [first._replace(t_s=2.0)])
    assert (info.counts["late"], info.counts["replayed"]) == (1, 0)


def test_a_track_of_detections_names_the_sensors_that_speak_for_it():
    site, readings, truth = SPARSE
    tracker = UntaggedTracker(site, Feed("detection"))
    rows = tracker.process(readings)
    why = tracker.explain(int(rows.track[-1]))
    assert why.existence > 0.9
    at = truth.position[truth.t_s == rows.t_s[-1], :2]
    best = site.positions[why.sensors[why.log_ratio > 1.0], :2]
    assert np.linalg.norm(best - at, axis=1).min() < 8.0
    assert tracker.explain(10_000) is None
    assert set(tracker.learned) == {"p_factor", "q_factor"}


def test_what_a_site_tells_of_targets_and_network_reaches_the_detector():
    site = SPARSE[0]
    told = replace(
        site, target=Target(lifetime_s=80.0, accel_sigma_m_s2=0.3), network=Channel(p_loss=0.1)
    )
    usual = detector(site, scene(site), seed=0, says_zero=False).detect
    own = detector(told, scene(told), seed=0, says_zero=True).detect
    assert own.settings == replace(usual.settings, lifetime_s=80.0, accel_sigma_m_s2=0.3)
    np.testing.assert_allclose(own.field.delivery, 0.9)
    np.testing.assert_array_equal(usual.field.delivery, 1.0)
    assert (own.field.says_zero, usual.field.says_zero) == (True, False)


def test_a_rewound_state_is_bytes_and_comes_back():
    site = SPARSE[0]
    rewound = detector(site, scene(site), seed=1, says_zero=False)
    assert isinstance(rewound, RewoundDetect)
    first = rewound.decode(rewound.encode(rewound.initial()))
    assert first.scans == ()
    for damaged in (b"", b"1234567812345678", rewound.encode(first)[:-3]):
        with pytest.raises(StateError):
            rewound.decode(damaged)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": "range"}, "reading 1: found kind 'range', expected 'signal' as before"),
        ({"value": np.nan}, "reading 1: found value nan, expected a finite number"),
        ({"sensor_id": "s999"}, "reading 1: found sensor 's999', expected one of the site"),
        (
            {"target": "tag"},
            "reading 1: found target 'tag', expected none: signals are tracked as of unknown",
        ),
    ],
)
def test_readings_that_are_something_else_are_refused(change, said):
    site, readings, _ = SIGNALS
    one = select_rows(readings, np.arange(3))
    if "kind" in change:
        one = replace(one, kind=np.array([0, 1, 1], np.int32))
    if "value" in change:
        one = replace(one, value=np.array([np.nan, 1.0, 1.0]))
    if "sensor_id" in change:
        one = replace(one, sensor_ids=("s999", *one.sensor_ids[1:]))
    if "target" in change:
        one = replace(one, target=np.array([0, -1, -1], np.int32), target_ids=("tag",))
    with pytest.raises(InputError, match=said):
        UntaggedTracker(site, Feed("signal")).process(one)


def test_readings_must_suit_the_sensors():
    site, readings, _ = SPARSE
    half = readings.value.copy()
    half[0] = 0.5
    with pytest.raises(InputError, match=r"reading 1: found value 0\.5, expected 0 or 1"):
        UntaggedTracker(site, Feed("detection")).process(replace(readings, value=half))
    mixed = replace(site, models=(RangeModel(), *site.models[1:]))
    first = replace(select_rows(readings, np.arange(1)), sensor=np.zeros(1, np.int32))
    with pytest.raises(InputError, match="found a reading of 'detection' from 's000', expected"):
        UntaggedTracker(mixed, Feed("detection")).process(first)
    with pytest.raises(ConfigurationError, match="found no sensors of kind 'signal'"):
        UntaggedTracker(site, Feed("signal"))
    with pytest.raises(InputError, match="found list, expected Readings of kind 'detection'"):
        UntaggedTracker(site, Feed("detection")).process([])


def test_one_kind_of_reading_at_a_time():
    readings = SPARSE[1]
    assert source_of(replace(readings, kind=np.zeros_like(readings.kind))) is None
    assert feed_of(replace(readings, kind=np.zeros_like(readings.kind))) is None
    both = replace(readings, kind=np.arange(len(readings), dtype=np.int32) % 2)
    with pytest.raises(InputError, match="found readings of kinds range, signal, expected one"):
        source_of(both)


def test_copies_of_readings_change_nothing():
    site, readings, _ = SPARSE
    doubled = select_rows(readings, np.repeat(np.arange(len(readings)), 2))
    tracker = UntaggedTracker(site, Feed("detection"))
    rows = tracker.process(doubled)
    plain = UntaggedTracker(site, Feed("detection"))
    assert_same_rows(rows, plain.process(readings))
    assert tracker.counts["duplicate"] == len(readings)
