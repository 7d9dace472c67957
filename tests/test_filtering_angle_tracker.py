"""The tracker of bearings, rates and motion: starts, follows, says when it does not know."""

import itertools

import numpy as np
import pytest

from angle_runs import CORNERS, round_trip, run, scans, site_of, straight
from trackfield.errors import ConfigurationError, InputError, StateError
from trackfield.filtering import angle_tracker
from trackfield.filtering.scans import Scan
from trackfield.network.site import Target
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel
from trackfield.types import Status

DT = 0.1
KINDS = {
    "bearing": [BearingModel(0.02)] * 4,
    "angular_rate": [AngularRateModel(0.01)] * 4,
    "motion": [MotionRateModel(1.0, 0.01)] * 4,
    "mixed": [BearingModel(0.02), AngularRateModel(0.01), MotionRateModel(), AngularRateModel()],
}


def followed(models, path, seed, **how):
    site = site_of(models, CORNERS)
    tracker = angle_tracker.create(site)
    states = run(tracker, scans(site, path, DT, np.random.default_rng(seed), **how))
    shown = [tracker.shown(s, s.recent[-1].t_s) for s in states]
    return tracker, states, shown


def errors(shown, path):
    """Errors of the rows that are shown for sure [m]."""
    return np.array(
        [
            np.hypot(*(one.position[:2] - x[:2]))
            for one, x in zip(shown, path, strict=True)
            if one is not None and one.status == Status.CONFIRMED
        ]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_target_that_goes_straight_is_found_and_followed(kind):
    path = straight(80, DT)
    _, states, shown = followed(KINDS[kind], path, 11)
    e = errors(shown, path)
    assert e.size > 50
    assert np.sqrt((e[-30:] ** 2).mean()) < 0.06
    assert states[-1].number == 1


@pytest.mark.parametrize("kind", ["bearing", "angular_rate"])
def test_a_target_that_turns_is_followed(kind):
    path = round_trip(100, DT)
    _, _, shown = followed(KINDS[kind], path, 12)
    e = errors(shown, path)
    assert e.size > 60
    assert np.sqrt((e**2).mean()) < 0.25


def test_readings_one_by_one_are_enough():
    path = straight(240, DT / 3, velocity=(0.6, 0.0))
    site = site_of(KINDS["angular_rate"], CORNERS)
    tracker = angle_tracker.create(site)
    states = run(tracker, scans(site, path, DT / 3, np.random.default_rng(3), each=1))
    shown = [tracker.shown(s, s.recent[-1].t_s) for s in states]
    assert np.sqrt((errors(shown, path)[-60:] ** 2).mean()) < 0.1


def test_outliers_do_not_matter_much():
    path = straight(80, DT)
    _, _, clean = followed(KINDS["bearing"], path, 21)
    _, _, dirty = followed(KINDS["bearing"], path, 21, outliers=0.05)
    rms = [np.sqrt((errors(shown, path)[-50:] ** 2).mean()) for shown in (clean, dirty)]
    assert rms[1] < 1.6 * rms[0]


def test_the_lagged_estimate_is_better_and_repeats_the_live_one_at_the_end():
    path = straight(80, DT)
    tracker, states, shown = followed(KINDS["bearing"], path, 31)
    lag = 15
    live, late = [], []
    for k in range(20, 80 - lag):
        hindsight = tracker.hindsight(states[k : k + lag + 1])
        late.append(hindsight.position[:2] - path[k, :2])
        live.append(shown[k].position[:2] - path[k, :2])
        assert hindsight.t_s == shown[k].t_s
    assert np.square(late).sum() < 0.5 * np.square(live).sum()
    alone = tracker.hindsight(states[-1:])
    np.testing.assert_allclose(alone.position, shown[-1].position)
    np.testing.assert_allclose(alone.covariance, shown[-1].covariance)
    assert tracker.hindsight(states[:1]) is None


def test_a_target_that_jumps_is_found_again_as_another_track():
    one, two = straight(60, DT), straight(60, DT, start=(2.0, -1.0), velocity=(-0.5, 0.1))
    path = np.vstack([one, two])
    _, states, shown = followed(KINDS["bearing"], path, 41)
    assert states[59].number == 1
    assert states[-1].number >= 1
    assert np.hypot(*(shown[-1].position[:2] - path[-1, :2])) < 0.1


def test_a_target_that_does_not_move_is_told_by_bearings_only():
    path = straight(40, DT, velocity=(0.0, 0.0))
    _, _, shown = followed(KINDS["bearing"], path, 51)
    assert np.hypot(*(shown[-1].position[:2] - path[-1, :2])) < 0.1
    for kind in ("angular_rate", "motion"):  # nothing turns: nothing is known
        site = site_of(KINDS[kind], CORNERS)
        tracker = angle_tracker.create(site)
        rows = np.arange(4, dtype=np.int32)
        silent = [Scan(DT * k, rows, np.zeros(4), np.full(4, np.nan)) for k in range(40)]
        assert all(state.track is None for state in run(tracker, silent))


@pytest.mark.parametrize("kind", ["angular_rate", "motion"])
@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_motion(kind, seed):
    places = [(0, 0), (20, 0), (20, 15), (0, 15), (10, -3)]
    site = site_of([KINDS[kind][0]] * 5, places)
    path = np.tile([7.0, 6.0, 0.0, 0.0], (40, 1))
    readings = scans(site, path, 0.5, np.random.default_rng(seed))
    if kind == "motion":
        readings = (scan._replace(value=np.abs(scan.value)) for scan in readings)
    tracks = [state.track for state in run(angle_tracker.create(site), readings)]
    assert not any(track is not None and track.confirmed for track in tracks)


def test_mirror_images_about_a_line_of_motion_sensors_stay_tentative():
    places = np.array([[-3.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    site = site_of(KINDS["motion"], places)
    tracker = angle_tracker.create(site)
    path = straight(60, DT, start=(-2.0, 1.0))
    states = run(tracker, scans(site, path, DT, np.random.default_rng(61)))
    shown = [tracker.shown(s, s.recent[-1].t_s) for s in states]
    assert all(one is None or one.status == Status.TENTATIVE for one in shown)
    track = states[-1].track
    mirrored = track.modes.beliefs.mean[:, 0, 1]
    assert len(track.names) == 2
    assert mirrored[0] == pytest.approx(-mirrored[1], abs=0.05)
    assert shown[-1].covariance[2] > 0.5  # of both together


def test_coasting_and_the_end():
    path = straight(60, DT)
    tracker, states, shown = followed(KINDS["bearing"], path, 71)
    last = states[-1]
    later = tracker.shown(last, last.track.t_s + 1.0)
    assert later.status == Status.COASTING
    assert np.isnan(later.nis)
    assert later.covariance[0] > shown[-1].covariance[0]
    moved = later.position[:2] - shown[-1].position[:2]
    np.testing.assert_allclose(moved, shown[-1].velocity[:2], atol=0.05)
    assert tracker.shown(last, last.track.t_s + 301.0).status == Status.ENDED
    rows = np.arange(4, dtype=np.int32)
    after = tracker.step(last, Scan(1e3, rows, np.zeros(4), np.full(4, np.nan)))
    assert after.track is None
    assert after.number == last.number == 1


def test_states_come_back_from_their_bytes_and_go_on_the_same():
    site = site_of(KINDS["mixed"], CORNERS)
    tracker = angle_tracker.create(site)
    state = other = tracker.start()
    for scan in itertools.islice(scans(site, straight(40, DT), DT, np.random.default_rng(81)), 40):
        state = tracker.step(state, scan)
        other = tracker.step(tracker.unpack(tracker.pack(other)), scan)
        assert tracker.pack(state) == tracker.pack(other)
    for damaged in (b"", b"TFANGLE1{", b"TFANGLE1{}", tracker.pack(state)[:-9], b"x" * 40):
        with pytest.raises(StateError):
            tracker.unpack(damaged)


def test_bad_input_is_refused():
    site = site_of(KINDS["bearing"], CORNERS)
    tracker = angle_tracker.create(site)
    rows, none = np.arange(4, dtype=np.int32), np.full(4, np.nan)
    state = tracker.step(tracker.start(), Scan(1.0, rows, np.zeros(4), none))
    for scan, word in (
        (Scan(0.5, rows, np.zeros(4), none), "after one at 1.0"),
        (Scan(np.nan, rows, np.zeros(4), none), "found a scan at nan"),
        (Scan(2.0, rows + 1, np.zeros(4), none), "expected 0 to 3"),
        (Scan(2.0, rows, np.full(4, np.inf), none), "finite"),
        (Scan(2.0, rows, np.zeros(4), np.zeros(4)), "finite"),
    ):
        with pytest.raises(InputError, match=word):
            tracker.step(state, scan)
    empty = Scan(2.0, rows[:0], none[:0], none[:0])
    assert tracker.step(state, empty).track is None


def test_sites_that_cannot_work_are_refused():
    with pytest.raises(ConfigurationError, match="one place"):
        angle_tracker.create(site_of(KINDS["bearing"], np.ones((4, 2))))
    with pytest.raises(ConfigurationError, match="tell no height"):
        angle_tracker.create(
            site_of(
                KINDS["bearing"], np.random.default_rng(0).normal(size=(4, 3)), Target(dimensions=3)
            )
        )
    with pytest.raises(ConfigurationError, match="'range'"):
        angle_tracker.create(site_of([RangeModel()] * 4, CORNERS))
