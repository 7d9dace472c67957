"""What the tracker of angles does not know, it does not claim: rest, lines of sensors, rivals."""

import numpy as np
import pytest

from angle_runs import CORNERS, run, scans, site_of, straight
from trackfield.filtering import angle_hypotheses, angle_rivals, angle_tracker
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.types import Gaussian, Status

HALL = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 15.0], [0.0, 15.0], [10.0, -3.0]])
LINE = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]])
RATE, MOTION = AngularRateModel(0.01), MotionRateModel(1.0, 0.01)
FAR = 30.0  # squared sigmas of a confident wrong answer


def misses(site, path, dt_s, seed):
    """Squared sigmas of the errors of the rows that are confirmed, and the last state."""
    tracker = angle_tracker.create(site)
    states = run(tracker, scans(site, path, dt_s, np.random.default_rng(seed)))
    out = []
    for state, truth in zip(states, path, strict=True):
        row = tracker.shown(state, state.recent[-1].t_s)
        if row is not None and row.status == Status.CONFIRMED:
            xx, xy, yy = row.covariance
            apart = row.position[:2] - truth[:2]
            out.append(apart @ np.linalg.solve([[xx, xy], [xy, yy]], apart))
    return np.array(out), states[-1]


def bent(steps, dt_s, phase):
    t = dt_s * np.arange(steps)
    place = np.column_stack([4.0 + 0.6 * t, 5.0 + 2.0 * np.sin(t / 6.0 + phase)])
    return np.column_stack([place, np.gradient(place, dt_s, axis=0)])


@pytest.mark.parametrize("model", [RATE, MOTION], ids=["rate", "motion"])
@pytest.mark.parametrize("dt_s", [0.25, 1.0])
def test_noise_of_a_target_at_rest_starts_nothing(model, dt_s):
    path = straight(36, dt_s, start=(7.0, 6.0), velocity=(0.0, 0.0))
    for seed in range(3):
        _, last = misses(site_of([model] * 5, HALL), path, dt_s, seed)
        assert last.track is None


def test_bearings_among_them_tell_a_target_at_rest():
    models = [BearingModel(0.01), BearingModel(0.01), RATE, RATE, RATE]
    path = straight(36, 0.25, start=(7.0, 6.0), velocity=(0.0, 0.0))
    far, last = misses(site_of(models, HALL), path, 0.25, 1)
    assert far.size > 20
    assert np.median(far) < 6.0
    assert np.hypot(*(last.track.whole.mean[0, :2] - [7.0, 6.0])) < 0.3


def test_a_target_that_stops_stays_where_it_stopped():
    dt_s = 0.25
    t = dt_s * np.arange(100)
    along = np.minimum(t, 10.0)
    place = np.column_stack([5.0 + 0.8 * along, 6.0 + 0.2 * along])
    path = np.column_stack([place, np.gradient(place, dt_s, axis=0)])
    far, _ = misses(site_of([RATE] * 5, HALL), path, dt_s, 5)
    assert far.size > 60
    assert (far < FAR).all()
    assert (far < 6.0).mean() > 0.8


def test_motion_sensors_do_not_confirm_a_target_that_has_stopped():
    path = straight(60, 0.1, velocity=(0.8, 0.05))
    path[30:, :2], path[30:, 2:] = path[30, :2], 0.0
    tracker = angle_tracker.create(site_of([MOTION] * 4, CORNERS))
    states = run(
        tracker,
        scans(site_of([MOTION] * 4, CORNERS), path, 0.1, np.random.default_rng(4)),
    )
    assert any(state.track is not None and state.track.confirmed for state in states[:35])
    assert not any(state.track.confirmed for state in states[45:] if state.track)


def test_sensors_on_one_line_seldom_claim_what_is_not_so():
    far = [misses(site_of([RATE] * 3, LINE), bent(80, 0.25, p), 0.25, 7)[0] for p in (0.0, 2.0)]
    wrong = sum((one > FAR).sum() for one in far)
    assert wrong < 0.1 * 160


def rivals():
    mean = np.array([[0.0, 0.0, 1.0, 0.0], [4.0, 0.0, 1.0, 0.0], [0.1, 0.0, 1.0, 0.0]])
    beliefs = Gaussian(mean, np.tile(0.04 * np.eye(4), (3, 1, 1)))
    found = angle_hypotheses.fresh(beliefs, t_s=1.0, modes=2)
    return found._replace(evidence=np.zeros((3, 8)))


def held():
    belief = Gaussian(np.array([[0.0, 0.0, 1.0, 0.0]]), 0.04 * np.eye(4)[None])
    return angle_hypotheses.fresh(belief, t_s=1.0, modes=2)._replace(evidence=np.zeros((1, 6)))


def test_another_answer_that_explains_as_much_is_joined_and_the_same_answer_is_not():
    both = angle_rivals.joined(held(), rivals())
    assert both.names == (0, 1)
    np.testing.assert_allclose(both.whole.mean[:, 0], [0.0, 4.0])
    np.testing.assert_allclose(both.weights, [1.0 / 1.2, 0.2 / 1.2])
    assert both.evidence.shape == (2, 6)
    assert both.modes.beliefs.mean.shape == (2, 2, 4)


def test_rivals_are_weighed_by_the_last_scans_only():
    new = rivals()
    new.evidence[1, 4:] = -3.0
    assert angle_rivals.joined(held(), new).names == (0,)
    new.evidence[1] = [-3.0] * 4 + [0.25] * 4
    both = angle_rivals.joined(held(), new)
    np.testing.assert_allclose(both.weights[1] / both.weights[0], 0.2 * np.e)
