"""Laws of the operator of unknown targets: cuts, delays, copies and restarts do not matter."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plain_associator import PlainAssociator
from trackfield.errors import StateError
from trackfield.network.site import TrackerSettings
from trackfield.pipeline import slots_archive
from trackfield.pipeline.sealing import seal
from trackfield.types import Status, select_rows
from untagged_runs import (
    assert_same_rows,
    joined,
    operator,
    pieces,
    run,
    site,
    table,
    walkers,
)

RUN = walkers()
WHOLE = run(operator(), RUN)


def test_walkers_are_found_and_told_step_by_step():
    assert len(WHOLE) > 60
    assert np.unique(np.diff(np.unique(WHOLE.t_s))).tolist() == [0.5]
    assert (np.diff(WHOLE.t_s) >= 0).all()
    assert set(WHOLE.status) == set(range(4))
    assert np.isnan(WHOLE.position[:, 2]).all()
    assert (WHOLE.target == -1).all()
    counts = operator().counts
    assert not any(counts.values())


@given(cuts=st.sets(st.integers(1, len(RUN) - 1), max_size=8))
@settings(max_examples=25)
def test_rows_do_not_depend_on_how_the_run_is_cut(cuts):
    cut = operator()
    assert_same_rows(run(cut, *pieces(RUN, cuts)), WHOLE)
    assert cut.counts["accepted"] == len(RUN)


def test_one_report_at_a_time_is_the_same_too():
    assert_same_rows(run(operator(), *pieces(RUN, range(1, len(RUN)))), WHOLE)


@given(at=st.integers(0, len(RUN)), lag=st.sampled_from([0, 3]))
@settings(max_examples=25)
def test_a_restored_operator_goes_on_bit_by_bit(at, lag):
    first, second = pieces(RUN, [at])
    tracker = operator(lag_steps=lag)
    rows = [tracker.process(first)]
    other = operator(lag_steps=lag)
    other.process(RUN)  # restoring forgets what was before
    other.restore(tracker.snapshot())
    assert other.snapshot() == tracker.snapshot()
    assert_same_rows(other.process(second), tracker.process(second))
    assert other.counts == tracker.counts
    assert other.learned == tracker.learned == {"false": 0.5}
    assert_same_rows(other.finish(), tracker.finish())
    assert len(rows[0]) <= len(WHOLE)


@given(st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_the_order_of_the_reports_of_a_step_does_not_matter(random):
    order: list[int] = []
    for t in np.unique(RUN.t_s):
        step = np.flatnonzero(RUN.t_s == t).tolist()
        random.shuffle(step)
        order += step
    assert_same_rows(run(operator(), select_rows(RUN, np.array(order))), WHOLE)


@given(moved=st.lists(st.integers(0, len(RUN) - 1), unique=True, max_size=12), by=st.integers(1, 5))
@settings(max_examples=25)
def test_what_is_late_within_the_window_ends_as_if_it_had_been_on_time(moved, by):
    """Reports arrive up to five steps late: in hindsight nothing of it is seen."""
    delay = np.zeros(len(RUN))
    delay[moved] = 0.5 * by
    delay[0] = 0.0  # the run begins when it began
    order = np.argsort(RUN.t_s + delay, kind="stable")
    # The last steps stay as they are, so that all late reports come before the end.
    late = operator(lag_steps=6)
    rows = run(late, select_rows(RUN, order), table([(25.5, 1.0, 1.0)]))
    timely = run(operator(lag_steps=6), RUN, table([(25.5, 1.0, 1.0)]))
    assert late.counts["late"] == 0
    assert late.counts["accepted"] == len(RUN) + 1
    for name in ("t_s", "position", "status"):
        np.testing.assert_array_equal(getattr(rows, name), getattr(timely, name))
    assert (late.counts["delayed"] > 0) <= bool(moved)


def test_older_than_the_window_is_dropped_and_counted():
    reports = table([(k * 0.5, 10.0 + 0.1 * k, 20.0) for k in range(20)])
    within, beyond = table([(9.5 - 3.0, 30.0, 30.0)]), table([(9.5 - 3.5, 31.0, 30.0)])
    tracker = operator()
    run(tracker, reports, within, beyond)
    assert (tracker.counts["accepted"], tracker.counts["delayed"]) == (21, 1)
    assert tracker.counts["late"] == 1


@given(copies=st.lists(st.integers(0, len(RUN) - 1), max_size=10))
@settings(max_examples=20)
def test_copies_are_dropped_and_counted(copies):
    order = np.sort(np.concatenate([np.arange(len(RUN)), copies]).astype(int))
    tracker = operator()
    assert_same_rows(run(tracker, select_rows(RUN, order)), WHOLE)
    assert tracker.counts["duplicate"] == len(copies)
    assert tracker.counts["accepted"] == len(RUN)


def test_a_row_is_told_when_its_step_closes_and_never_revised():
    tracker = operator()
    told = []
    for t in range(6):
        rows = tracker.process(table([(0.5 * t, 10.0 + 0.2 * t, 20.0)]))
        told.append(rows.t_s.tolist())
    # Step k closes by the first report of step k + 1; two reports make a track.
    assert told == [[], [], [0.5], [1.0], [1.5], [2.0]]
    assert tracker.finish().t_s.tolist() == [2.5]


def test_a_report_a_window_ahead_is_of_the_present_and_one_further_ahead_waits():
    tracker = operator()
    tracker.process(table([(0.0, 10.0, 20.0), (0.5, 10.1, 20.0), (1.0, 10.2, 20.0)]))
    assert tracker.process(table([(4.0, 30.0, 20.0)])).t_s.max() == 3.5
    assert len(tracker.process(table([(7.5, 30.0, 20.0)]))) == 0
    assert tracker.counts["accepted"] == 4
    assert len(tracker.process(table([(7.0, 30.0, 20.0)]))) > 0
    assert (tracker.counts["accepted"], tracker.counts["ahead"]) == (5, 1)


def test_a_step_takes_what_is_nearest_to_its_time():
    jitter = [0.0, 0.3, 1.2, 1.3, 2.0, 2.7]
    rows = run(operator(), table([(t, 10.0 + 0.1 * t, 20.0) for t in jitter]))
    assert rows.t_s.tolist() == [0.5, 1.0, 1.5, 2.0, 2.5]


def test_what_is_older_than_the_run_is_late():
    tracker = operator()
    tracker.process(table([(5.0, 10.0, 20.0), (5.5, 10.1, 20.0), (6.0, 10.2, 20.0)]))
    tracker.process(table([(4.5, 10.0, 20.0), (5.0, 30.0, 20.0)]))
    assert (tracker.counts["late"], tracker.counts["delayed"]) == (1, 1)


def test_a_watermark_closes_steps_without_a_further_report():
    tracker = operator()
    tracker.process(table([(0.0, 10.0, 20.0), (0.5, 10.1, 20.0)]))
    nothing = table([])
    assert len(tracker.process(nothing, watermark_s=0.74)) == 0
    assert tracker.process(nothing, watermark_s=0.75).t_s.tolist() == [0.5]
    rows = tracker.process(nothing, watermark_s=2.25)
    assert rows.t_s.tolist() == [1.0, 1.5, 2.0]
    assert rows.status.tolist() == [Status.COASTING, Status.COASTING, Status.TENTATIVE]
    assert tracker.process(table([(1.0, 10.2, 20.0)])).t_s.tolist() == []
    assert tracker.counts["delayed"] == 1
    assert len(tracker.finish()) == 0


def test_silence_counts_and_a_track_ends_once():
    tracker = operator()
    run(tracker, table([(0.0, 10.0, 20.0), (0.5, 10.1, 20.0), (1.0, 10.2, 20.0)]))
    rows = tracker.process(table([]), watermark_s=6.0)
    words = [Status(status).name for status in rows.status]
    assert words == ["COASTING", "COASTING", "TENTATIVE", "TENTATIVE", "TENTATIVE", "ENDED"]
    np.testing.assert_array_equal(rows.position[-1, :2], rows.position[-2, :2])
    assert (tracker.counts["started"], tracker.counts["ended"]) == (1, 1)
    assert len(tracker.process(table([]), watermark_s=20.0)) == 0


def test_a_lag_tells_the_same_steps_that_much_later():
    live, late = operator(), operator(lag_s=1.0)
    assert len(live.process(RUN)) > len(late.process(RUN))
    rows = late.finish()
    assert rows.t_s.max() == WHOLE.t_s.max()
    assert rows.t_s.min() >= WHOLE.t_s.max() - 1.0
    by_steps = operator(lag_steps=2)
    assert_same_rows(run(operator(lag_s=1.0), RUN), run(by_steps, RUN))


def test_rows_may_be_thinned():
    rows = run(operator(every_s=2.0), RUN)
    assert (np.diff(np.unique(rows.t_s)) >= 2.0).all()
    shared = WHOLE.t_s[np.isin(WHOLE.t_s, rows.t_s)]
    assert shared.size == pytest.approx(len(rows), abs=4)


def test_steps_keep_their_times_whatever_the_phase():
    rows = [(17.3 + 0.5 * k, 30.0 + 20.0 * np.sin(k / 50.0), 20.0) for k in range(500)]
    told = run(operator(), table(rows)).t_s
    np.testing.assert_array_equal(told, np.round([row[0] for row in rows[1:]], 9))


def test_a_hundred_thousand_empty_steps_leave_nothing_behind():
    associator = PlainAssociator(6)
    tracker = operator(associator=associator)
    tracker.process(RUN)
    sizes = set()
    for hour in range(1, 50):
        tracker.process(table([]), watermark_s=25.0 + 1000.0 * hour)
        sizes.add(len(tracker.snapshot()))
    assert tracker.counts["steps"] < 50 * 110  # a long silence is a hundred steps and one
    for step in range(4000):
        tracker.process(table([]), watermark_s=60_000.0 + 0.5 * step)
    sizes.add(len(tracker.snapshot()))
    assert max(sizes) < 20_000
    assert max(sizes) - min(sizes) < 200


def test_a_long_silence_is_crossed_in_bounded_work():
    associator = PlainAssociator(6)
    tracker = operator(associator=associator)
    days = [(86_400.0 * day + 0.5 * k, 5.0 + 0.1 * k, 5.0) for day in range(10) for k in range(4)]
    rows = run(tracker, table(days))
    assert associator.steps < 10 * 110
    assert set(np.floor(rows.t_s[rows.status == Status.CONFIRMED] / 86_400.0)) == set(range(10))
    assert tracker.counts["accepted"] == 40


def test_a_track_says_why_it_is_there():
    tracker = operator()
    tracker.process(table([(0.5 * k, 10.0 + 0.2 * k, 20.0) for k in range(6)]))
    why = tracker.explain(1)
    assert why.first_s == 0.0
    report = tracker.report(why.alternatives[0].reports[-1])
    assert (report.t_s, report.position.tolist()) == (2.0, [10.8, 20.0])
    assert np.isnan(report.covariance).all()
    assert tracker.explain(7) is None
    assert tracker.report(99) is None


def test_a_snapshot_is_of_one_operator_only():
    tracker = operator()
    tracker.process(RUN)
    data = tracker.snapshot()
    with pytest.raises(StateError, match="another site or of other options"):
        operator(lag_steps=1).restore(data)
    elsewhere = operator(site(tracker=TrackerSettings(window_steps=7)))
    with pytest.raises(StateError, match="another site or of other options"):
        elsewhere.restore(data)
    with pytest.raises(StateError, match="not a tracker's snapshot"):
        operator().restore(b"nothing")
    with pytest.raises(StateError, match="found a snapshot of version 9, expected 1"):
        operator().restore(data[:8] + b"\x09\x00" + data[10:])
    broken = data[:-5] + bytes([data[-5] ^ 1]) + data[-4:]
    with pytest.raises(StateError, match="damaged"):
        operator().restore(broken)


def test_sealed_bytes_that_are_no_snapshot_of_an_operator_are_refused():
    tracker = operator()
    head = struct.pack("<QQQ", 3, 0, 0)
    with pytest.raises(StateError, match="found a damaged snapshot"):
        tracker.restore(seal(head + b"{,}", tracker._maker))
    with pytest.raises(StateError, match="found damaged steps in a snapshot"):
        slots_archive.unpack(b"\x02\x00\x00\x00{}", tracker._rules)


def test_what_the_method_counts_is_kept_apart():
    tracker = operator()
    tracker.process(RUN)
    assert tracker.method_counts == {"scans": tracker.counts["steps"]}


def test_tables_may_be_empty():
    tracker = operator()
    assert len(tracker.process(table([]))) == 0
    assert len(tracker.process(table([]), watermark_s=5.0)) == 0
    assert len(tracker.finish()) == 0
    assert len(joined(table([]), RUN)) == len(RUN)
