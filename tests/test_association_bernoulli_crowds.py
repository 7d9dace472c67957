"""Clusters of any size, bursts, silence: bounded work, and still right."""

import math
from pathlib import Path

import numpy as np
import pytest

from benches import load
from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.raster import Region

bench = load(Path(__file__).parents[1] / "benchmarks" / "report_scenario.py")
SIDE = Region(0.0, 0.0, 100.0, 100.0)


def scene(*, false=6.0, side=SIDE, initial=1.0, births=0.1) -> Scene:
    return Scene(
        Reporting(side, sigma_m=0.4, p_detection=(0.73,), false_per_scan=false),
        Targets(births_per_s=births, initial_count=initial),
    )


def scan(t_s, position) -> ReportScan:
    n = len(position)
    number = np.arange(n, dtype=np.int32) + 1000 * int(t_s)
    return ReportScan(
        float(t_s), np.asarray(position, float).reshape(n, 2), np.full((n, 3), np.nan), number
    )


def side_by_side(rng, targets, spacing_m, steps, false):
    """Scans of a row of targets that walk abreast, and where they end."""
    x = np.column_stack([np.arange(targets) * spacing_m + 5.0, np.full(targets, 20.0)])
    for t in range(steps):
        x = x + [0.0, 0.8] + 0.05 * rng.standard_normal(x.shape)
        seen = x[rng.random(targets) < 0.73]
        seen = seen + 0.4 * rng.standard_normal(seen.shape)
        yield scan(t, np.concatenate([seen, rng.uniform(0, 100, (rng.poisson(false), 2))])), x


def test_a_crowd_costs_bounded_work_and_is_counted():
    tracker = Bernoulli(scene(false=50.0, initial=100.0))
    state = tracker.initial()
    spent, degraded, truth = [], 0, np.zeros((0, 2))
    for one, where in side_by_side(np.random.default_rng(0), 90, 1.0, 15, 50.0):
        truth = where
        state, info = tracker.step(state, one)
        spent.append(info.work)
        degraded += info.counts["propagated"]
    found = tracker.estimates(state)
    near = np.linalg.norm(found.mean[:, None, :2] - truth, axis=2).min(axis=1)
    assert degraded > 30
    assert max(spent) < 5 * BernoulliSettings().work
    assert found.existence.sum() == pytest.approx(90, abs=10)
    assert (near[found.shown] < 2.0).mean() > 0.95


def test_propagation_comes_close_to_enumeration():
    gaps = []
    for seed in range(8):
        thorough = BernoulliSettings(work=10**7, cluster_work=10**7, max_hypotheses=3000)
        exact = Bernoulli(scene(), thorough)
        loopy = Bernoulli(scene(), BernoulliSettings(cluster_work=0))
        a, b = exact.initial(), loopy.initial()
        for one, _ in side_by_side(np.random.default_rng(seed), 4, 1.5, 10, 6.0):
            (a, told), (b, other) = exact.step(a, one), loopy.step(b, one)
            assert told.counts["propagated"] == 0
            assert other.counts["enumerated"] == 0
        gaps.append(exact.estimates(a).existence.sum() - loopy.estimates(b).existence.sum())
    assert abs(np.mean(gaps)) < 0.25
    assert np.abs(gaps).max() < 1.0


def test_one_gaussian_a_target_is_what_the_collapse_keeps():
    tracker = Bernoulli(scene(), BernoulliSettings(recent_scans=0))
    state = tracker.initial()
    for one, _ in side_by_side(np.random.default_rng(1), 6, 1.5, 15, 6.0):
        state, _ = tracker.step(state, one)
    believed = tracker.estimates(state)
    for track in believed.track:
        explanation = tracker.explain(state, int(track))
        assert explanation is not None
        assert len(explanation.alternatives) == 1


def test_hours_of_silence_leave_nothing_behind():
    tracker = Bernoulli(scene())
    state = tracker.initial()
    for t in range(30):
        state, _ = tracker.step(state, scan(t, [[50.0 + t, 50.0]]))
    assert tracker.estimates(state).shown.sum() == 1
    sizes = []
    for t in range(30, 3000):
        state, info = tracker.step(state, scan(t, []))
        if t in (200, 2999):
            sizes.append(len(tracker.encode(state)))
    assert len(tracker.estimates(state).track) == 0
    assert info.work == 0
    assert sizes[0] == sizes[1]


def test_false_reports_for_long_neither_grow_the_state_nor_show_targets():
    rng = np.random.default_rng(2)
    tracker = Bernoulli(Scene(Reporting(SIDE), Targets()))  # all is learned
    state, sizes, shown = tracker.initial(), [], 0
    for t in range(600):
        state, info = tracker.step(state, scan(t, rng.uniform(0, 100, (rng.poisson(6), 2))))
        sizes.append(len(tracker.encode(state)))
        shown += int(tracker.estimates(state).shown.sum())
    assert shown / 600 < 0.1
    assert max(sizes[300:]) < 1.3 * max(sizes[50:300])
    assert info.learned["false_per_scan"] == pytest.approx(6.0, rel=0.1)
    assert info.learned["births_per_s"] < 0.03  # of .15 at the start
    for t in range(600, 610):  # and still a target is seen when it comes
        z = np.concatenate([[[20.0 + t - 600, 50.0]], rng.uniform(0, 100, (6, 2))])
        state, _ = tracker.step(state, scan(t, z))
    assert tracker.estimates(state).shown.sum() == 1


@pytest.mark.parametrize("false", [6.0, None])
def test_a_burst_of_false_reports_passes(false):
    rng = np.random.default_rng(3)
    tracker = Bernoulli(
        Scene(Reporting(SIDE, sigma_m=0.4, p_detection=(0.9,), false_per_scan=false), Targets())
    )
    state, bursts = tracker.initial(), 0
    for t in range(50):
        n = 600 if 20 <= t < 25 else 6
        target = [[20.0 + t, 50.0]]
        state, info = tracker.step(
            state, scan(t, np.concatenate([target, rng.uniform(0, 100, (n, 2))]))
        )
        bursts += info.counts["burst"]
        found = tracker.estimates(state)
        assert len(found.track) < 200
        if t > 10:
            assert found.shown.sum() < 6
    assert bursts == 5
    assert found.shown.sum() == 1


def test_more_tracks_than_may_be_are_crowded_out():
    tracker = Bernoulli(scene(), BernoulliSettings(max_tracks=10, least_existence=1e-6))
    state, info = tracker.step(
        tracker.initial(), scan(0, np.random.default_rng(0).uniform(0, 100, (25, 2)))
    )
    assert len(tracker.estimates(state).track) <= 10
    assert info.counts["crowded_out"] == 15


def test_existence_probabilities_are_calibrated():
    rng = np.random.default_rng(11)
    told = scene(births=0.15, initial=4.0)
    tracker = Bernoulli(told)
    believed, there = [], []
    for _ in range(25):
        state = tracker.initial()
        alive = [draw(rng, told) for _ in range(rng.poisson(4.0))]
        for t in range(45):
            if t:
                alive = [
                    m
                    for x in alive
                    if rng.random() < math.exp(-1 / 50.0) and inside(m := move(rng, x))
                ]
                alive += [draw(rng, told) for _ in range(rng.poisson(0.15))]
            seen = [x[:2] + 0.4 * rng.standard_normal(2) for x in alive if rng.random() < 0.73]
            clutter = rng.uniform(0, 100, (rng.poisson(6.0), 2))
            state, _ = tracker.step(
                state, scan(t, np.concatenate([np.array(seen).reshape(-1, 2), clutter]))
            )
            found = tracker.estimates(state)
            for r, mean, P in zip(found.existence, found.mean, found.covariance, strict=True):
                near = 4.0 * math.sqrt(np.trace(P[:2, :2]))
                there.append(any(math.hypot(*(x[:2] - mean[:2])) < near for x in alive))
                believed.append(r)
    believed, there = np.array(believed), np.array(there)
    for low, high in [(0.2, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.0)]:
        these = (believed >= low) & (believed < high)
        assert these.sum() > 50
        assert there[these].mean() == pytest.approx(believed[these].mean(), abs=0.12)


def draw(rng, told):
    return np.concatenate(
        [rng.uniform(0, 100, 2), told.targets.velocity_sigma_m_s * rng.standard_normal(2)]
    )


def move(rng, x):
    u = 0.15 * rng.standard_normal(2)
    return np.concatenate([x[:2] + x[2:] + u / 2, x[2:] + u])


def inside(x):
    return bool(((x[:2] >= 0) & (x[:2] <= 100)).all())


def judged(scene, seed):
    run = bench.draw(seed)
    return bench.judge(run, bench.shown_by(Bernoulli(scene), run))


def test_scenario_b_with_ordinary_priors():
    # Seeds that nothing was chosen on; the mean over ten (0-9) is 2.45.
    scores = [judged(bench.SCENE, seed) for seed in range(4)]
    assert np.mean([s.sets.gospa_m for s in scores]) < 2.6
    assert np.mean([s.clear_mot.switches for s in scores]) <= 1.0


def test_scenario_b_with_everything_learned():
    told, learned = (
        np.mean([judged(scene, seed).sets.gospa_m for seed in range(5)])
        for scene in (bench.SCENE, bench.UNKNOWN)
    )
    assert learned - told < 0.06
