"""How good tracks are where the truth is known: against the bound, and honest about it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from range_snapshot import opened
from range_twin import told
from trackfield.filtering import pcrb
from trackfield.localization import bounds
from trackfield.metrics.consistency import distances2
from trackfield.metrics.score import score
from trackfield.motion import ConstantVelocity
from trackfield.network.site import Site
from trackfield.pipeline.tagged import track
from trackfield.sensing.range import UNCALIBRATED, Nlos, RangeModel
from trackfield.simulation import roads, tagged

RUNS = 20
NAMES = tuple(str(i) for i in range(RUNS))
ACCEL_VARIANCE = 0.0175  # of the drive's steps, per axis [m^2/s^4]
SETTLED = 30  # steps after which the start is forgotten


def drives(seeds, draw):
    """Drives with RUNS tracks of readings on each."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        yield rng, draw(rng)


def matched(rng):
    return roads.matched(rng, accel_variance=(ACCEL_VARIANCE, ACCEL_VARIANCE))


def knowing(drive):
    """The road's site, and how targets move on it."""
    site = roads.site(drive)
    sigma = math.sqrt(ACCEL_VARIANCE * roads.DT_S)
    return replace(site, target=replace(site.target, motion="cv", accel_sigma_m_s2=sigma))


def steps_of(rows):
    return np.rint(rows.t_s / roads.DT_S).astype(int) - 1


@pytest.fixture(scope="module")
def followed():
    """Errors, bounds and squared Mahalanobis distances of matched drives."""
    error2, bound2, near, whole, nis = [], [], [], [], []
    for rng, drive in drives(range(8), matched):
        tracker, _, _ = told(knowing(drive), velocity_time=1e4)
        ranges = roads.ranges(rng, drive, runs=RUNS)
        readings = tagged.to_readings(drive.t_s, ranges, knowing(drive).sensor_ids, NAMES)
        rows = tracker.process(readings)
        k = steps_of(rows)
        error = rows.position[:, :2] - drive.truth[k, :2]
        information = pcrb.range_information(drive.sensors, drive.truth, models=roads.RANGES)
        motion = ConstantVelocity(ACCEL_VARIANCE * roads.DT_S)
        start = np.diag([0.1, 0.1, 2.25, 2.25])
        bound = pcrb.recursion(start, motion, dt_s=roads.DT_S, information=information)
        late = k >= SETTLED
        error2.append((error[late] ** 2).sum(1))
        bound2.append(np.trace(bound[k[late], :2, :2], axis1=1, axis2=2))
        near.append(distances2(error[late], rows.covariance[late]))
        nis.append(rows.nis[late])
        tracker.finish()
        for target in opened(tracker._bank.snapshot()).targets:
            off = target.belief.mean - drive.truth[-1]
            whole.append(off @ np.linalg.solve(target.belief.covariance, off))
        assert tracker.counts["started"] == RUNS
    return [np.concatenate(x) for x in (error2, bound2, near, nis)] + [np.array(whole)]


def test_where_the_model_is_right_the_bound_is_reached(followed):
    error2, bound2, *_ = followed
    assert 0.94 < math.sqrt(error2.mean() / bound2.mean()) <= 1.04


def test_where_the_model_is_right_covariances_are_right(followed):
    _, _, near, nis, whole = followed
    assert near.mean() == pytest.approx(2.0, abs=0.25)
    assert whole.mean() == pytest.approx(4.0, abs=0.6)  # four states at the end of 160 runs
    assert nis.mean() == pytest.approx(1.0, abs=0.05)


def test_first_rows_are_near_and_honest():
    """Without any prior: the start is as good as its readings, and knows how good that is."""
    relative, near = [], []
    for rng, drive in drives(range(20, 26), matched):
        site = knowing(drive)
        first = roads.ranges(rng, drive, runs=RUNS)[:, :12]
        readings = tagged.to_readings(drive.t_s[:12], first, site.sensor_ids, NAMES)
        rows = track(site, readings).tracks
        k = steps_of(rows)
        keep = [np.flatnonzero(rows.target == i)[0] for i in np.unique(rows.target)]
        error = rows.position[keep, :2] - drive.truth[k[keep], :2]
        least = bounds.range_bound(
            drive.sensors, drive.truth[k[keep], :2], models=roads.RANGES
        ).covariance
        relative.append((error**2).sum(1) / np.trace(least, axis1=1, axis2=2))
        near.append(distances2(error, rows.covariance[keep]))
    assert math.sqrt(np.median(np.concatenate(relative))) < 1.2
    assert np.mean(np.concatenate(near) < 5.99) > 0.85
    assert np.concatenate(near).mean() < 4.0


@pytest.mark.parametrize(("nlos", "most"), [(None, 0.029), (Nlos(), 0.034)], ids=("clear", "nlos"))
def test_blocked_ranges_on_the_road_cost_little(nlos, most):
    """RMSE per axis, from the first row on; nothing is told of the motion."""
    error2 = []
    for end in ("C", "D"):
        for rng, drive in drives((1, 2), lambda rng, end=end: roads.follow_road(rng, end)):
            site = roads.site(drive)
            ranges = roads.ranges(rng, drive, runs=RUNS, nlos=nlos)
            rows = track(site, tagged.to_readings(drive.t_s, ranges, site.sensor_ids, NAMES)).tracks
            error = rows.position[:, :2] - drive.truth[steps_of(rows), :2]
            error2.append((error**2).ravel())
    assert math.sqrt(np.concatenate(error2).mean()) <= most


def circle(count, model):
    turn = 2 * math.pi * np.arange(count) / count
    reach = 20.0 * np.where(np.arange(count) % 2, 1.3, 1.0)
    flat = np.column_stack([reach * np.cos(turn), reach * np.sin(turn), np.full(count, np.nan)])
    return Site("circle", tuple(f"s{i}" for i in range(count)), flat, (model,) * count)


@pytest.mark.parametrize(("sensors", "least"), [(6, 0.90), (12, 0.90), (20, 0.80)])
def test_correlated_errors_and_open_calibration_stay_honest(sensors, least):
    """More sensors than can be followed one by one are believed less, not more."""
    rng = np.random.default_rng(sensors)
    believed = replace(UNCALIBRATED, placement_sigma_m=0.0)
    site = circle(sensors, believed)
    biases = 0.1 + 0.04 * rng.standard_normal(sensors)
    real = tuple(replace(believed, bias_m=float(b), scale=0.01) for b in biases)
    world = tagged.World(targets=6, steps=300)
    readings, truth = tagged.wander(rng, replace(site, models=real), world)
    found = score(truth, track(site, readings).tracks)
    assert found.inside_95 > least
    assert found.rmse_m < 0.2
    assert found.nis is not None
    assert 0.6 < found.nis < 1.5


def test_noise_is_learned():
    """A sensor five times as noisy as its model is found out, and does little harm."""
    rng = np.random.default_rng(8)
    model = RangeModel(sigma_m=0.1, learn_noise=True)
    site = circle(8, model)
    real = (replace(model, sigma_m=0.5), *(model,) * 7)
    readings, truth = tagged.wander(
        rng, replace(site, models=real), tagged.World(targets=4, steps=400)
    )
    known = tuple(replace(m, learn_noise=False) for m in real)
    learned = score(truth, track(site, readings).tracks)
    exact = score(truth, track(replace(site, models=known), readings).tracks)
    assert learned.rmse_m < 1.15 * exact.rmse_m
    assert learned.inside_95 > 0.9
    tracker, _, _ = told(site)
    tracker.process(readings)
    belief = opened(tracker._bank.snapshot()).targets[0].belief
    ratio = {s.sensor: s.power / s.weight for s in belief.slots if s.sensor >= 0}
    assert ratio[0] > 4 * max(ratio[i] for i in range(1, 8))
