"""The tracker of MCMCDA: what it shows, late reports, states as values, bad input, bounded work."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from report_worlds import REGION, SCENE, mean_gospa, scan, world
from trackfield.association.mcmcda import Mcmcda
from trackfield.association.model import Reporting, Scene
from trackfield.association.partition import log_ratio
from trackfield.association.sampling import Sampling
from trackfield.association.window import Known, window
from trackfield.errors import ConfigurationError, InputError, StateError

FEW = Sampling(moves=300, seed=1)


def run(tracker, scans):
    """States after each scan, with what was told of each step."""
    state, states, infos = tracker.initial(), [], []
    for each in scans:
        state, info = tracker.step(state, each)
        states.append(state)
        infos.append(info)
    return states, infos


def shown(tracker, state, lag_steps=0):
    told = tracker.estimates(state, lag_steps)
    return told.mean[told.shown, :2]


def walk(steps, start=(30.0, 40.0), velocity=(1.0, 0.5)):
    """Scans of one target that is always seen, exactly."""
    path = np.array(start) + np.arange(steps)[:, None] * np.array(velocity)
    return [scan(t, [x], first=t) for t, x in enumerate(path)], path


def test_one_target_is_one_track_with_its_velocity():
    scans, path = walk(12)
    tracker = Mcmcda(SCENE, FEW)
    states, _ = run(tracker, scans)
    assert not tracker.estimates(states[0]).shown.any()  # one report is not a track
    for state, x in zip(states[2:], path[2:], strict=True):
        told = tracker.estimates(state)
        np.testing.assert_array_equal(told.track[told.shown], [1])
        assert told.detected[0]
        assert told.first_s[0] == 0.0
        assert np.hypot(*(told.mean[0, :2] - x)) < 0.7
    np.testing.assert_allclose(told.mean[0, 2:], [1.0, 0.5], atol=0.1)
    assert told.covariance[0, 0, 0] < 0.4**2


def test_a_silent_target_fades_and_is_no_longer_shown():
    scans, _ = walk(10)
    tracker = Mcmcda(SCENE, FEW)
    states, _ = run(tracker, [*scans, *(scan(t, []) for t in range(10, 16))])
    existence = [tracker.estimates(state).existence for state in states[9:]]
    assert all(len(e) <= 1 for e in existence)
    values = [float(e.sum()) for e in existence]
    assert values == sorted(values, reverse=True)
    assert values[0] == 1.0
    assert values[-1] < 0.5
    assert not tracker.estimates(states[-1]).detected.any()


def test_a_target_that_leaves_the_region_ends_sooner():
    inside, _ = walk(10)
    leaving, _ = walk(10, start=(88.5, 40.0), velocity=(1.2, 0.0))
    tracker = Mcmcda(SCENE, FEW)
    silence = [scan(t, []) for t in range(10, 12)]
    stays, goes = (run(tracker, [*scans, *silence])[0][-1] for scans in (inside, leaving))
    assert tracker.estimates(stays).existence[0] > 0.7
    assert tracker.estimates(goes).existence.sum() < 0.3


def test_scenario_b_is_tracked_well_and_better_in_hindsight_and_better_than_the_paper_does():
    def score(sampling, lag=0):
        found = []
        for seed in (100, 101, 102):
            given = world(seed, steps=50, targets=8)
            tracker = Mcmcda(SCENE, sampling)
            states, _ = run(tracker, given.scans)
            told = [shown(tracker, state, lag) for state in states[lag:]]
            found.append(mean_gospa(told, given.truth[: len(told)]))
        return np.mean(found)

    live, hindsight = score(Sampling(seed=1)), score(Sampling(seed=1), 4)
    paper = score(Sampling.paper(seed=1))
    assert live < 2.6
    assert hindsight < live - 0.3
    assert paper > live + 0.2


def test_averaged_estimates_are_near_the_best_partitions_and_never_surer():
    given = world(3, steps=20)
    best, averaged = Mcmcda(SCENE, FEW), Mcmcda(SCENE, replace(FEW, output="mean"))
    state = run(best, given.scans)[0][-1]
    surely, mean = best.estimates(state), averaged.estimates(state)
    np.testing.assert_array_equal(surely.track, mean.track)
    assert (mean.existence <= surely.existence + 1e-9).all()
    assert (mean.existence < surely.existence - 1e-6).any()
    near = np.hypot(*(surely.mean - mean.mean)[:, :2].T)
    assert np.median(near) < 0.3


def test_a_track_says_why_it_is_there():
    scans, _ = walk(8)
    tracker = Mcmcda(SCENE, FEW)
    state = run(tracker, scans)[0][-1]
    why = tracker.explain(state, 1)
    assert why.existence == 1.0
    assert why.first_s == 0.0
    assert why.alternatives[0].reports == (3, 4, 5, 6, 7)
    assert why.alternatives[0].probability > 0.5
    assert sum(a.probability for a in why.alternatives) <= 1.0 + 1e-9
    assert tracker.explain(state, 99) is None


def test_best_score_and_acceptances_are_told():
    given = world(4, steps=12)
    tracker = Mcmcda(SCENE, FEW)
    states, infos = run(tracker, given.scans)
    last, info = states[-1], infos[-1]
    known = Known(0.4, 0.73, 6.0)
    view = window(SCENE, last.scans, known=known, begins=last.begins, paper=False)
    tracks = [np.flatnonzero(last.owner == k) for k in range(last.names.size)]
    assert info.learned["log_ratio"] == pytest.approx(log_ratio(view, tracks))
    assert info.work == 300
    proposed = {k: n for k, n in info.counts.items() if k.endswith("_proposed")}
    assert len(proposed) == 8
    assert sum(proposed.values()) == 300
    assert all(info.counts[k.replace("proposed", "accepted")] <= n for k, n in proposed.items())


# Late reports ----------------------------------------------------------------------------------


def test_late_reports_fill_their_slots_and_mend_the_track():
    scans, _ = walk(8)
    held = {4, 5, 6}
    tracker = Mcmcda(SCENE, FEW)
    state = tracker.initial()
    for t, each in enumerate(scans):
        late = [scans[k] for k in sorted(held)] if t == 7 else []
        state, info = tracker.step(state, scan(t, []) if t in held else each, late)
    assert info.counts["late_taken"] == 3
    assert [len(s.number) for s in state.scans] == [1] * 8
    on_time = run(tracker, scans)[0][-1]
    for got, expected in zip(state.scans, on_time.scans, strict=True):
        np.testing.assert_array_equal(got.position, expected.position)
    np.testing.assert_array_equal(state.owner, np.zeros(8))
    np.testing.assert_allclose(
        tracker.estimates(state).mean, tracker.estimates(on_time).mean, atol=1e-9
    )


def test_what_is_too_late_twice_there_or_outside_is_dropped_and_counted():
    scans, _ = walk(20)
    tracker = Mcmcda(SCENE, FEW)
    state = run(tracker, scans)[0][-1]
    after, info = tracker.step(
        state,
        scan(20, [[50.0, 50.0], [50.0, 50.0], [130.0, 50.0], [100.5, 50.0]], first=20),
        [
            scans[1],
            scans[15],
            scan(14.3, [[9.0, 9.0]], first=30),
            scan(17, [[-7.0, 9.0]], first=31),
        ],
    )
    assert info.counts["late_dropped"] == 1
    assert info.counts["late_taken"] == 1
    assert info.counts["duplicate"] == 2  # one in the scan, one that came a second time
    assert info.counts["outside"] == 2
    sizes = {s.t_s: len(s.number) for s in after.scans}
    assert sizes[20.0] == 2
    assert sizes[14.0] == 2


def test_reports_that_may_still_come_are_not_missed_yet():
    delayed = replace(SCENE, reporting=replace(SCENE.reporting, p_detection=(0.05, 0.4, 0.73)))
    scans, _ = walk(10)
    silent = [*scans, scan(10, []), scan(11, [])]
    surely, patiently = Mcmcda(SCENE, FEW), Mcmcda(delayed, FEW)
    told = [t.estimates(run(t, silent)[0][-1]).existence[0] for t in (surely, patiently)]
    assert told[1] > told[0] + 0.05


# States ----------------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 100), st.integers(0, 18))
def test_a_run_cut_and_stored_goes_on_the_same(seed, cut):
    tracker = Mcmcda(SCENE, FEW)
    scans = world(seed, steps=20).scans
    states, _ = run(tracker, scans)
    state = tracker.decode(tracker.encode(states[cut - 1] if cut else tracker.initial()))
    for each in scans[cut:]:
        state, _ = tracker.step(state, each)
    a, b = tracker.estimates(states[-1]), tracker.estimates(state)
    for mine, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(mine, other)
    assert tracker.encode(states[-1]) == tracker.encode(state)


def test_a_step_leaves_the_state_before_it_as_it_was():
    tracker = Mcmcda(SCENE, FEW)
    scans = world(5, steps=10).scans
    states, _ = run(tracker, scans)
    before = tracker.encode(states[4])
    first, _ = tracker.step(states[4], scans[5], [scan(2, [[50.0, 50.0]], first=900)])
    again, _ = tracker.step(states[4], scans[5], [scan(2, [[50.0, 50.0]], first=900)])
    assert tracker.encode(states[4]) == before
    assert tracker.encode(first) == tracker.encode(again)


def test_other_seeds_sample_otherwise():
    scans = world(6, steps=8).scans
    a, b = (run(Mcmcda(SCENE, replace(FEW, seed=s)), scans)[0][-1] for s in (1, 2))
    assert a.random != b.random
    assert (a.samples != b.samples).any()


@pytest.mark.parametrize(
    "spoil", [lambda d: b"", lambda d: b"x" + d, lambda d: d[:-200], lambda d: d[:40]]
)
def test_bytes_that_are_no_state_are_refused(spoil):
    tracker = Mcmcda(SCENE, FEW)
    data = tracker.encode(run(tracker, walk(4)[0])[0][-1])
    with pytest.raises(StateError, match="MCMCDA"):
        tracker.decode(spoil(data))


# Bad input, bounded work -----------------------------------------------------------------------


def test_a_scan_that_is_not_newer_is_refused():
    tracker = Mcmcda(SCENE, FEW)
    state = run(tracker, walk(3)[0])[0][-1]
    with pytest.raises(InputError, match=r"2\.0 s after one of 2\.0 s"):
        tracker.step(state, scan(2, []))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (scan(0, [[np.nan, 1.0]]), "finite"),
        (scan(np.nan, [[1.0, 1.0]]), "finite"),
        (scan(0, [[1.0, 1.0]], covariance=[[1.0, 2.0, 1.0]]), "positive definite"),
        (scan(0, [[1.0, 1.0]])._replace(covariance=np.zeros((2, 3))), "expected"),
    ],
)
def test_malformed_scans_are_refused(wrong, words):
    tracker = Mcmcda(SCENE, FEW)
    with pytest.raises(InputError, match=words):
        tracker.step(tracker.initial(), wrong)


def test_a_lag_beyond_the_window_is_refused():
    tracker = Mcmcda(SCENE, FEW)
    state = run(tracker, walk(3)[0])[0][-1]
    assert tracker.estimates(state, 2).t_s == 0.0
    for lag in (3, -1):
        with pytest.raises(InputError, match="expected 0 to 2"):
            tracker.estimates(state, lag)
    with pytest.raises(InputError, match="no scan"):
        tracker.estimates(tracker.initial())


def test_settings_that_cannot_be_are_all_named():
    with pytest.raises(ConfigurationError) as caught:
        Mcmcda(SCENE, Sampling(moves=-1, window=1, stop=1.0, weights=(1.0,)))
    assert [p.split(":")[0] for p in caught.value.problems] == [
        "moves",
        "window",
        "stop",
        "weights",
    ]


def test_a_burst_of_a_hundred_times_the_clutter_takes_bounded_work_and_passes():
    given = world(7, steps=24, false=6.0)
    rng = np.random.default_rng(0)
    tracker = Mcmcda(SCENE, FEW)
    state = tracker.initial()
    for t, each in enumerate(given.scans):
        if 10 <= t < 13:
            each = scan(
                t, np.vstack([each.position, rng.uniform(0, 100, (600, 2))]), first=9000 + 1000 * t
            )
        state, info = tracker.step(state, each)
        assert info.counts["links"] < 300_000
        if t == 12:
            assert info.work < 300
            assert info.counts["crowded"] > 90
    assert len(shown(tracker, state)) < 15


def test_hours_without_targets_change_nothing():
    tracker = Mcmcda(SCENE, replace(FEW, moves=20))
    state, sizes = tracker.initial(), set()
    for t in range(2000):
        state, info = tracker.step(state, scan(t, []))
        if t >= 20:
            sizes.add(len(tracker.encode(state)))
    assert len(sizes) == 1
    assert info.counts["tracks"] == 0
    assert not len(tracker.estimates(state).track)
    assert tracker.explain(state, 1) is None


def test_a_clock_that_jumps_starts_a_window_of_its_own():
    scans, _ = walk(10)
    tracker = Mcmcda(SCENE, FEW)
    state = run(tracker, scans)[0][-1]
    state, _ = tracker.step(state, scan(5000, [[10.0, 10.0]], first=10))
    assert [s.t_s for s in state.scans] == [5000.0]
    assert not tracker.estimates(state).shown.any()


# Options ---------------------------------------------------------------------------------------


def test_what_the_scene_leaves_open_is_learned():
    open_scene = Scene(Reporting(REGION))
    tracker = Mcmcda(open_scene, Sampling(moves=500))
    given = world(8, steps=100, targets=12)
    _, infos = run(tracker, given.scans)
    learned = infos[-1].learned
    assert learned["sigma_m"] == pytest.approx(0.4, rel=0.2)
    assert learned["p_detection"] == pytest.approx(0.73, abs=0.08)
    assert learned["false_per_scan"] == pytest.approx(6.0, rel=0.2)
    told = run(Mcmcda(SCENE, FEW), given.scans[:3])[1][-1].learned
    assert set(told) == {"log_ratio"}


def test_a_frozen_half_keeps_its_tracks():
    given = world(9, steps=25)
    tracker = Mcmcda(SCENE, replace(FEW, freeze=True, window=10))
    states, _ = run(tracker, given.scans)
    for before, after in pairwise(states[12:]):
        kept = {}
        for state in (before, after):
            numbers = np.concatenate([s.number for s in state.scans])
            t = np.repeat([s.t_s for s in state.scans], [len(s.number) for s in state.scans])
            old = (t < after.scans[5].t_s) & (t >= after.scans[0].t_s)
            kept[id(state)] = dict(
                zip(numbers[old], state.track[old] * (state.owner[old] >= 0), strict=True)
            )
        mine, later = kept.values()
        alive = {n for n in mine if later[n] and mine[n]}
        assert all(mine[n] == later[n] for n in alive)
        lost = [n for n in mine if bool(mine[n]) != bool(later[n])]
        # only a track whose other reports left the window may have let go
        assert all(mine[n] and list(mine.values()).count(mine[n]) == 1 for n in lost)


def test_without_existence_a_track_is_shown_while_seen_lately():
    scans, _ = walk(8)
    tracker = Mcmcda(SCENE, Sampling.paper())
    states, _ = run(tracker, [*scans, *(scan(t, []) for t in range(8, 12))])
    assert [len(shown(tracker, s)) for s in states[7:]] == [1, 1, 1, 0, 0]


def test_reports_with_covariances_of_their_own_are_weighed_by_them():
    _, path = walk(8)
    rng = np.random.default_rng(2)
    spread = [(0.01, 0.0, 4.0) if t % 2 else (4.0, 0.0, 0.01) for t in range(8)]
    noisy = [
        scan(t, [x + rng.standard_normal(2) * np.sqrt([c[0], c[2]])], first=t, covariance=[c])
        for t, (x, c) in enumerate(zip(path, spread, strict=True))
    ]
    tracker = Mcmcda(SCENE, FEW)
    told = tracker.estimates(run(tracker, noisy)[0][-1])
    assert np.hypot(*(told.mean[0, :2] - path[-1])) < 0.6
    assert told.covariance[0, 1, 1] < 0.5
