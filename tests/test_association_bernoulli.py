import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from bernoulli_twin import Twin, exact_kernel
from trackfield._core import _bernoulli as kernel
from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.raster import Raster, Region

REGION = Region(0.0, 0.0, 100.0, 100.0)


def scene(region=REGION, *, sigma_m=0.4, p=(0.73,), false=6.0, **targets) -> Scene:
    return Scene(
        Reporting(region, sigma_m=sigma_m, p_detection=p, false_per_scan=false),
        Targets(**{"births_per_s": 0.1, **targets}),
    )


def scan(t_s, position, number=None, *, sigma_m=math.nan) -> ReportScan:
    position = np.asarray(position, dtype=float).reshape(-1, 2)
    n = len(position)
    covariance = np.full((n, 3), np.nan)
    if not math.isnan(sigma_m):
        covariance[:] = [sigma_m**2, 0.0, sigma_m**2]
    if number is None:
        number = 1000 * int(t_s) + np.arange(n)
    return ReportScan(float(t_s), position, covariance, np.asarray(number, dtype=np.int32))


def run(tracker, scans, state=None):
    state = tracker.initial() if state is None else state
    for one in scans:
        state, _ = tracker.step(state, one)
    return state


def walk(rng, targets, steps, *, side=100.0, p=0.73, sigma=0.4, false=6.0, accel=0.15):
    """Scans and true positions (steps, targets, 2) of targets that are there from the start."""
    x = rng.uniform(0.2 * side, 0.8 * side, (targets, 2))
    v = rng.normal(0.0, 0.7, (targets, 2))
    scans, truth = [], []
    for t in range(steps):
        u = rng.normal(0.0, accel, (targets, 2))
        x, v = x + v + u / 2, v + u
        truth.append(x)
        seen = x[rng.random(targets) < p]
        seen = seen + rng.normal(0.0, sigma, seen.shape)
        clutter = rng.uniform(0.0, side, (rng.poisson(false), 2))
        both = np.concatenate([seen, clutter])
        scans.append(scan(t, both[rng.permutation(len(both))]))
    return scans, np.array(truth)


def same(a, b, *, rtol=0.0, atol=0.0, identities=True) -> None:
    assert a.t_s == b.t_s
    if identities:
        np.testing.assert_array_equal(a.track, b.track)
    np.testing.assert_array_equal(a.shown, b.shown)
    np.testing.assert_array_equal(a.detected, b.detected)
    for field in ("existence", "mean", "covariance", "first_s"):
        np.testing.assert_allclose(getattr(a, field), getattr(b, field), rtol=rtol, atol=atol)


@pytest.mark.parametrize("seed", range(12))
def test_every_joint_hypothesis_written_out_gives_the_same_beliefs(seed):
    rng = np.random.default_rng(seed)
    given_scene = scene(
        Region(0.0, 0.0, 8.0, 8.0),
        sigma_m=0.5,
        p=(float(rng.uniform(0.3, 0.95)),),
        false=float(rng.uniform(0.2, 3.0)),
        lifetime_s=float(rng.uniform(5.0, 50.0)),
        births_per_s=float(rng.uniform(0.1, 2.0)),
        survival_map=0.97,
    )
    twin, model, state = Twin(given_scene), exact_kernel(given_scene), kernel.State()
    t, next_number = 0.0, 0
    for _ in range(4):
        n = int(rng.integers(0, 3))
        position = np.sort(rng.uniform(2.0, 6.0, (n, 2)), axis=0)
        number = np.arange(next_number, next_number + n, dtype=np.int32)
        next_number += n
        twin.step(t, position, 0.5, number)
        state = model.step(state, t, position, np.full((n, 3), np.nan), number, 0, 1.0)
        t += float(rng.choice([1.0, 1.0, 3.0, 1.7]))
    _, numbers, _ = model.estimates(state, kernel.Names(), 0)
    expected = sorted((e.first_s, e.r, *e.mean, *e.P.ravel()) for e in twin.estimates().values())
    found = sorted(tuple(row) for row in numbers.tolist())
    assert next_number == len(expected) == len(found)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)


def test_existence_over_three_scans_is_bayes_by_hand():
    # A report, a silence, a report: all terms written out.
    p, clutter, born, s = 0.6, 2e-2, 1e-2, math.exp(-1 / 50.0)
    box = Region(0.0, 0.0, 10.0, 10.0)
    tracker = Bernoulli(
        scene(box, p=(p,), false=2.0, births_per_s=1.0, initial_count=1.0),
        BernoulliSettings(least_existence=0.0),
    )
    state = run(tracker, [scan(0, [[5.0, 5.0]]), scan(1, []), scan(2, [[5.5, 5.0]])])
    found = tracker.estimates(state)

    unseen = 1.0 / box.area
    r = p * unseen / (clutter + p * unseen)
    unseen = ((unseen * (1 - p)) * s + born) * (1 - p) * s + born
    rho = clutter + p * unseen

    def inside(variance):
        return (2 * norm(0, math.sqrt(variance)).cdf(5.0) - 1) ** 2

    q = 0.15**2
    r *= s * inside(0.16 + 1.0 + q / 4)
    r = r * (1 - p) / (1 - r * p)
    variance = 0.16 + 4.0 + q * (1.5**2 + 0.5**2)
    r *= s * inside(variance)
    S = variance + 0.16
    given_it = r * p * norm(0, math.sqrt(S)).pdf(0.5) * norm(0, math.sqrt(S)).pdf(0.0) / rho
    missed = 1 - r * p
    old = (given_it + missed * r * (1 - p) / (1 - r * p)) / (given_it + missed)
    new = missed / (given_it + missed) * p * unseen / rho
    assert found.existence.sum() == pytest.approx(old + new, rel=1e-12)
    assert found.existence.max() == pytest.approx(max(old, new), rel=1e-12)


@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_the_order_of_reports_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    scans, _ = walk(rng, 5, 12, side=30.0, false=4.0)
    tracker = Bernoulli(scene(Region(0.0, 0.0, 30.0, 30.0), false=4.0))
    shuffled = []
    for one in scans:
        order = rng.permutation(len(one.number))
        shuffled.append(
            ReportScan(one.t_s, one.position[order], one.covariance[order], one.number[order])
        )
    same(tracker.estimates(run(tracker, scans)), tracker.estimates(run(tracker, shuffled)))


def test_a_moved_world_is_tracked_alike():
    scans, _ = walk(np.random.default_rng(5), 6, 20, side=40.0)
    moved = [s._replace(position=s.position + np.array([1024.0, -512.0])) for s in scans]
    here = Bernoulli(scene(Region(0.0, 0.0, 40.0, 40.0)))
    there = Bernoulli(scene(Region(1024.0, -512.0, 1064.0, -472.0)))
    a = here.estimates(run(here, scans))
    b = there.estimates(run(there, moved))
    same(a, b._replace(mean=b.mean - np.array([1024.0, -512.0, 0.0, 0.0])), rtol=1e-6, atol=1e-8)


def test_far_apart_problems_do_not_touch_each_other():
    left, _ = walk(np.random.default_rng(1), 3, 15, side=20.0, false=1.0)
    right, _ = walk(np.random.default_rng(2), 3, 15, side=20.0, false=1.0)
    wide = Bernoulli(scene(Region(-1000.0, -1000.0, 2000.0, 1020.0), false=1.0))
    both = [
        scan(
            a.t_s,
            np.concatenate([a.position, b.position + np.array([1000.0, 0.0])]),
            np.concatenate([a.number, b.number + 500]),
        )
        for a, b in zip(left, right, strict=True)
    ]
    together = wide.estimates(run(wide, both))
    alone = wide.estimates(run(wide, left))
    mine = together.mean[:, 0] < 500.0
    np.testing.assert_allclose(together.existence[mine], alone.existence, rtol=1e-12)
    np.testing.assert_allclose(together.mean[mine], alone.mean, rtol=1e-12)
    assert (~mine).sum() > 0


def test_a_state_written_and_read_goes_on_bit_by_bit():
    scans, _ = walk(np.random.default_rng(3), 8, 30, side=40.0)
    tracker = Bernoulli(scene(Region(0.0, 0.0, 40.0, 40.0), sigma_m=None, p=None, false=None))
    whole = half = run(tracker, scans[:15])
    half = tracker.decode(tracker.encode(half))
    for one, late in zip(scans[15:], scans[12:], strict=False):
        added = late._replace(
            position=late.position[:1] + 0.5,
            covariance=late.covariance[:1],
            number=late.number[:1] + 900,
        )
        (whole, a), (half, b) = tracker.step(whole, one, [added]), tracker.step(half, one, [added])
        assert a == b
        assert a.counts["replayed"] > 0
        same(tracker.estimates(whole), tracker.estimates(half))
        same(tracker.estimates(whole, 4), tracker.estimates(half, 4))
    assert tracker.encode(whole) == tracker.encode(half)


@pytest.mark.parametrize("damage", ["cut", "flip", "other", "empty"])
def test_other_bytes_are_refused(damage):
    tracker = Bernoulli(scene())
    data = tracker.encode(run(tracker, walk(np.random.default_rng(0), 3, 5)[0]))
    broken = {
        "cut": data[: len(data) // 2],
        "flip": data[:-2000] + bytes([data[-2000] ^ 255]) + data[-1999:],
        "other": b"something else",
        "empty": b"",
    }[damage]
    with pytest.raises(StateError):
        tracker.decode(broken)


def test_a_state_of_other_maps_is_refused():
    plain = Bernoulli(scene())
    mapped = Bernoulli(scene(birth_map=Raster(REGION, np.ones((4, 4)))))
    with pytest.raises(StateError, match="other maps"):
        mapped.decode(plain.encode(run(plain, [scan(0, [[1.0, 2.0]])])))


def test_late_reports_in_the_window_are_as_good_as_timely_ones():
    rng = np.random.default_rng(7)
    scans, _ = walk(rng, 6, 30, side=40.0)
    told = scene(Region(0.0, 0.0, 40.0, 40.0), p=(0.73, 0.73, 0.73))
    tracker = Bernoulli(told)
    timely, delayed, waiting = tracker.initial(), tracker.initial(), []
    for k, one in enumerate(scans):
        late = rng.random(len(one.number)) < 0.4
        due = [part for when, part in waiting if when == k]
        waiting = [(when, part) for when, part in waiting if when > k]
        held = ReportScan(one.t_s, one.position[late], one.covariance[late], one.number[late])
        if k + 3 < len(scans):
            waiting.append((k + 3, held))
            now = ReportScan(one.t_s, one.position[~late], one.covariance[~late], one.number[~late])
        else:
            now = one
        delayed, _ = tracker.step(delayed, now, due)
        timely, _ = tracker.step(timely, one)
    assert not waiting or all(when >= len(scans) for when, _ in waiting)
    due = [part for when, part in waiting]
    delayed, _ = tracker.step(delayed, scan(30, [[1.0, 1.0]]), due)
    timely, _ = tracker.step(timely, scan(30, [[1.0, 1.0]]))
    same(tracker.estimates(delayed), tracker.estimates(timely), identities=False)


def test_faults_of_a_scene_are_all_named():
    bad = Scene(
        Reporting(
            Region(0.0, 0.0, 0.0, 1.0), sigma_m=-1.0, p_detection=(1.5,), false_per_scan=-2.0
        ),
        Targets(lifetime_s=0.0),
    )
    with pytest.raises(ConfigurationError) as caught:
        Bernoulli(bad, BernoulliSettings(recent_scans=9))
    for name in (
        "region",
        "sigma_m",
        "p_detection",
        "false_per_scan",
        "lifetime_s",
        "recent_scans",
    ):
        assert any(problem.startswith(name) for problem in caught.value.problems)


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (scan(1, [])._replace(t_s=math.nan), "finite time"),
        (scan(1, [[math.inf, 0.0]]), "finite positions"),
        (scan(1, [[1.0, 0.0]], [-1]), "numbers"),
        (scan(1, [[1.0, 0.0]])._replace(covariance=np.array([[1.0, 2.0, 1.0]])), "definite"),
        (scan(1, [[1.0, 0.0]])._replace(covariance=np.zeros((2, 3))), "expected, found"),
        (scan(-1, []), "order of time"),
    ],
)
def test_scans_that_cannot_be_are_refused(broken, said):
    tracker = Bernoulli(scene())
    state = run(tracker, [scan(0, [[1.0, 2.0]])])
    with pytest.raises(InputError, match=said):
        tracker.step(state, broken)


def test_reports_outside_and_twice_are_counted_and_left_out():
    tracker = Bernoulli(scene())
    good = scan(0, [[50.0, 50.0], [20.0, 30.0]])
    spoilt = scan(0, [[50.0, 50.0], [20.0, 30.0], [50.0, 50.0], [500.0, 0.0]])
    clean, _ = tracker.step(tracker.initial(), good)
    state, info = tracker.step(tracker.initial(), spoilt)
    assert (info.counts["outside"], info.counts["duplicate"]) == (1, 1)
    same(tracker.estimates(state), tracker.estimates(clean))
    _, info = tracker.step(state, scan(1, []), [scan(0, [[20.0, 30.0]], [77])])
    assert (info.counts["duplicate"], info.counts["late"]) == (1, 0)
    _, info = tracker.step(state, scan(1, []), [scan(-7, [[20.0, 30.0]], [78])])
    assert info.counts["late"] == 1
