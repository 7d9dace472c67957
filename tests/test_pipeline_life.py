"""The life of a track: start, rows, silence, end, return; and that long runs stay small."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from range_runs import Heard, box, path, run, table
from range_snapshot import opened
from range_twin import told
from trackfield.pipeline.tagged import Tracker
from trackfield.sensing.range import UNCALIBRATED, RangeModel
from trackfield.types import Status, join_rows

SITE = box(RangeModel(sigma_m=0.1), drop_s=20.0)
LEARNS = box(UNCALIBRATED, heights=(0.0, 3.0, 2.0))
SITES = {
    "modes": SITE,
    "learns": LEARNS,
    "one mode": box(motion="cv", accel_sigma_m_s2=0.1),
    "3-D": box(motion="cv", dimensions=3, heights=(0.0, 6.0, 3.0)),
}
NOTHING = table(SITE, [])


def target(start=100.0, *, steps=40, seed=0, site=SITE, **asked):
    rng = np.random.default_rng(seed)
    return run(rng, site, start + 0.125 * np.arange(steps), **asked)


def silent(rows, *, until, site=SITE, **asked):
    """A tracker that heard `rows` and then nothing; rows while it listened, and afterwards."""
    tracker = Tracker(site, **asked)
    end = max(z.t for z in rows)
    heard = tracker.process(table(site, rows), watermark_s=end)
    return tracker, heard, tracker.process(NOTHING, watermark_s=until)


def size(rows):
    """Mean variance of the position."""
    return (rows.covariance[:, 0] + rows.covariance[:, 2]) / 2


# Start ------------------------------------------------------------------------------------------


def one_by_one(sensors, *, pause=0.25):
    at = path(0.0)
    return [
        Heard(100.0 + pause * k, i, float(np.linalg.norm(at[:2] - SITE.positions[i, :2])))
        for k, i in enumerate(sensors)
    ]


@pytest.mark.parametrize(
    ("sensors", "started"),
    [
        ([0, 2, 4, 6, 0, 2, 4], 5),  # six readings, four sensors: at the sixth
        ([0, 0, 0, 0, 0, 2, 4, 6], 7),  # the fourth sensor comes late
        ([0, 2, 4, 0, 2, 4, 0, 2, 4, 0], None),  # three sensors might do, but four are waited for
    ],
)
def test_a_track_starts_from_six_readings_of_four_sensors(sensors, started):
    rows = one_by_one(sensors)
    tracker = Tracker(SITE)
    shown = join_rows([tracker.process(table(SITE, rows)), tracker.finish()])
    if started is None:
        assert len(shown) == tracker.counts["started"] == 0
    else:
        assert shown.t_s[0] == rows[started].t
        assert np.linalg.norm(shown.position[0, :2] - path(0.0)[:2]) < 0.3


def test_who_has_waited_starts_from_three_sensors():
    rows = one_by_one([0, 3, 6] * 10)
    tracker = Tracker(SITE)
    shown = tracker.process(table(SITE, rows))
    assert 104.0 < shown.t_s[0] < 105.0
    assert np.linalg.norm(shown.position[-1, :2] - path(0.0)[:2]) < 0.1


def test_old_readings_do_not_start_a_track():
    rows = one_by_one([0, 2, 4, 6, 1, 3, 5, 7] * 3, pause=1.5)
    tracker = Tracker(SITE)
    shown = join_rows([tracker.process(table(SITE, rows)), tracker.finish()])
    assert len(shown) == 0


def test_two_places_that_fit_alike_are_not_a_start():
    """Sensors nearly on a line: the mirror image waits for a sensor that tells them apart."""
    flat = np.array(SITE.positions)
    flat[:7] = [[4.0 * i - 12.0, 0.002 * (i % 2), np.nan] for i in range(7)]
    flat[7] = [0.0, 9.0, np.nan]
    site = box(RangeModel(sigma_m=0.1))
    site = type(site)(
        **{name: getattr(site, name) for name in site.__slots__} | {"positions": flat}
    )
    at = np.array([1.0, 4.0])
    r = np.linalg.norm(at - flat[:, :2], axis=1)
    blind = [Heard(100.0 + 0.1 * k, k % 7, float(r[k % 7])) for k in range(20)]
    tracker = Tracker(site)
    assert len(tracker.process(table(site, blind))) == 0
    seeing = [Heard(102.0 + 0.1 * k, k % 8, float(r[k % 8])) for k in range(20)]
    tracker.process(table(site, seeing))
    rows = tracker.finish()
    np.testing.assert_allclose(rows.position[-1, :2], at, atol=0.2)


def test_a_track_that_lost_its_target_is_started_again():
    """The target is carried elsewhere: its track gets a new place, and keeps its number."""
    rows = target(steps=60) + target(108.0, steps=80, phase=3.0)
    tracker = Tracker(SITE)
    shown = join_rows([tracker.process(table(SITE, rows)), tracker.finish()])
    before = shown.t_s < 108.0
    truth = np.where(before[:, None], path(shown.t_s), path(shown.t_s, phase=3.0))
    error = np.linalg.norm((shown.position - truth)[:, :2], axis=1)
    assert np.linalg.norm(path(108.0) - path(108.0, phase=3.0)) > 5.0
    assert tracker.counts["restarted"] == tracker.counts["started"] == 1
    assert set(shown.track) == {1}
    assert error[before][8:].max() < 0.4
    assert error[shown.t_s > 112.0].max() < 0.4
    assert (shown.status[shown.t_s > 101.0] == Status.TENTATIVE).sum() == 1  # where it restarted


def carried_away(site=SITE, *, at_reading=40):
    """Readings, one at a time, of a target that is suddenly elsewhere."""
    turn = np.pi / 8 + 0.1  # no sensor is as far from the one place as from the other
    at = 5.0 * np.array([[np.cos(turn), np.sin(turn)], [-np.cos(turn), -np.sin(turn)]])
    r = np.linalg.norm(at[:, None] - site.positions[:, :2], axis=2)
    rows = [Heard(100.0 + 0.1 * k, k % 8, float(r[int(k >= at_reading), k % 8])) for k in range(80)]
    return rows, at[1]


@pytest.mark.parametrize("at_reading", [40, 57])  # the latter when old readings are thrown away
def test_more_than_half_of_twelve_surprises_start_again(at_reading):
    """Six surprises are bad luck, seven are another place."""
    rows, there = carried_away(at_reading=at_reading)
    tracker = Tracker(SITE)
    shown = tracker.process(table(SITE, rows))
    again = np.flatnonzero((shown.status == Status.TENTATIVE) & (shown.t_s > 103.0))
    assert shown.t_s[again] == pytest.approx([rows[at_reading + 6].t])
    np.testing.assert_allclose(shown.position[-1, :2], there, atol=0.1)


def test_a_new_place_takes_little_of_what_was_learned_along():
    site = box(RangeModel(sigma_m=0.1, learn_noise=True))
    rows, _ = carried_away(site)
    tracker, pool = Tracker(site), {}
    for z in rows:
        tracker.process(table(site, [z]), watermark_s=z.t)
        belief = opened(tracker._bank.snapshot()).targets[0].belief
        pool[tracker.counts["restarted"]] = pool.get(tracker.counts["restarted"], [])
        if belief.alive:
            pool[tracker.counts["restarted"]].append((belief.pool[0], belief.heard[0]))
    lost, fresh = np.array(pool[0][-1]), np.array(pool[1][0])
    assert (lost > 5.0).all()
    assert (fresh < 0.2 * lost).all()
    assert (fresh > 0.05 * lost).all()


def test_what_no_place_explains_better_starts_nothing():
    """Readings too long and too short by turns surprise like another place, but none fits."""
    r = np.linalg.norm(path(0.0)[:2] - SITE.positions[:, :2], axis=1)
    opposite = (0, 4, 2, 6, 1, 5, 3, 7)
    rows = []
    for k in range(80):
        i = opposite[k % 8]
        wrong = (1.0, 1.0, -1.0, -1.0)[k % 4] if 40 <= k < 60 else 0.0
        rows.append(Heard(100.0 + 0.1 * k, i, float(r[i] + wrong)))
    tracker = Tracker(SITE)
    shown = tracker.process(table(SITE, rows))
    assert (shown.nis[40:60] == 9.0).sum() > 10
    assert tracker.counts["restarted"] == 0
    assert np.linalg.norm((shown.position[-1] - path(0.0))[:2]) < 0.2


# Rows -------------------------------------------------------------------------------------------


def test_the_first_rows_are_tentative_and_the_others_confirmed():
    tracker = Tracker(SITE)
    shown = tracker.process(table(SITE, target()))
    assert shown.status.tolist() == [0, 0, 0] + [1] * (len(shown) - 3)
    assert np.isnan(shown.nis[0])
    assert np.isfinite(shown.nis[1:]).all()
    assert np.isnan(shown.position[:, 2]).all()  # the height is nobody's business here
    assert (shown.target == -1).all()  # an anonymous target


@pytest.mark.parametrize("every", [0.2, 0.25, 1.0])
def test_rows_are_thinned(every):
    """An outage is bridged by coasting rows; what is shown of updates is what it always was."""
    rows = target() + target(112.0)
    all_rows, shown = (Tracker(SITE, every_s=e).process(table(SITE, rows)) for e in (0.0, every))
    assert np.diff(shown.t_s).min() >= every - 1e-9
    assert np.diff(shown.t_s).max() < max(2 * every, 1.0) + 0.125
    assert len(shown) == pytest.approx((all_rows.t_s[-1] - 100.0) / every, rel=0.3)
    updated = shown.status != Status.COASTING
    same_time = np.isin(all_rows.t_s, shown.t_s[updated])
    for column in ("position", "velocity", "covariance", "nis"):
        expected = getattr(all_rows, column)[same_time]
        np.testing.assert_array_equal(getattr(shown, column)[updated], expected)
    silence = (shown.t_s > 104.875) & (shown.t_s < 112.0)
    np.testing.assert_array_equal(~updated, silence)


def test_rows_with_a_lag_come_once_they_are_that_old():
    rows = target()
    by_time, by_steps = Tracker(SITE, lag_s=0.5), Tracker(SITE, lag_steps=4)
    for tracker in (by_time, by_steps):
        early = tracker.process(table(SITE, rows), watermark_s=rows[-1].t)
        late = tracker.finish()
        assert early.t_s[-1] == rows[-1].t - 0.5
        assert late.t_s.tolist() == [rows[-1].t - 0.125 * k for k in (3, 2, 1, 0)]


def test_a_lag_makes_tracks_better():
    error, spread = [], []
    for lag in (0, 2, 10):
        found = []
        for seed in range(10):
            tracker = Tracker(SITE, lag_steps=lag)
            shown = tracker.process(table(SITE, target(steps=100, seed=seed)))
            found.append(shown)
        shown = join_rows(found)
        keep = shown.t_s > 103.0
        off = np.linalg.norm((shown.position - path(shown.t_s))[keep, :2], axis=1)
        error.append(np.sqrt(np.mean(off**2)))
        spread.append(np.sqrt(np.mean(size(shown)[keep])))
    assert error[0] > 1.15 * error[1] > 1.1 * error[2]
    assert spread[0] > spread[1] > spread[2]


def test_known_and_open_heights_are_shown():
    rng = np.random.default_rng(0)
    for asked, sigma in (({"height_m": 0.7}, 0.0), ({}, 0.4), ({"dimensions": 3}, 1.0)):
        site = box(RangeModel(sigma_m=0.05), heights=(0.0, 5.0, 3.0), **asked)
        times = 100.0 + 0.125 * np.arange(60)
        rows = run(rng, site, times, height=0.7, noise=0.05, most=8)
        shown = Tracker(site).process(table(site, rows))
        truth = path(shown.t_s, dimensions=site.target.dimensions, height=0.7)
        if sigma == 0.0:
            assert np.isnan(shown.position[:, 2]).all()
        else:
            off = (shown.position - truth)[10:, 2]
            assert np.sqrt(np.mean(off**2)) < sigma * 0.5


# Silence, end, return ---------------------------------------------------------------------------


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    every=st.sampled_from([0.2, 0.5, 2.0]),
    name=st.sampled_from(sorted(SITES)),
)
def test_a_silent_target_coasts_with_growing_doubt(seed, every, name):
    site = SITES[name]
    rows = target(seed=seed, site=site)
    last = rows[-1].t
    _, heard, _ = silent(rows, until=last, site=site)
    _, thinned, coasted = silent(rows, until=last + 18.0, site=site, every_s=every)
    assert (coasted.status == Status.COASTING).all()
    np.testing.assert_allclose(np.diff(coasted.t_s), every)
    assert coasted.t_s[0] == pytest.approx(thinned.t_s[-1] + every)
    assert last + 18.0 - coasted.t_s[-1] < max(2 * every, 1.0)
    assert np.isnan(coasted.nis).all()
    assert (coasted.track == heard.track[-1]).all()
    assert np.all(np.diff(size(coasted)) > 0)
    assert size(coasted)[0] > size(heard)[-1]
    assert size(coasted)[-1] > 4.0  # metres of doubt after many seconds
    # Velocity is forgotten: the target is not believed to be kilometres away.
    moved = np.linalg.norm((coasted.position[-1] - heard.position[-1])[:2])
    assert moved < 10.1 * np.linalg.norm(heard.velocity[-1, :2]) + 1.1


def test_doubt_covers_where_silent_targets_went():
    inside = []
    for seed in range(60):
        rows = run(
            np.random.default_rng(seed),
            LEARNS,
            100.0 + 0.125 * np.arange(40),
            phase=0.1 * seed,
            height=1.0,
        )
        _, _, coasted = silent(rows, until=115.0, site=LEARNS, every_s=2.0)
        off = (coasted.position - path(coasted.t_s, phase=0.1 * seed))[:, :2]
        xx, xy, yy = coasted.covariance.T
        d2 = (yy * off[:, 0] ** 2 - 2 * xy * off[:, 0] * off[:, 1] + xx * off[:, 1] ** 2) / (
            xx * yy - xy**2
        )
        inside.append(d2 < 5.99)
    assert np.mean(inside) > 0.9


@pytest.mark.parametrize("asked", [{}, {"every_s": 0.5}, {"lag_s": 1.0}, {"lag_steps": 3}])
def test_a_track_ends_when_it_was_silent_for_long(asked):
    rows = target()
    last = rows[-1].t
    tracker, heard, later = silent(rows, until=last + 21.0, **asked)
    ended = later.status == Status.ENDED
    assert ended.tolist() == [False] * (len(later) - 1) + [True]
    assert later.t_s[-1] == last + 20.0
    assert size(later)[-1] > 1.0
    assert tracker.counts["ended"] == 1
    assert len(tracker.process(NOTHING, watermark_s=last + 500.0)) == 0
    # The target comes back: the same name, another track.
    rows = target(300.0)
    again = join_rows([tracker.process(table(SITE, rows)), tracker.finish()])
    assert set(heard.track) == {1}
    assert set(again.track) == {2}
    assert again.status[0] == Status.TENTATIVE
    assert tracker.counts["started"] == 2


@pytest.mark.parametrize("asked", [{}, {"every_s": 0.5}, {"lag_s": 1.0}])
def test_a_track_ends_when_its_target_returns_too_late(asked):
    """Without a watermark, only the next reading tells how long it was silent."""
    rows = [z._replace(target="x") for z in target() + target(300.0)]
    tracker = Tracker(SITE, **asked)
    shown = join_rows([tracker.process(table(SITE, rows)), tracker.finish()])
    (end,) = np.flatnonzero(shown.status == Status.ENDED)
    assert shown.t_s[end] == pytest.approx(100.0 + 39 * 0.125 + 20.0)
    assert set(shown.track[: end + 1]) == {1}
    assert set(shown.track[end + 1 :]) == {2}
    assert set(shown.target) == {0}
    error = np.linalg.norm((shown.position - path(shown.t_s))[end + 1 :, :2], axis=1)
    assert error[-20:].max() < 0.4
    assert tracker.counts["ended"] == 1


def test_what_was_heard_before_the_end_does_not_start_the_next_track():
    site = box(RangeModel(sigma_m=0.1), drop_s=6.0)
    rows = one_by_one([k % 8 for k in range(40)])
    back = rows[-1].t + 8.0
    rows += [z._replace(t=z.t - 100.0 + back) for z in one_by_one([0, 3, 6] * 10)]
    tracker = Tracker(site)
    shown = tracker.process(table(site, rows))
    assert shown.t_s[shown.track == 2][0] > back + 4.0  # from three sensors, having waited


def test_an_outage_that_is_not_too_long_keeps_the_track():
    rows = target() + target(115.0)
    tracker = Tracker(SITE)
    shown = tracker.process(table(SITE, rows))
    assert set(shown.track) == {1}
    assert tracker.counts["ended"] == 0
    error = np.linalg.norm((shown.position - path(shown.t_s))[:, :2], axis=1)
    assert error[shown.t_s > 115.5].max() < 0.4


# What is counted --------------------------------------------------------------------------------


def test_readings_are_counted_by_how_they_fared():
    site = box(RangeModel(sigma_m=0.1, max_range_m=15.0), window_s=1.0)
    rows = target(site=site)
    kept = sum(z.value <= 15.5 for z in rows)
    again, old = rows[-10], Heard(rows[-1].t - 1.01, 0, 5.0)
    far = Heard(rows[-1].t, 0, 15.6)
    tracker = Tracker(site)
    tracker.process(table(site, [*rows, rows[-1], again, old, far]))
    tracker.finish()
    assert tracker.counts == {
        "accepted": kept,
        "duplicate": 2,
        "late": 1,
        "out_of_range": len(rows) - kept + 1,
        "started": 1,
        "restarted": 0,
        "ended": 0,
        "rewound": 0,
    }
    assert tracker.heard == site.sensor_ids


def test_a_reading_as_late_as_the_window_still_counts():
    rows = target()
    tracker = Tracker(SITE)
    tracker.process(table(SITE, rows))
    for age, late in ((1.0, 0), (1.001, 1)):
        sensor = (
            0
            if late
            else next(
                i for i in range(8) if (rows[-1].t - age, i) not in {(z.t, z.sensor) for z in rows}
            )
        )
        tracker.process(table(SITE, [Heard(rows[-1].t - age, sensor, 9.0)]))
        assert tracker.counts["late"] == late


def test_a_duplicate_of_another_value_is_a_duplicate():
    rows = target()
    twice = [copy for z in rows for copy in (z, z._replace(value=z.value + 3.0))]
    once, again = Tracker(SITE), Tracker(SITE)
    a, b = once.process(table(SITE, rows)), again.process(table(SITE, twice))
    np.testing.assert_array_equal(a.position, b.position)
    assert again.counts["duplicate"] == len(rows)


def test_a_start_that_is_taken_back_counts_once():
    """Late readings rewind a start; what is counted is what stands in the end."""
    rng = np.random.default_rng(0)
    rows = target(steps=100)
    key = [z.t + rng.uniform(0.0, 0.9) for z in rows]
    tracker = Tracker(SITE)
    tracker.process(table(SITE, [rows[i] for i in np.argsort(key)]))
    tracker.finish()
    assert tracker.counts["rewound"] > 10
    assert (tracker.counts["started"], tracker.counts["late"]) == (1, 0)


@pytest.mark.parametrize("window", [0.0, 1.0])
def test_a_reading_at_the_watermark_may_come_too_late(window):
    """Without a window it is dropped; with one the scan is taken up again. The track stays."""
    site = box(RangeModel(sigma_m=0.1), window_s=window)
    rows = target(site=site)
    t = rows[-1].t
    missing = next(i for i in range(8) if i not in {z.sensor for z in rows if z.t == t})
    at = np.linalg.norm(path(t)[:2] - site.positions[missing, :2])
    tracker = Tracker(site)
    tracker.process(table(site, rows), watermark_s=t)
    before = opened(tracker._bank.snapshot()).targets[0].belief
    tracker.process(table(site, [Heard(t, missing, float(at))]), watermark_s=t)
    after = opened(tracker._bank.snapshot()).targets[0].belief
    assert after.alive
    assert after.step == before.step
    assert tracker.counts["late"] == (window == 0.0)
    assert np.array_equal(after.mean, before.mean) == (window == 0.0)


# Size -------------------------------------------------------------------------------------------


def resident_mb():
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="missing: /proc")
def test_a_long_run_stays_small_and_sound():
    """200 000 readings of one target: nothing grows, every covariance is one."""
    rng = np.random.default_rng(0)
    tracker = Tracker(LEARNS, lag_s=0.5)
    chunk, per_scan = 1000, 5
    sizes, memory = [], []
    at = np.nan_to_num(LEARNS.positions)
    for k in range(40):
        t = np.repeat(100.0 + 0.1 * (k * chunk + np.arange(chunk)), per_scan)
        sensor = np.argsort(rng.random((chunk, 8)), axis=1)[:, :per_scan].astype(np.int32).ravel()
        r = np.linalg.norm(path(t, height=1.0) - at[sensor], axis=1)
        late = (rng.random(r.size) < 0.05) * rng.exponential(1.0, r.size)
        readings = table(LEARNS, [])
        columns = {
            "t_s": t,
            "sensor": sensor,
            "value": r + 0.1 * rng.standard_normal(r.size) + late,
            "target": np.full(r.size, -1, np.int32),
            "kind": np.zeros(r.size, np.int32),
            "sigma": np.full(r.size, np.nan),
            "arrival_s": np.full(r.size, np.nan),
        }
        names = {n: getattr(readings, n) for n in ("sensor_ids", "target_ids", "kinds")}
        shown = tracker.process(type(readings)(**columns, **names))
        xx, xy, yy = shown.covariance.T
        assert np.isfinite(shown.position[:, :2]).all()
        assert (xx > 0).all()
        assert (xx * yy - xy**2 > 0).all()
        sizes.append(len(tracker.snapshot()))
        memory.append(resident_mb())
    assert tracker.counts["accepted"] == 200_000
    assert tracker.counts["restarted"] == 0
    assert max(sizes) < 1.5 * sizes[0]
    assert memory[-1] - memory[4] < 8.0
    error = np.linalg.norm((shown.position - path(shown.t_s))[:, :2], axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.15


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    reach=st.sampled_from([1e-3, 30.0, 1e5, 1e7, 1e300]),
    name=st.sampled_from(sorted(SITES)),
    asked=st.sampled_from([{}, {"lag_steps": 2}, {"every_s": 0.1}]),
)
def test_nonsense_gives_sound_rows(seed, reach, name, asked):
    """Whatever is heard, rows are numbers, and covariances are covariances."""
    site = SITES[name]
    rng = np.random.default_rng(seed)
    pauses = 10.0 ** rng.uniform(-6, 2, 150) * (rng.random(150) < 0.6)
    t = 100.0 + np.cumsum(pauses) - 0.8 * rng.random(150) * (rng.random(150) < 0.2)
    near = target(site=site, steps=20)[:60]
    nonsense = [
        Heard(
            float(t[k]),
            int(rng.integers(8)),
            float(reach ** rng.uniform(-0.2, 1.0)),
            float(10.0 ** rng.uniform(-12, 30)) if rng.random() < 0.2 else 0.0,
        )
        for k in range(150)
    ]
    tracker = Tracker(site, **asked)
    rows = near + [z._replace(t=z.t + near[-1].t - 100.0) for z in nonsense]
    shown = join_rows([tracker.process(table(site, rows)), tracker.finish()])
    D = site.target.dimensions
    assert np.isfinite(shown.position[:, :D]).all()
    assert np.isfinite(shown.velocity[:, :D]).all()
    xx, xy, yy = shown.covariance.T
    assert (xx > 0).all()
    assert (yy > 0).all()
    assert (xx * yy - xy**2 > -1e-9 * xx * yy).all()
    belief = opened(tracker._bank.snapshot()).targets[0].belief
    if belief.alive:
        for mean, P in [m for m in belief.modes if m[0].size]:
            assert np.isfinite(mean).all()
            sigma = np.sqrt(np.diag(P))
            correlation = P / np.outer(sigma, sigma)
            assert np.linalg.eigvalsh(correlation).min() > -1e-6
    assert sum(tracker.counts[c] for c in ("accepted", "duplicate", "late", "out_of_range")) == len(
        rows
    )


def test_settings_of_the_kernel_are_checked():
    with pytest.raises(ValueError, match="1 to 4 modes"):
        told(SITE, modes=[])
