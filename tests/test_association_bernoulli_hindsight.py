"""Hindsight, late reports, identities, what is learned and told: against closed forms."""

import math

import numpy as np
import pytest

from bernoulli_twin import transition
from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.errors import InputError
from trackfield.raster import Raster, Region

REGION = Region(0.0, 0.0, 1000.0, 1000.0)
CROSSED = np.array([0.2, 0.07, 0.1])  # xx, xy, yy of a report that is sharper along one diagonal


def scan(t_s, position, covariance=None, first=None) -> ReportScan:
    position = np.asarray(position, dtype=float).reshape(-1, 2)
    n = len(position)
    told = np.full((n, 3), np.nan) if covariance is None else np.tile(covariance, (n, 1))
    number = np.arange(n, dtype=np.int32) + (1000 * int(t_s) if first is None else first)
    return ReportScan(float(t_s), position, told, number)


def run(tracker, scans):
    state = tracker.initial()
    for one in scans:
        state, _ = tracker.step(state, one)
    return state


def one_target(**told) -> Scene:
    reporting = {"sigma_m": 0.4, "p_detection": (0.8,), "false_per_scan": 0.1} | told
    return Scene(Reporting(REGION, **reporting))


def test_hindsight_is_the_dense_posterior_of_all_states():
    times = [0.0, 1.0, 3.0, 4.0, 4.5, 6.0]
    z = np.array([[500 + 2 * t, 500 - t] for t in times]) + np.random.default_rng(1).normal(
        0, 0.3, (6, 2)
    )
    tracker = Bernoulli(one_target())
    state = run(tracker, [scan(t, p, CROSSED) for t, p in zip(times, z, strict=True)])

    # Joint Gaussian of all states: x_0 from the first report, then x_k = F x_{k-1} + w.
    n = len(times)
    R = np.array([[CROSSED[0], CROSSED[1]], [CROSSED[1], CROSSED[2]]])
    J, h = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    J[2:4, 2:4] += np.eye(2)
    for k in range(n):
        i = slice(4 * k, 4 * k + 2)
        J[i, i] += np.linalg.inv(R)
        h[i] += np.linalg.solve(R, z[k])
        if k:
            F, Q, _ = transition(times[k] - times[k - 1], 1.0, 0.15)
            D = np.zeros((4, 4 * n))
            D[:, 4 * k - 4 : 4 * k], D[:, 4 * k : 4 * k + 4] = -F, np.eye(4)
            J += D.T @ np.linalg.inv(Q + 1e-11 * np.eye(4)) @ D
    P = np.linalg.inv(J)
    mean = P @ h
    for lag in range(n):
        found = tracker.estimates(state, lag)
        best = int(np.argmax(found.existence))
        at = slice(4 * (n - 1 - lag), 4 * (n - lag))
        assert found.t_s == times[n - 1 - lag]
        assert found.detected[best]
        np.testing.assert_allclose(found.mean[best], mean[at], atol=3e-3)
        np.testing.assert_allclose(found.covariance[best], P[at, at], atol=3e-3)


def test_existence_in_hindsight_sums_over_when_a_target_ended():
    p, s, seen, silent = 0.7, math.exp(-1 / 10.0), 4, 3
    told = Scene(
        Reporting(REGION, sigma_m=0.4, p_detection=(p,), false_per_scan=1e-6),
        Targets(lifetime_s=10.0),
    )
    tracker = Bernoulli(told)
    scans = [scan(t, [[500.0 + t, 500.0]]) for t in range(seen)]
    state = run(tracker, [*scans, *(scan(seen + k, []) for k in range(silent))])
    # Ended after `k` silent scans of being there, or there still.
    ways = [(s * (1 - p)) ** k * (1 - s) for k in range(silent)] + [(s * (1 - p)) ** silent]
    for lag in range(silent + 2):
        found = tracker.estimates(state, lag)
        alive = sum(ways[silent - lag :]) if lag <= silent else sum(ways)
        assert found.existence.max() == pytest.approx(alive / sum(ways), rel=1e-3)


def test_a_target_that_left_is_still_there_in_hindsight():
    tracker = Bernoulli(one_target(p_detection=(0.95,)))
    scans = [scan(t, [[500.0 + t, 500.0]]) for t in range(8)]
    state = run(tracker, [*scans, *(scan(8 + k, []) for k in range(8))])
    assert not tracker.estimates(state).shown.any()
    assert tracker.estimates(state, 9).shown.sum() == 1
    assert tracker.estimates(state, 9).mean[0, 0] == pytest.approx(506.0, abs=0.5)


def test_lags_beyond_what_is_kept_are_refused_and_early_ones_empty():
    tracker = Bernoulli(one_target(), BernoulliSettings(history_steps=3))
    state = run(tracker, [scan(0, [[5.0, 5.0]])])
    assert len(tracker.estimates(state, 2).track) == 0
    assert len(tracker.estimates(tracker.initial()).track) == 0
    for lag in (-1, 4):
        with pytest.raises(InputError, match="lag of 0 to 3"):
            tracker.estimates(state, lag)


def test_a_track_says_why_it_is_there():
    tracker = Bernoulli(one_target())
    scans = [scan(t, [[500.0 + t, 500.0]] if t != 3 else []) for t in range(5)]
    state = run(tracker, scans)
    track = int(tracker.estimates(state).track[0])
    why = tracker.explain(state, track)
    assert why is not None
    assert why.alternatives[0].reports == (-1, -1, -1, 0, 1000, 2000, -1, 4000)
    assert why.existence == pytest.approx(sum(a.probability for a in why.alternatives))
    assert why.first_s == 0.0
    assert tracker.explain(state, 10**6) is None
    assert tracker.explain(tracker.initial(), 1) is None


def test_an_identity_survives_a_late_report_from_before_its_track():
    told = one_target(p_detection=(0.9, 0.9, 0.9, 0.9))
    tracker = Bernoulli(told)
    state, shown = tracker.initial(), []
    for t in range(2, 7):
        state, _ = tracker.step(state, scan(t, [[500.0 + t, 500.0]]))
        found = tracker.estimates(state)
        shown += found.track[found.shown].tolist()
    # The report of step 2 was not the target's first: those of a step before it arrive only now.
    early = Bernoulli(told)
    state = early.initial()
    state, _ = early.step(state, scan(1, []))
    names = []
    for t in range(2, 9):
        late = [scan(1, [[501.0, 500.0]], first=77)] if t == 6 else []
        state, info = early.step(state, scan(t, [[500.0 + t, 500.0]]), late)
        found = early.estimates(state)
        names += found.track[found.shown].tolist()
        assert info.counts["late"] == 0
    assert early.explain(state, names[-1]).first_s == 1.0
    assert len(set(shown)) == len(set(names)) == 1


def test_delivery_is_learned_from_how_late_reports_come():
    rng = np.random.default_rng(4)
    tracker = Bernoulli(one_target(p_detection=(0.9,)))
    state, waiting, shown = tracker.initial(), [], 0
    for t in range(60):
        due = [part for when, part in waiting if when == t]
        waiting = [(when, part) for when, part in waiting if when > t]
        now = scan(t, [[300.0 + t, 500.0]] if rng.random() < 0.9 else [])
        if rng.random() < 0.6:
            waiting.append((t + 1 + int(rng.integers(0, 2)), now))
            now = scan(t, [])
        state, info = tracker.step(state, now, due)
        shown += int(tracker.estimates(state).shown.sum()) * (t >= 15)
        assert info.counts["replayed"] <= 10
    assert shown >= 43  # of 45 steps, though most scans are empty at first


def test_what_is_left_open_is_learned():
    rng = np.random.default_rng(8)
    region = Region(0.0, 0.0, 200.0, 200.0)
    tracker = Bernoulli(Scene(Reporting(region), Targets(births_per_s=0.02)))
    x, v = rng.uniform(40, 160, (15, 2)), rng.normal(0, 0.3, (15, 2))
    state = tracker.initial()
    for t in range(120):
        x = x + v
        seen = x[rng.random(15) < 0.8]
        z = np.concatenate(
            [seen + rng.normal(0, 0.7, seen.shape), rng.uniform(0, 200, (rng.poisson(10), 2))]
        )
        state, info = tracker.step(state, scan(t, z))
    assert info.learned["sigma_m"] == pytest.approx(0.7, rel=0.15)
    assert info.learned["p_detection"] == pytest.approx(0.8, abs=0.05)
    assert info.learned["false_per_scan"] == pytest.approx(10.0, rel=0.15)
    assert tracker.estimates(state).shown.sum() == pytest.approx(15, abs=2)


def test_maps_say_where_targets_come_and_are_seen():
    half = Raster(REGION, np.array([[0.0, 1.0]]))
    west, east = scan(0, [[200.0, 500.0]]), scan(0, [[800.0, 500.0]])

    def existence(one, *, p=0.8, false_map=1.0, **targets):
        reporting = Reporting(
            REGION, sigma_m=0.4, p_detection=(p,), false_per_scan=5.0, false_map=false_map
        )
        tracker = Bernoulli(
            Scene(reporting, Targets(**targets)), BernoulliSettings(least_existence=0.0)
        )
        found = tracker.estimates(run(tracker, [one]))
        return float(found.existence.sum())

    plain = existence(east)
    unseen = 0.8 / REGION.area
    assert plain == pytest.approx(unseen / (unseen + 5.0 / REGION.area))
    assert existence(west, birth_map=half) == 0.0
    twice = 2 * unseen / (2 * unseen + 5.0 / REGION.area)
    assert existence(east, birth_map=half) == pytest.approx(twice)
    assert existence(west, p=half) == 0.0
    assert existence(west, false_map=half) == pytest.approx(1.0, abs=1e-5)
    denser = unseen / (unseen + 10.0 / REGION.area)
    assert existence(east, false_map=half) == pytest.approx(denser)


def test_a_lifetime_told_by_age_ends_a_target_when_it_must():
    told = Scene(
        Reporting(REGION, sigma_m=0.4, p_detection=(0.8,), false_per_scan=0.1),
        Targets(hazard=(0.0, 0.0, 0.0, 0.0, 1.0)),
    )
    tracker = Bernoulli(told)
    scans = [scan(t, [[500.0 + t, 500.0]]) for t in range(4)]
    state = run(tracker, [*scans, scan(4, [])])
    before = tracker.estimates(state).existence.max()
    state, _ = tracker.step(state, scan(5, []))
    assert before > 0.1
    assert len(tracker.estimates(state).track) == 0


def test_targets_never_seen_gather_where_nobody_looks_and_move():
    blind = Raster(REGION, np.array([[0.0, 0.9]]))
    tracker = Bernoulli(
        Scene(
            Reporting(REGION, sigma_m=0.4, p_detection=(blind,), false_per_scan=1.0),
            Targets(births_per_s=1.0, velocity_sigma_m_s=50.0),
        )
    )
    quick, slow = (scan(t, [[600.0, 500.0]]) for t in (1, 21))
    after = []
    for last in (quick, slow):
        state = run(tracker, [scan(t, []) for t in range(int(last.t_s))])
        state, _ = tracker.step(state, last)
        after.append(float(tracker.estimates(state).existence.max()))
    assert after[1] > after[0]  # out of the blind half, they have come by then
