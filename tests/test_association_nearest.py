"""Nearest neighbours: Kalman filters, pairs as all pairings tried, and a track's life."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benches import load
from conftest import ROOT
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.association.nearest import Nearest
from trackfield.association.nearest_step import NearestSettings, motion
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.filtering import kalman, smoothing
from trackfield.raster import Region
from trackfield.types import Gaussian

REGION = Region(0.0, 0.0, 100.0, 100.0)
SIGMA_M = 0.4
SCENE = Scene(Reporting(REGION, 1.0, SIGMA_M), Targets(0.15, velocity_sigma_m_s=1.0))
H = np.eye(2, 4)


def scan_of(t, places, first=0, covariance=None):
    places = np.array(places, float).reshape(-1, 2)
    n = len(places)
    unknown = np.full((n, 3), np.nan)
    numbers = np.arange(first, first + n, dtype=np.int32)
    return ReportScan(float(t), places, unknown if covariance is None else covariance, numbers)


def run(tracker, scans, state=None):
    state = tracker.initial() if state is None else state
    for scan in scans:
        state, _ = tracker.step(state, scan)
    return state


def walk(steps, *, seed=0, start=(50.0, 50.0), missing=()):
    rng = np.random.default_rng(seed)
    path = np.array(start) + np.arange(steps)[:, None] * (0.7, -0.4)
    seen = path + SIGMA_M * rng.standard_normal(path.shape)
    return [scan_of(t, [] if t in missing else [seen[t]], first=t) for t in range(steps)]


def crowd(seed, steps=20, targets=4):
    rng = np.random.default_rng(seed)
    place, speed = rng.uniform(20, 60, (targets, 2)), rng.normal(0, 0.7, (targets, 2))
    scans, first = [], 0
    for t in range(steps):
        seen = (place + t * speed + 0.4 * rng.standard_normal(place.shape))[
            rng.random(targets) < 0.8
        ]
        false = rng.uniform(0, 100, (rng.poisson(3), 2))
        scans.append(scan_of(t, np.concatenate([seen, false]), first))
        first += len(scans[-1].number)
    return scans


def beliefs(scans):
    """Beliefs of one target by the filter of the room `filtering`, and the steps between."""
    start = np.zeros((4, 4))
    start[:2, :2], start[2:, 2:] = SIGMA_M**2 * np.eye(2), np.eye(2)
    belief = Gaussian(np.append(scans[0].position[0], (0.0, 0.0)), start)
    found, passed = [belief], []
    for before, scan in itertools.pairwise(scans):
        F, Q = motion(SCENE.targets, 1.0, dt_s=scan.t_s - before.t_s)
        prior = kalman.predict(belief, F, Q)
        passed.append(smoothing.Passed(belief, F, prior))
        belief = prior
        for z in scan.position:
            sensor = kalman.Linear(H, SIGMA_M**2 * np.eye(2))
            belief = kalman.update(prior, z, sensor).posterior
        found.append(belief)
    return found, passed


@pytest.mark.parametrize("pairing", ["optimal", "greedy"])
def test_a_lone_target_is_filtered_and_smoothed_as_by_kalman(pairing):
    scans = [scan for scan in walk(12, missing=(5, 8)) if scan.t_s != 6]  # and a scan is left out
    tracker = Nearest(SCENE, NearestSettings(pairing))
    state = run(tracker, scans)
    expected, passed = beliefs(scans)
    smoothed = smoothing.smooth(expected[-1], passed)
    for lag, truth in [(0, expected[-1]), *((lag, smoothed[-1 - lag]) for lag in (1, 3, 8))]:
        found = tracker.estimates(state, lag)
        np.testing.assert_allclose(found.mean, [truth.mean], rtol=1e-9)
        np.testing.assert_allclose(found.covariance, [truth.covariance], atol=1e-9)
        assert found.t_s == scans[-1 - lag].t_s
        assert found.track.tolist() == [1]


@given(st.integers(1, 12), st.floats(0.05, 3), st.floats(0.01, 2))
def test_motion_over_a_time_is_that_of_its_steps_one_by_one(n, step_s, sigma):
    targets = Targets(accel_sigma_m_s2=sigma)
    G = np.array([step_s**2 / 2, step_s])
    F1, Q1 = np.array([[1.0, step_s], [0.0, 1.0]]), sigma**2 * np.outer(G, G)
    F, Q = np.eye(2), np.zeros((2, 2))
    for _ in range(n):
        F, Q = F1 @ F, F1 @ Q @ F1.T + Q1
    found = motion(targets, step_s, dt_s=n * step_s)
    np.testing.assert_allclose(found[0], np.kron(F, np.eye(2)), rtol=1e-9)
    np.testing.assert_allclose(found[1], np.kron(Q, np.eye(2)), rtol=1e-9)


def three_rows(rng):
    """Confirmed tracks in a row, and a scan in which reports are near to several."""
    starts = np.column_stack([np.arange(3) * 1.2 + 50, np.full(3, 50.0)])
    scans = [scan_of(t, starts, first=3 * t) for t in range(4)]
    places = starts[rng.integers(0, 3, 4)] + rng.normal(0, 0.7, (4, 2))
    return scans, scan_of(4, places, first=12)


def pairs_of(tracker, before, after):
    """Which report each track took, and the squared distances of all pairs."""
    held = before.state
    F, Q = motion(SCENE.targets, 1.0, dt_s=1.0)
    prior = kalman.predict(Gaussian(held.mean, held.covariance), F, Q)
    scan = after.kept[-1].scan
    d2 = np.array(
        [
            [
                (e := z - m[:2]) @ np.linalg.solve(P[:2, :2] + SIGMA_M**2 * np.eye(2), e)
                for z in scan.position
            ]
            for m, P in zip(*prior, strict=True)
        ]
    )
    places = {number: j for j, number in enumerate(scan.number.tolist())} | {-1: -1}
    now = after.state
    report = [places[int(now.recent[now.track == track][0, -1])] for track in held.track]
    return report, d2


def test_the_pairs_of_a_scan_are_the_best_of_all():
    different = 0
    for seed in range(60):
        scans, last = three_rows(np.random.default_rng(seed))
        tracker = Nearest(SCENE)
        before = run(tracker, scans)
        report, d2 = pairs_of(tracker, before, run(tracker, [last], before))
        gate = tracker.settings.gate_d2
        worth = np.maximum(gate - d2, 0.0)
        best = max(
            sum(worth[i, j] for i, j in enumerate(chosen))
            for chosen in itertools.permutations(range(4), 3)
        )
        taken = sum(worth[i, j] for i, j in enumerate(report) if j >= 0)
        assert taken == pytest.approx(best)
        assert all(d2[i, j] < gate for i, j in enumerate(report) if j >= 0)
        greedy = Nearest(SCENE, NearestSettings("greedy"))
        other, d2 = pairs_of(greedy, before, run(greedy, [last], before))
        table, expected = np.where(d2 < gate, d2, np.inf), [-1] * 3
        while table.min() < np.inf:
            i, j = np.unravel_index(table.argmin(), table.shape)
            expected[i] = j
            table[i], table[:, j] = np.inf, np.inf
        assert other == expected
        different += report != other
    assert different >= 3


def test_confirmed_tracks_choose_before_others():
    tracker = Nearest(SCENE)
    state = run(tracker, [scan_of(t, [(50, 50)], first=t) for t in range(4)])
    # A track begins beside the confirmed one, and is nearer to the next report.
    state = run(tracker, [scan_of(4, [(50, 50), (51.5, 50)], first=4)], state)
    found = tracker.estimates(run(tracker, [scan_of(5, [(51.2, 50)], first=6)], state))
    assert found.track.tolist() == [1, 6]
    assert found.detected.tolist() == [True, False]
    assert 50.0 < found.mean[0, 0] < 51.2


def test_a_report_tells_its_own_covariance():
    own = np.array([[4.0, 1.0, 9.0]])
    tracker = Nearest(SCENE)
    state = run(tracker, [scan_of(0, [(50, 50)], covariance=own), scan_of(1, [(52, 50)], first=1)])
    start = np.zeros((4, 4))
    start[:2, :2], start[2:, 2:] = [[4.0, 1.0], [1.0, 9.0]], np.eye(2)
    prior = kalman.predict(
        Gaussian(np.array([50.0, 50, 0, 0]), start), *motion(SCENE.targets, 1.0, dt_s=1.0)
    )
    sensor = kalman.Linear(H, SIGMA_M**2 * np.eye(2))
    expected = kalman.update(prior, np.array([52.0, 50.0]), sensor).posterior
    np.testing.assert_allclose(tracker.estimates(state).mean, [expected.mean])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_report_is_near_along_its_long_axis(sign):
    tracker = Nearest(SCENE)
    state = run(tracker, [scan_of(t, [(50, 50)], first=t) for t in range(4)])
    places, long = [(52, 52), (48, 52)], np.array([[4.0, 3.8 * sign, 4.0]] * 2)
    state = run(tracker, [scan_of(4, places, first=4, covariance=long)], state)
    taken = tracker.explain(state, 1).alternatives[0].reports[-1]
    assert taken == (4 if sign > 0 else 5)


@pytest.mark.parametrize(
    ("seen", "shown"),
    [
        ("111", "001"),
        ("1101", "0001"),
        ("1011", "0001"),
        ("10011", "00000"),  # two misses in a row end a track that is not confirmed
        ("111000", "001111"),
        ("1110000", "0011110"),  # and four one that is
        ("11100010001", "00111111111"),
    ],
)
def test_counters_confirm_and_end_tracks(seen, shown):
    tracker, state = Nearest(SCENE), None
    found = []
    for t, one in enumerate(seen):
        state = run(tracker, [scan_of(t, [(50, 50)] if one == "1" else [], first=t)], state)
        found.append(tracker.estimates(state).shown.any())
    assert "".join("01"[int(one)] for one in found) == shown


def test_existence_is_the_share_of_steps_with_a_report():
    tracker, state, found = Nearest(SCENE), None, []
    for t, one in enumerate("111011"):
        state = run(tracker, [scan_of(t, [(50, 50)] if one == "1" else [], first=t)], state)
        found.append(float(tracker.estimates(state).existence[0]))
    assert found == [1.0, 1.0, 1.0, 0.75, 0.75, 0.75]
    explained = tracker.explain(state, 1)
    assert explained == (1, 0.75, 0.0, ((1.0, (2, -1, 4, 5)),))
    assert tracker.explain(state, 2) is None


def test_tracks_that_leave_the_region_are_neither_shown_nor_kept():
    tracker, state = Nearest(SCENE), None
    shown = []
    for t in range(9):
        places = [(95.0 + 1.5 * t, 50.0)] if t < 4 else []
        state = run(tracker, [scan_of(t, places, first=t)], state)
        shown.append(tracker.estimates(state).shown.tolist())
    assert shown[2:4] == [[True], [True]]
    assert shown[4:] == [[]] * 5


def test_hindsight_knows_what_was_confirmed_later_and_what_had_ended():
    tracker = Nearest(SCENE)
    state = run(tracker, walk(4))
    assert tracker.estimates(state, 3).shown.tolist() == [True]  # tentative then
    state = run(tracker, walk(8, missing=(5, 6, 7)))
    assert tracker.estimates(state, 2).shown.tolist() == [False]  # gone, as is known now
    assert tracker.estimates(state, 3).shown.tolist() == [True]
    assert tracker.estimates(state, 9).track.size == 0  # before the first scan


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 8))
def test_late_reports_give_what_punctual_ones_would_have(seed, delay):
    rng = np.random.default_rng(seed)
    scans = crowd(seed, steps=14)
    tracker = Nearest(SCENE)
    expected = run(tracker, scans)
    state, waiting = tracker.initial(), []
    for k, scan in enumerate(scans):
        late = rng.random(scan.number.size) < 0.5
        if k + delay >= len(scans):
            late[:] = False
        due = [part for at, part in waiting if at == k]
        parts = [ReportScan(scan.t_s, *(c[rows] for c in scan[1:])) for rows in (~late, late)]
        state, info = tracker.step(state, parts[0], due)
        assert info.counts["late"] == 0
        waiting.append((k + delay, parts[1]))
    due = [part for at, part in waiting if at >= len(scans)]
    assert not any(part.number.size for part in due)
    one, other = tracker.estimates(state), tracker.estimates(expected)
    order = np.argsort(other.track)
    mine = np.argsort(one.track)
    assert one.track[mine].tolist() == other.track[order].tolist()
    np.testing.assert_allclose(one.mean[mine], other.mean[order], rtol=1e-9)


def test_what_is_beyond_the_window_or_of_no_scan_is_dropped_and_counted():
    tracker = Nearest(SCENE, NearestSettings(window_steps=3))
    state = run(tracker, walk(8))
    late = [scan_of(2, [(1, 1), (2, 2)], first=90), scan_of(6.5, [(3, 3)], first=95)]
    _, info = tracker.step(state, scan_of(8, [], first=99), late)
    assert info.counts["late"] == 3


def test_a_state_comes_back_from_its_bytes():
    scans = crowd(3)
    tracker = Nearest(SCENE)
    for cut in (0, 1, 7):
        state = run(tracker, scans[:cut])
        back = tracker.decode(tracker.encode(state))
        assert tracker.encode(back) == tracker.encode(state)
        late = [scan_of(cut - 1, [(30, 30)], first=5000)] if cut else []
        one, other = (tracker.step(s, scans[cut], late) for s in (state, back))
        assert one[1] == other[1]
        for left, right in zip(
            tracker.estimates(run(tracker, scans[cut + 1 :], one[0])),
            tracker.estimates(run(tracker, scans[cut + 1 :], other[0])),
            strict=True,
        ):
            np.testing.assert_array_equal(left, right)


def test_other_bytes_are_refused():
    tracker = Nearest(SCENE)
    data = tracker.encode(run(tracker, crowd(1)))
    other = Nearest(SCENE, NearestSettings(confirm_steps=7))
    for decode, wrong in (
        (tracker.decode, b""),
        (tracker.decode, b"PK\x03\x04 no archive"),
        (tracker.decode, data[:-400]),
        (tracker.decode, data[: len(data) // 2]),
        (other.decode, data),
    ):
        with pytest.raises(StateError):
            decode(wrong)


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        (scan_of(5, [(np.nan, 0)]), "finite positions"),
        (scan_of(np.nan, [(0, 0)]), "finite time"),
        (scan_of(4, [(0, 0)]), "in order of time"),
        (scan_of(3, [(0, 0)]), "in order of time"),
        (ReportScan(9.0, np.zeros((2, 2)), np.zeros((1, 3)), np.zeros(2, np.int32)), "found"),
        (scan_of(9, [(0, 0)], covariance=np.array([[1.0, 2.0, 1.0]])), "positive definite"),
    ],
)
def test_scans_that_cannot_be_are_refused(scan, message):
    tracker = Nearest(SCENE)
    state = run(tracker, walk(5))
    with pytest.raises(InputError, match=message):
        tracker.step(state, scan)


def test_reports_outside_and_told_twice_are_dropped_and_counted():
    tracker = Nearest(SCENE)
    scan = scan_of(0, [(50, 50), (50, 50), (150, 50), (-1, 50)])
    state, info = tracker.step(tracker.initial(), scan)
    assert (info.counts["outside"], info.counts["duplicate"]) == (1, 1)
    state, info = tracker.step(state, scan_of(1, []), [scan_of(0, [(50, 50), (60, 60)], first=9)])
    assert (info.counts["duplicate"], info.counts["replayed"]) == (1, 1)
    assert sorted(tracker.estimates(state).track.tolist()) == [
        1,
        11,
    ]  # the one outside brought nothing more


def test_a_late_report_may_stand_where_one_of_another_scan_stood():
    tracker = Nearest(SCENE)
    state = run(tracker, [scan_of(0, [(50, 50)]), scan_of(1, [], first=1)])
    state, info = tracker.step(state, scan_of(2, [], first=1), [scan_of(1, [(50, 50)], first=1)])
    assert info.counts["duplicate"] == 0
    assert tracker.explain(state, 1).alternatives[0].reports[-3:] == (0, 1, -1)


def test_a_burst_is_bounded_and_forgotten_and_silence_holds_nothing():
    rng = np.random.default_rng(0)
    tracker = Nearest(SCENE, NearestSettings(max_tracks=200))
    state, info = tracker.step(tracker.initial(), scan_of(0, rng.uniform(0, 100, (600, 2))))
    assert tracker.estimates(state).track.size == 200
    assert info.counts["crowded_out"] == 400
    for t in range(1, 500):
        state, _ = tracker.step(state, scan_of(t, []))
    assert tracker.estimates(state).track.size == 0
    assert len(state.kept) == tracker.settings.window_steps
    assert len(tracker.encode(state)) < 10_000


def test_without_a_told_noise_it_is_guessed_from_the_region():
    scene = Scene(Reporting(REGION), Targets())
    tracker = Nearest(scene)
    state = run(tracker, [scan_of(0, [(50, 50)])])
    np.testing.assert_allclose(tracker.estimates(state).covariance[0, :2, :2], np.eye(2))


@pytest.mark.parametrize(
    ("scene", "settings", "name"),
    [
        (Scene(Reporting(Region(0, 0, 0, 1))), {}, "region"),
        (Scene(Reporting(REGION, 0.0)), {}, "step_s"),
        (Scene(Reporting(REGION, 1.0, -0.1)), {}, "sigma_m"),
        (Scene(Reporting(REGION), Targets(-1.0)), {}, "accel_sigma"),
        (Scene(Reporting(REGION), Targets(velocity_sigma_m_s=math.nan)), {}, "velocity_sigma"),
        (SCENE, {"pairing": "best"}, "pairing"),
        (SCENE, {"gate_d2": 0.0}, "gate_d2"),
        (SCENE, {"confirm_hits": 5}, "confirm_hits"),
        (SCENE, {"drop_misses": 0}, "drop_misses"),
        (SCENE, {"drop_tentative": 0}, "drop_tentative"),
        (SCENE, {"window_steps": -1}, "window_steps"),
        (SCENE, {"max_tracks": 0}, "max_tracks"),
    ],
)
def test_scenes_and_settings_that_cannot_be_are_named(scene, settings, name):
    with pytest.raises(ConfigurationError, match=name):
        Nearest(scene, NearestSettings(**settings))
    with pytest.raises(InputError, match="lag"):
        Nearest(SCENE).estimates(Nearest(SCENE).initial(), 11)


@pytest.mark.parametrize("pairing", ["optimal", "greedy"])
def test_twelve_targets_are_tracked_as_well_as_a_baseline_can(pairing):
    bench = load(ROOT / "benchmarks" / "report_scenario.py")
    tracker = Nearest(bench.SCENE, NearestSettings(pairing))
    found = [bench.judge(one, bench.shown_by(tracker, one)) for one in map(bench.draw, range(4))]
    assert np.mean([one.sets.gospa_m for one in found]) < 3.06
    assert np.mean([one.clear_mot.mota for one in found]) > 0.79


def test_the_scenario_is_that_of_the_shared_bench(shared, tmp_path):
    theirs, ours = (
        load(shared / "bench" / "gen_data.py"),
        load(ROOT / "benchmarks" / "report_scenario.py"),
    )
    theirs.D = str(tmp_path)
    theirs.gen_B(3)
    run, data = ours.draw(3), np.load(tmp_path / "B_lochness_003.npz")
    reports = np.concatenate([scan.position for scan in run.scans])
    np.testing.assert_array_equal(reports, data["meas"][:, 1:3])
    np.testing.assert_array_equal(run.source, data["meas"][:, 3])
    places = data["truth"][run.truth.target, run.truth.t_s.astype(int), :2]
    np.testing.assert_array_equal(run.truth.position[:, :2], places)
    assert len(run.truth) == np.count_nonzero(~np.isnan(data["truth"][..., 0]))
