"""A step of the tracker of angles: the compiled one against its twin, silence against SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import angle_twin
from angle_runs import CORNERS, site_of
from trackfield.filtering import angle_hypotheses, angle_readings, angle_step, interacting
from trackfield.filtering.angle_readings import Says
from trackfield.filtering.angle_step import AngleMotions, HeardAngles
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.types import Gaussian

MOTIONS = AngleMotions((0.01, 0.5), (10.0, 2.0))
ALONE = AngleMotions((0.0,), (1.0,))
MODELS = [
    BearingModel(0.05, bias_rad=0.1),
    AngularRateModel(0.02),
    MotionRateModel(1.0, 0.02),
    MotionRateModel(2.0, 0.02),
]


def sensors_of(models=MODELS, places=CORNERS):
    return angle_readings.of_site(site_of(models, places))


def track_of(rng, hypotheses, space=False):
    d = 3 if space else 2
    mean = np.concatenate(
        [rng.uniform(-2, 2, (hypotheses, d)), rng.uniform(-1, 1, (hypotheses, d))], axis=1
    )
    root = 0.1 * rng.standard_normal((hypotheses, 2 * d, 2 * d))
    covariance = root @ np.swapaxes(root, 1, 2) + 1e-3 * np.eye(2 * d)
    return angle_hypotheses.fresh(Gaussian(mean, covariance), t_s=0.0, modes=2)


def close(found, exact):
    for a, b in zip(found, exact, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), hypotheses=st.integers(1, 3), space=st.booleans())
def test_the_kernel_is_its_twin(seed, hypotheses, space):
    rng = np.random.default_rng(seed)
    sensors = sensors_of()
    sensors = sensors._replace(velocity=rng.normal(size=(4, 3)) * [0.1, 0.1, 0.1 * space])
    if not space:
        sensors = sensors._replace(velocity=np.zeros((4, 3)))
    track = track_of(rng, hypotheses, space)
    truth = track.whole.mean[0] + 0.1 * rng.standard_normal(track.whole.mean.shape[1])
    value = angle_readings.expected(sensors, truth) + sensors.sigma * rng.standard_normal(4)
    value[rng.integers(4)] += rng.choice([0.0, 0.0, 1.0])
    found, silence = angle_step.advance(
        track, angle_step.spoken(sensors, value), t_s=0.2, motions=MOTIONS
    )
    modes, log_likelihood, prior = angle_twin.advance(
        track.modes, sensors, value, dt_s=0.2, motions=MOTIONS
    )
    close(found.prior, prior)
    close(found.modes.beliefs, modes.beliefs)
    np.testing.assert_allclose(found.modes.weights, modes.weights, rtol=1e-5, atol=1e-9)
    close(found.whole, interacting.combined(modes))
    weights = np.exp(log_likelihood - log_likelihood.max())
    np.testing.assert_allclose(found.weights, weights / weights.sum(), rtol=1e-5, atol=1e-9)
    assert (silence == 1.0).all()


def test_the_squared_innovation_is_that_of_a_dense_gaussian():
    sensors = sensors_of([AngularRateModel(0.02)] * 4)
    track = track_of(np.random.default_rng(4), 1)
    value = np.array([0.1, -0.2, 0.3, 0.0])
    found, _ = angle_step.advance(
        track, angle_step.spoken(sensors, value), t_s=0.1, motions=MOTIONS
    )
    mean, P = found.prior.mean[0], found.prior.covariance[0]
    H = angle_readings.slopes(sensors, mean)
    e = value - angle_readings.expected(sensors, mean)
    S = H @ P @ H.T + np.diag(sensors.sigma**2)
    assert found.nis == pytest.approx(e @ np.linalg.solve(S, e) / 4)


@pytest.mark.parametrize("alive", [1.0, 0.6])
@pytest.mark.parametrize("start", [(0.3, 0.2, 0.5, 0.1), (1.0, -1.0, 0.7, -0.2)])
def test_silence_leaves_the_moments_of_the_truncated_prediction(alive, start):
    sensors = sensors_of([AngularRateModel(0.02, threshold_rad_s=0.2)], CORNERS[:1])
    belief = Gaussian(np.array([start]), 0.01 * np.eye(4)[None])
    track = angle_hypotheses.fresh(belief, t_s=0.0, modes=1)
    heard = HeardAngles(sensors, np.zeros(1), np.array([alive]))
    found, silence = angle_step.advance(track, heard, t_s=0.0, motions=ALONE)

    mean, P = belief.mean[0], belief.covariance[0]
    h = angle_readings.expected(sensors, mean)[0]
    H = angle_readings.slopes(sensors, mean)[0]
    S = H @ P @ H + 0.02**2
    s = math.sqrt(S)
    inside = stats.truncnorm((-0.2 - h) / s, (0.2 - h) / s, loc=h, scale=s)
    chance = stats.norm(h, s).cdf(0.2) - stats.norm(h, s).cdf(-0.2)
    w = alive * chance / (alive * chance + 1 - alive)
    m = w * inside.mean() + (1 - w) * h
    second = w * (inside.var() + inside.mean() ** 2) + (1 - w) * (S + h**2)
    v = second - m**2
    K = P @ H / S
    assert silence[0] == pytest.approx(chance)
    # One linearization: the iterated update moves it a little, for what is curved.
    np.testing.assert_allclose(found.whole.mean[0], mean + K * (m - h), atol=0.01)
    np.testing.assert_allclose(found.whole.covariance[0], P - np.outer(K, K) * (S - v), atol=0.004)


def test_silence_far_from_the_sensor_or_of_a_broken_one_says_nothing():
    far = sensors_of([AngularRateModel(0.02, 1.0, 0.2)], CORNERS[:1])
    near = sensors_of([AngularRateModel(0.02, 9.0, 0.2)], CORNERS[:1])
    track = angle_hypotheses.fresh(
        Gaussian(np.array([[1.5, 0.5, 1.0, 0.0]]), 0.04 * np.eye(4)[None]), t_s=0.0, modes=1
    )
    for sensors, alive, told in ((far, 1.0, False), (near, 0.0, False), (near, 1.0, True)):
        heard = HeardAngles(sensors, np.zeros(1), np.array([alive]))
        found, _ = angle_step.advance(track, heard, t_s=0.0, motions=ALONE)
        same = np.allclose(found.whole.covariance, track.whole.covariance)
        assert same != told


def test_silence_counts_in_the_likelihood():
    sensors = sensors_of([AngularRateModel(0.02, threshold_rad_s=0.2)], CORNERS[:1])
    slow, fast = [0.3, 0.2, 0.1, 0.0], [2.6, 1.2, 1.5, -1.5]
    belief = Gaussian(np.array([slow, fast]), np.tile(1e-4 * np.eye(4), (2, 1, 1)))
    track = angle_hypotheses.fresh(belief, t_s=0.0, modes=1)
    heard = HeardAngles(sensors, np.zeros(1), np.array([0.9]))
    found, _ = angle_step.advance(track, heard, t_s=0.0, motions=ALONE)
    assert found.weights == pytest.approx([1.0 / 1.1, 0.1 / 1.1], rel=1e-6)  # 1 to 1 - .9


def test_without_readings_the_track_is_carried_on():
    sensors = angle_readings.chosen(sensors_of(), ())
    track = track_of(np.random.default_rng(5), 2)
    heard = angle_step.spoken(sensors, np.empty(0))
    found, silence = angle_step.advance(track, heard, t_s=1.0, motions=MOTIONS)
    close(found.whole, found.prior)
    assert silence.size == 0
    assert math.isnan(found.nis)
    assert found.misfits == ()
    np.testing.assert_allclose(found.weights, track.weights)
    step = track.whole.mean[:, 2:]
    np.testing.assert_allclose(found.whole.mean[:, :2], track.whole.mean[:, :2] + step)


def test_a_sensor_that_moves_tracks_as_well_as_one_that_stands():
    rng = np.random.default_rng(6)
    sensors = sensors_of([AngularRateModel(0.01)] * 4)
    truth = np.array([0.5, 0.2, 0.4, -0.1])
    belief = Gaussian(truth[None] + 0.05, 0.01 * np.eye(4)[None])
    track = angle_hypotheses.fresh(belief, t_s=0.0, modes=1)
    own = np.tile([0.3, 0.0, 0.0], (4, 1))
    for k in range(1, 60):
        state = truth + 0.05 * k * np.array([*truth[2:], 0.0, 0.0])
        now = sensors._replace(place=sensors.place + 0.05 * k * own, velocity=own)
        z = angle_readings.expected(now, state) + 0.01 * rng.standard_normal(4)
        heard = angle_step.spoken(now, z)
        track = angle_step.advance(track, heard, t_s=0.05 * k, motions=ALONE).track
    e = track.whole.mean[0] - state
    assert np.hypot(*e[:2]) < 0.08
    assert e @ np.linalg.solve(track.whole.covariance[0], e) < 13.3  # 99 % of chi-square, 4


def test_motion_takes_the_sign_that_the_other_readings_give_it_after_a_turn_back():
    around = [(-3, -4), (2, -4), (7, -4), (7, 0), (7, 4), (2, 4), (-3, 4), (-3, 0), (-1, -5)]
    models = [BearingModel(0.05), AngularRateModel(0.02), MotionRateModel(sigma=0.02)] * 3
    sensors = sensors_of(models, around)
    start = Gaussian(np.array([[1.0, 0.0, 1.0, 0.0]]), np.diag([2e-3, 2e-3, 3e-3, 3e-3])[None])
    track = angle_hypotheses.fresh(start, t_s=0.0, modes=2)
    motions = AngleMotions((0.0003, 0.5), (10.0, 2.0))
    for k in range(1, 13):
        truth = np.array([1.0 - 0.25 * k, 0.0, -1.0, 0.0])
        value = angle_readings.expected(sensors, truth)
        value = np.where(sensors.says == Says.MOTION, np.abs(value), value)
        heard = angle_step.spoken(sensors, value)
        track = angle_step.advance(track, heard, t_s=0.25 * k, motions=motions).track
        assert np.linalg.norm(track.whole.mean[0, :2] - truth[:2]) < 0.5
