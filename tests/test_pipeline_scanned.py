"""Any filter of scans behind one operator: cuts, order, restarts of the program, lags, silence."""

import struct
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plain_scans import Heard, PlainFilter, plain_run, plain_site, plain_table
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.filtering.scans import Scan
from trackfield.pipeline.runs import track_readings
from trackfield.pipeline.scan_archive import pack_stream, unpack_into
from trackfield.pipeline.scan_stream import Said, ScanStream, StreamRules
from trackfield.pipeline.scanned import ScanTracker
from trackfield.types import Status, Tracks, join_rows

COLUMNS = ("t_s", "position", "velocity", "covariance", "status", "nis", "track", "target")
OUTPUTS = ({}, {"lag_s": 0.4}, {"lag_steps": 3}, {"every_s": 0.25}, {"lag_s": 0.3, "every_s": 0.2})
SITE = plain_site()
few = settings(max_examples=12)
seeds = st.integers(0, 2**32 - 1)


def scene(rng, *, targets=("", "x"), steps=24, lateness=0.3):
    """Targets at their own uneven times, an outage, a track that is lost, late and double rows."""
    rows = []
    for i, name in enumerate(targets):
        pauses = rng.choice([0.0625, 0.125, 0.5], steps)
        pauses[steps // 2] = rng.choice([0.5, 3.0, 6.0])
        times = 64.0 + rng.integers(16) / 16 + np.cumsum(pauses)
        own = plain_run(rng, times, target=name or None, phase=float(i))
        own[len(own) // 3] = own[len(own) // 3]._replace(value=40.0)
        rows += own
    arrival = [z.t + rng.uniform(0.0, lateness) for z in rows]
    rows = [rows[i] for i in np.argsort(arrival, kind="stable")]
    again = rng.integers(len(rows), size=5)
    return [copy for i, z in enumerate(rows) for copy in ([z, z] if i in again else [z])]


def tracked(rows, *, cuts=(), site=SITE, **asked) -> Tracks:
    tracker = ScanTracker(site, PlainFilter(), **asked)
    edges = [0, *sorted(cuts), len(rows)]
    parts = [tracker.process(plain_table(site, rows[a:b])) for a, b in pairwise(edges)]
    return join_rows([*parts, tracker.finish()])


def same(a: Tracks, b: Tracks, columns=COLUMNS):
    for name in columns:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def shown_of(rows: Tracks, who) -> Tracks:
    target = -1 if who is None else rows.target_ids.index(who)
    keep = rows.target == target
    columns = {name: getattr(rows, name)[keep] for name in COLUMNS}
    return replace(rows, **columns)


@few
@given(seed=seeds, asked=st.sampled_from(OUTPUTS), cuts=st.lists(st.integers(0, 250), max_size=12))
def test_rows_do_not_depend_on_cuts(seed, asked, cuts):
    rows = scene(np.random.default_rng(seed))
    whole = tracked(rows, **asked)
    assert len(whole) > 20
    same(tracked(rows, cuts=[min(c, len(rows)) for c in cuts], **asked), whole)


@few
@given(seed=seeds, asked=st.sampled_from(OUTPUTS), share=st.floats(0.0, 1.0))
def test_a_restored_run_goes_on_bit_by_bit(seed, asked, share):
    rows = scene(np.random.default_rng(seed))
    cut = int(share * len(rows))
    first, second = (ScanTracker(SITE, PlainFilter(), **asked) for _ in range(2))
    first.process(plain_table(SITE, rows[:cut]), watermark_s=rows[cut - 1].t if cut else None)
    second.process(plain_table(SITE, rows[:7]))  # what was there is forgotten
    second.restore(first.snapshot())
    rest = plain_table(SITE, rows[cut:])
    for a, b in ((first.process(rest), second.process(rest)), (first.finish(), second.finish())):
        same(a, b)
        assert a.target_ids == b.target_ids
    assert first.counts == second.counts
    assert first.heard == second.heard
    assert first.snapshot() == second.snapshot()


@few
@given(seed=seeds, lateness=st.floats(0.0, 0.99))
def test_any_order_within_the_window_leads_to_the_same_state(seed, lateness):
    rng = np.random.default_rng(seed)
    times = 64.0 + np.cumsum(rng.choice([0.0625, 0.125, 0.375, 1.5], 30, p=[0.4, 0.4, 0.15, 0.05]))
    rows = plain_run(rng, times)
    arrival = [z.t + rng.uniform(0.0, lateness) for z in rows]
    late = [rows[i] for i in np.argsort(arrival, kind="stable")]
    a, b = (ScanTracker(SITE, PlainFilter()) for _ in range(2))
    shown = join_rows([a.process(plain_table(SITE, late)), a.finish()])
    join_rows([b.process(plain_table(SITE, sorted(rows))), b.finish()])
    assert a._streams[0].life == b._streams[0].life
    assert {**a.counts, "rewound": 0} == {**b.counts, "rewound": 0}
    assert a.counts["late"] == 0
    assert np.all(np.diff(shown.t_s) > 0)  # nothing shown is shown again


def test_it_is_the_filter_scan_by_scan():
    rows = plain_run(np.random.default_rng(3), np.arange(0.0, 5.0, 0.25))
    shown, model = tracked(rows), PlainFilter()
    state, expected = model.start(), []
    for t in dict.fromkeys(z.t for z in rows):
        said = sorted((z.sensor, z.value) for z in rows if z.t == t)
        sensor, value = np.array(said).T
        state = model.step(
            state, Scan(t, sensor.astype(np.int32), value, np.full(len(said), np.nan))
        )
        expected.append(model.shown(state, t))
    expected = [one for one in expected if one is not None]
    np.testing.assert_array_equal(shown.t_s, [one.t_s for one in expected])
    np.testing.assert_array_equal(shown.position, [one.position for one in expected])
    np.testing.assert_array_equal(shown.nis, [one.nis for one in expected])


@pytest.mark.parametrize(("asked", "late"), [({"lag_steps": 4}, 4), ({"lag_s": 1.0}, 4)])
def test_a_lag_is_a_smoother_s(asked, late):
    """Each row knows exactly what came until its lag was over."""
    rows = plain_run(np.random.default_rng(5), np.arange(0.0, 10.0, 0.25))
    model, times = PlainFilter(), sorted({z.t for z in rows})
    live, smooth = tracked(rows), tracked(rows, **asked)
    np.testing.assert_array_equal(smooth.t_s, live.t_s)
    states, state = [], model.start()
    for t in times:
        own = sorted((z.sensor, z.value) for z in rows if z.t == t)
        sensor, value = np.array(own).T
        state = model.step(
            state, Scan(t, sensor.astype(np.int32), value, np.full(len(own), np.nan))
        )
        states.append(state)
    for row, t in enumerate(smooth.t_s):
        place = times.index(t)
        found = model.hindsight(states[place : place + late + 1])
        np.testing.assert_array_equal(smooth.position[row], found.position)
    assert smooth.covariance[:-5, 0].mean() < live.covariance[:-5, 0].mean()


def test_targets_do_not_see_each_other():
    rows = scene(np.random.default_rng(9))
    together = tracked(rows, every_s=0.2)
    for who in (None, "x"):
        alone = tracked([z for z in rows if z.target == who], every_s=0.2)
        same(shown_of(together, who), alone, [c for c in COLUMNS if c not in {"track", "target"}])
    owners = {(int(t), int(k)) for t, k in zip(together.target, together.track, strict=True)}
    assert len({k for _, k in owners}) == len(owners)  # a track belongs to one target
    first = [int(k) for k in dict.fromkeys(together.track.tolist())]
    assert first == list(range(1, len(first) + 1))  # numbers in order of appearance


def test_a_lost_track_ends_and_the_next_is_another():
    rows = plain_run(np.random.default_rng(2), np.arange(0.0, 6.0, 0.25))
    place = next(i for i, z in enumerate(rows) if z.t == 3.0)
    rows[place] = rows[place]._replace(value=50.0)
    shown = tracked(rows)
    (end,) = np.flatnonzero(shown.status == Status.ENDED)
    assert shown.t_s[end] == 3.0
    assert set(shown.track[: end + 1]) == {1}
    assert set(shown.track[end + 1 :]) == {2}


def test_silence_ends_a_track_whoever_notices_first():
    rows = plain_run(np.random.default_rng(2), np.arange(0.0, 2.0, 0.25))
    again = plain_run(np.random.default_rng(3), np.arange(30.0, 32.0, 0.25))
    asked = {"every_s": 0.5}
    by_reading = tracked(rows + again, **asked)
    tracker = ScanTracker(SITE, PlainFilter(), **asked)
    parts = [tracker.process(plain_table(SITE, rows), watermark_s=20.0)]
    assert parts[0].status[-1] == Status.ENDED
    assert parts[0].t_s[-1] == rows[-1].t + SITE.tracker.drop_s
    assert tracker.counts["ended"] == 1
    parts += [tracker.process(plain_table(SITE, again)), tracker.finish()]
    same(join_rows(parts), by_reading)
    coasting = by_reading.status == Status.COASTING
    assert np.all(np.isnan(by_reading.nis[coasting]))
    assert np.count_nonzero(coasting) == 9  # every half second for five, but where rows begin
    assert tracker.counts["started"] == 2


def test_every_thins_and_never_adds_within_a_run():
    rows = plain_run(np.random.default_rng(2), np.arange(0.0, 9.0, 0.125))
    thin, full = tracked(rows, every_s=0.5), tracked(rows)
    assert np.all(np.diff(thin.t_s) >= 0.5)
    assert set(thin.t_s) <= set(full.t_s)


def test_doubles_and_latecomers_are_counted():
    rows = [Heard(0.0, 0, 1.0), Heard(0.0, 1, 1.0), Heard(5.0, 0, 1.0), Heard(5.0, 0, 2.0)]
    rows += [Heard(4.5, 1, 1.0), Heard(4.5, 1, 1.0), Heard(3.9, 0, 1.0)]
    tracker = ScanTracker(SITE, PlainFilter())
    tracker.process(plain_table(SITE, rows))
    tracker.finish()
    assert tracker.counts == {
        "accepted": 4,
        "duplicate": 2,
        "late": 1,
        "rewound": 1,
        "started": 1,
        "ended": 0,
    }
    assert tracker.heard == ("s0", "s1")


def test_without_a_window_nothing_is_put_in_order():
    site = plain_site(window_s=0.0)
    rows = plain_run(np.random.default_rng(2), np.arange(0.0, 2.0, 0.25))
    tracker = ScanTracker(site, PlainFilter())
    tracker.process(plain_table(site, [*rows, rows[0]._replace(t=1.6)]))
    assert tracker.counts["late"] == 1
    assert len(tracker._streams[0].history) <= 2


def test_memory_does_not_grow_with_the_run():
    tracker = ScanTracker(SITE, PlainFilter(), lag_s=2.0)
    most = 0
    for start in range(0, 60, 10):
        rows = plain_run(np.random.default_rng(start), np.arange(start, start + 10, 0.125))
        tracker.process(plain_table(SITE, rows))
        most = max(most, len(tracker._streams[0].history))
    assert most <= 2.0 / 0.125 + 3


def test_few_states_are_kept_to_go_back_to():
    """However many scans a window holds; and going back to one of them changes nothing."""
    tracker = ScanTracker(SITE, PlainFilter())
    rows = plain_run(np.random.default_rng(8), np.arange(0.0, 6.0, 0.015625))
    tracker.process(plain_table(SITE, rows))
    history = tracker._streams[0].history
    assert len(history) > 60
    assert sum(moment.life is not None for moment in history) <= 10


def test_arrival_orders_a_table():
    rng = np.random.default_rng(6)
    rows = plain_run(rng, np.arange(0.0, 5.0, 0.25))
    arrival = np.array([z.t for z in rows]) + rng.uniform(0.0, 0.5, len(rows))
    tracker = ScanTracker(SITE, PlainFilter())
    found = join_rows([tracker.process(plain_table(SITE, rows, arrival=arrival)), tracker.finish()])
    same(found, tracked([rows[i] for i in np.argsort(arrival, kind="stable")]))


def test_a_target_of_its_own_has_its_own_filter():
    class Shifted(PlainFilter):
        def step(self, state, scan):
            return super().step(state, scan._replace(value=scan.value - 10.0))

    rows = scene(np.random.default_rng(4), targets=("x", "y"))
    tracker = ScanTracker(SITE, PlainFilter(), own={"x": Shifted()})
    found = join_rows([tracker.process(plain_table(SITE, rows)), tracker.finish()])
    same(shown_of(found, "y"), shown_of(tracked(rows), "y"), ["position"])
    x, plain = shown_of(found, "x").position, shown_of(tracked(rows), "x").position
    np.testing.assert_allclose(x[5, :2], plain[5, :2] - 10.0, atol=1.0)


def test_a_run_in_which_no_track_starts_is_told():
    rows = plain_table(SITE, [Heard(float(t), 0, 1.0) for t in range(5)])
    with pytest.raises(InputError, match=r"found 5 usable readings from 1 sensors \(s0\)"):
        track_readings(ScanTracker(SITE, PlainFilter()), [rows])
    none = track_readings(ScanTracker(SITE, PlainFilter()), [plain_table(SITE, [])])
    assert len(none.tracks) == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"value": np.array([np.nan])}, "reading 1: found value nan"),
        ({"t_s": np.array([np.inf])}, "reading 1: found t_s inf"),
        ({"kinds": ("range",)}, "found kind 'range' from 's0', expected the kind of its sensor"),
        ({"sensor_ids": ("other",)}, "found sensor 'other', expected one of the site"),
    ],
)
def test_bad_readings_are_refused(change, words):
    table = replace(plain_table(SITE, [Heard(0.0, 0, 1.0)]), **change)
    with pytest.raises(InputError, match=words):
        ScanTracker(SITE, PlainFilter()).process(table)


def test_what_is_no_table_is_refused():
    with pytest.raises(InputError, match="expected Readings"):
        ScanTracker(SITE, PlainFilter()).process([1.0])


@pytest.mark.parametrize("asked", [{"lag_s": -1.0}, {"every_s": np.inf}, {"lag_steps": 1.5}])
def test_lags_that_cannot_be_are_refused(asked):
    with pytest.raises(ConfigurationError, match="expected finite numbers"):
        ScanTracker(SITE, PlainFilter(), **asked)


def test_a_snapshot_belongs_to_its_site_and_settings():
    tracker = ScanTracker(SITE, PlainFilter())
    tracker.process(plain_table(SITE, plain_run(np.random.default_rng(0), [0.0, 1.0])))
    data = tracker.snapshot()
    for other in (
        ScanTracker(SITE, PlainFilter(), lag_s=1.0),
        ScanTracker(plain_site(drop_s=9.0), PlainFilter()),
    ):
        with pytest.raises(StateError, match="another site"):
            other.restore(data)
    with pytest.raises(StateError, match="damaged"):
        tracker.restore(data[:-1] + b"?")


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:3],
        lambda data: data[:-1],
        lambda data: data + b"more",
        lambda data: data[:4] + b"x" + data[5:],
        lambda data: struct.pack("<I", 2) + b"{}",
    ],
    ids=("no head", "cut short", "longer", "no JSON", "empty head"),
)
def test_a_damaged_stream_is_refused(damage):
    model = PlainFilter()
    rules = StreamRules(window_s=1.0, drop_s=5.0)
    stream = ScanStream(model, rules)
    for k in range(12):
        stream.add(0.25 * k, k % 4, said=Said(1.0, np.nan))
    data = pack_stream(stream, model)
    other = ScanStream(model, rules)
    unpack_into(other, data, model)
    assert pack_stream(other, model) == data
    with pytest.raises(StateError):
        unpack_into(other, damage(data), model)
