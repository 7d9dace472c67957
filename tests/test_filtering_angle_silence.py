"""The tracker of angles on thresholds, in space, and told how targets move."""

import numpy as np

from angle_runs import CORNERS, run, scans, site_of, straight
from trackfield.filtering import angle_readings, angle_tracker
from trackfield.filtering.scans import Scan
from trackfield.network.site import Target
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.motion_rate import MotionRateModel

DT = 0.1
THRESHOLD = 0.12
RING = np.vstack([CORNERS, [[0.0, 1.8], [0.0, -1.8]]])


def spoken(scan):
    loud = np.abs(scan.value) >= THRESHOLD
    return Scan(scan.t_s, *(column[loud] for column in scan[1:]))


def test_sensors_that_are_silent_count_and_those_that_break_are_found_out():
    model = AngularRateModel(0.01, threshold_rad_s=THRESHOLD)
    site = site_of([model] * 6, RING)
    tracker = angle_tracker.create(site)
    path = straight(80, DT)
    every = list(scans(site, path, DT, np.random.default_rng(1)))
    broken = [
        scan if k < 20 else Scan(scan.t_s, *(column[scan.sensor != 4] for column in scan[1:]))
        for k, scan in enumerate(every)
    ]
    states = run(tracker, [spoken(scan) for scan in broken])
    assert tracker.pack(tracker.unpack(tracker.pack(states[-1]))) == tracker.pack(states[-1])
    assert states[19].alive[4] > 0.9
    assert states[-1].alive[4] < 0.1  # it kept silent of a target that went past it
    shown = tracker.shown(states[-1], states[-1].track.t_s)
    assert np.hypot(*(shown.position[:2] - path[-1, :2])) < 0.1


def test_sensors_without_a_threshold_are_never_silent():
    tracker = angle_tracker.create(site_of([AngularRateModel()] * 6, RING))
    states = run(
        tracker,
        scans(
            site_of([AngularRateModel()] * 6, RING), straight(9, DT), DT, np.random.default_rng(2)
        ),
    )
    assert all(state.alive == () for state in states)


def test_motion_sensors_track_in_space():
    places = np.array(
        [[0, 0, 0], [6, 0, 4], [6, 6, 0], [0, 6, 4], [3, 0, 2], [3, 6, 2], [0, 3, 0], [6, 3, 4.0]]
    )
    site = site_of([MotionRateModel(1.0, 0.01)] * 8, places, Target(dimensions=3))
    sensors = angle_readings.of_site(site)
    tracker, rng = angle_tracker.create(site), np.random.default_rng(3)
    rows, untold = np.arange(8, dtype=np.int32), np.full(8, np.nan)
    state = tracker.start()
    for k in range(50):
        truth = np.array([1.0 + 0.06 * k, 2.0 + 0.03 * k, 1.0 + 0.02 * k, 0.6, 0.3, 0.2])
        z = angle_readings.expected(sensors, truth) + 0.01 * rng.standard_normal(8)
        state = tracker.step(state, Scan(DT * k, rows, np.abs(z), untold))
    shown = tracker.shown(state, state.track.t_s)
    assert np.linalg.norm(shown.position - truth[:3]) < 0.2
    assert np.linalg.norm(shown.velocity - truth[3:]) < 0.2


def test_targets_that_are_told_to_go_straight_have_one_way_to_move():
    told = Target(motion="cv", accel_sigma_m_s2=0.02)
    site = site_of([AngularRateModel()] * 4, CORNERS, told)
    path = straight(60, DT)
    tracker = angle_tracker.create(site)
    states = run(tracker, scans(site, path, DT, np.random.default_rng(4)))
    assert states[-1].track.modes.weights.shape == (1, 1)
    shown = tracker.shown(states[-1], states[-1].track.t_s)
    assert np.hypot(*(shown.position[:2] - path[-1, :2])) < 0.08
