"""The hierarchy against one central tracker: as good, and sound when hand-overs fail or dawdle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.contract import ReportScan
from trackfield.association.model import Reporting, Scene, Targets
from trackfield.hierarchy.field import tracked_field
from trackfield.metrics.ospa import gospa
from trackfield.raster import Region

SIDE, STEPS = 100.0, 80
SCENE = Scene(
    Reporting(Region(0.0, 0.0, SIDE, SIDE), sigma_m=0.4, p_detection=(0.75,), false_per_scan=6.0),
    Targets(births_per_s=0.1),
)
QUARTERS = np.array([[25.0, 25.0], [75.0, 25.0], [25.0, 75.0], [75.0, 75.0]])


def crossing_world(seed, targets=10):
    """Targets that begin near the borders between the quarters, so that most of them cross one."""
    rng = np.random.default_rng(seed)
    place = 50.0 + rng.uniform(-25.0, 25.0, (targets, 2))
    angle, speed = rng.uniform(0, 2 * math.pi, targets), rng.uniform(0.5, 1.5, targets)
    velocity = speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    begin = rng.integers(0, 30, targets)
    truth, scans, number = [], [], 0
    for t in range(STEPS):
        there = (t >= begin) & (t < begin + 45)
        push = 0.15 * rng.standard_normal((targets, 2))
        place[there] += velocity[there] + push[there] / 2
        velocity[there] += push[there]
        there &= SCENE.reporting.region.contains(place)
        truth.append({int(i): place[i].copy() for i in np.flatnonzero(there)})
        seen = np.flatnonzero(there & (rng.random(targets) < 0.75))
        own = place[seen] + 0.4 * rng.standard_normal((seen.size, 2))
        every = np.vstack([own, rng.uniform(0.0, SIDE, (rng.poisson(6.0), 2))])
        every = every[rng.permutation(len(every))]
        numbers = np.arange(number, number + len(every), dtype=np.int32)
        number += len(every)
        scans.append(ReportScan(float(t), every, np.full((len(every), 3), np.nan), numbers))
    return truth, scans


def scored(truth, shown):
    """Mean GOSPA over the steps, and how often the name over a target changed."""
    distances, names, switches = [], {}, 0
    for there, (track, place) in zip(truth, shown, strict=True):
        targets = np.array(list(there.values())).reshape(-1, 2)
        distances.append(gospa(targets, place, cutoff_m=5.0, order=2.0)[0])
        for target, at in there.items():
            gaps = np.hypot(*(place - at).T)
            if gaps.size and gaps.min() < 3.0:
                name = int(track[gaps.argmin()])
                switches += names.get(target, name) != name
                names[target] = name
    return float(np.mean(distances)), switches


def visible(estimates):
    return estimates.track[estimates.shown], estimates.mean[estimates.shown, :2]


def run(tracker, scans):
    state, shown = tracker.initial(), []
    for scan in scans:
        state, _ = tracker.step(state, scan)
        shown.append(visible(tracker.estimates(state)))
    return shown


def run_over_bad_links(field, scans, *, p_lost, most_late, rng):
    """Drive groups and base by hand; hand-overs get lost, or come 1 to `most_late` steps later."""
    groups, base = field.groups, field.base
    states, fused = [group.initial() for group in groups], base.initial()
    under_way = {}
    shown = []
    for t, scan in enumerate(scans):
        reports = []
        for i, group in enumerate(groups):
            heard = base.regions[i].contains(scan.position)
            own = ReportScan(scan.t_s, *(column[heard] for column in scan[1:]))
            states[i], outcome = group.step(states[i], own, handed=under_way.pop((t, i), []))
            reports.append(outcome.report)
            for to, messages in outcome.handovers.items():
                for message in messages:
                    if rng.random() >= p_lost:
                        at = t + int(rng.integers(1, most_late + 1))
                        under_way.setdefault((at, to), []).append(message)
        fused, united = base.step(fused, scan.t_s, reports=reports)
        shown.append(visible(united))
    return shown


SEEDS = range(200, 206)


@pytest.fixture(scope="module")
def worlds():
    return [crossing_world(seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def central(worlds):
    return np.array([scored(truth, run(Bernoulli(SCENE), scans)) for truth, scans in worlds])


def test_four_groups_are_as_good_as_one(worlds, central):
    field = tracked_field(SCENE, QUARTERS, tracker=Bernoulli)
    ours = np.array([scored(truth, run(field, scans)) for truth, scans in worlds])
    assert ours[:, 0].mean() <= 1.02 * central[:, 0].mean()
    assert ours[:, 1].mean() <= central[:, 1].mean() + 1.0


def test_groups_need_not_be_told_births_that_one_tracker_learns(worlds):
    scene = replace(SCENE, targets=Targets())
    field = tracked_field(scene, QUARTERS, tracker=Bernoulli)
    ours, alone = (
        np.mean([scored(truth, run(tracker, scans))[0] for truth, scans in worlds])
        for tracker in (field, Bernoulli(scene))
    )
    assert ours <= 1.02 * alone


def test_lost_and_late_hand_overs_do_little_harm(worlds, central):
    rng = np.random.default_rng(7)
    field = tracked_field(SCENE, QUARTERS, tracker=Bernoulli)
    ours = np.array(
        [
            scored(truth, run_over_bad_links(field, scans, p_lost=0.4, most_late=6, rng=rng))
            for truth, scans in worlds
        ]
    )
    assert ours[:, 0].mean() <= 1.03 * central[:, 0].mean()
    assert ours[:, 1].mean() <= central[:, 1].mean() + 2.0


def test_without_any_hand_over_the_base_alone_unites_what_groups_see_together(worlds, central):
    rng = np.random.default_rng(8)
    field = tracked_field(SCENE, QUARTERS, tracker=Bernoulli)
    truth, scans = worlds[0]
    shown = run_over_bad_links(field, scans, p_lost=1.0, most_late=1, rng=rng)
    distance, switches = scored(truth, shown)
    assert distance <= 1.05 * central[0, 0]
    assert switches <= central[0, 1] + 6


def test_sharing_reports_at_the_borders_is_what_makes_them_equal(worlds, central):
    """A test that could not fail would pass here too: without a margin the borders cost."""
    field = tracked_field(SCENE, QUARTERS, tracker=Bernoulli, margin_m=0.0)
    ours = np.array([scored(truth, run(field, scans)) for truth, scans in worlds])
    assert ours[:, 0].mean() > 1.05 * central[:, 0].mean()
