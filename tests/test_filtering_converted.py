import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.filtering import converted, extended, kalman
from trackfield.filtering.converted import Mode
from trackfield.localization import range_mle
from trackfield.localization.range_likelihood import RangeScan
from trackfield.motion import SteppedAcceleration
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

MODEL = RangeModel(bias_m=-0.0386, scale=0.0174, sigma_m=0.00893, sigma_scale=0.01708)
SENSORS = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])


def scans(seed, runs=1, noise=1.0):
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0.3, 1.7, (runs, 2))
    r = np.linalg.norm(truth[:, None] - SENSORS, axis=-1)
    sigma = np.hypot(MODEL.sigma_m, MODEL.sigma_scale * r)
    z = 1.0174 * r - 0.0386 + noise * sigma * rng.standard_normal(r.shape)
    root = 0.05 * rng.standard_normal((runs, 4, 4))
    P = root @ np.swapaxes(root, 1, 2) + 0.001 * np.eye(4)
    mean = np.hstack([truth, np.zeros((runs, 2))]) + 0.03 * rng.standard_normal((runs, 4))
    return truth, z, Gaussian(mean, P)


@given(seed=st.integers(0, 2**32 - 1))
def test_an_extended_update_is_one_gauss_newton_step_of_prelocalization(seed):
    """What the paper's comparison rests on: the two filters differ in later steps only."""
    _, z, prior = scans(seed, runs=3)
    once = converted.gauss_newton_step(RangeScan(SENSORS, z, MODEL), prior.mean[:, :2])
    by_position = converted.update(prior, once).posterior
    variance = MODEL.sigma_m**2 + MODEL.sigma_scale**2 * z**2
    sensor = extended.Ranges(SENSORS, MODEL)
    by_ranges = extended.update(prior, z, sensor, variance=variance).posterior
    assert once.ok.all()
    np.testing.assert_allclose(by_position.mean, by_ranges.mean, atol=1e-12)
    np.testing.assert_allclose(by_position.covariance, by_ranges.covariance, atol=1e-12)


def test_paper_mode_is_newton_to_the_minimum_with_its_inverse_hessian():
    _, z, prior = scans(1, runs=5)
    scan = RangeScan(SENSORS, z, MODEL)
    found = converted.prelocalize(scan, prior.mean[:, :2], mode=Mode.PAPER)
    assert found.ok.all()
    for i in range(5):
        one = range_mle.newton(scan._replace(ranges=z[i]), prior.mean[i, :2])
        assert one.determined
        np.testing.assert_allclose(found.position[i], one.position, atol=1e-9)
        np.testing.assert_allclose(found.covariance[i], one.covariance, rtol=1e-7)


def test_fisher_mode_is_the_localizer():
    _, z, prior = scans(2, runs=4)
    scan = RangeScan(SENSORS, z, MODEL)
    found = converted.prelocalize(scan, prior.mean[:, :2], mode=Mode.FISHER)
    for i in range(4):
        one = range_mle.mle(scan._replace(ranges=z[i]), prior.mean[i, :2])
        np.testing.assert_allclose(found.position[i], one.position, atol=1e-9)
        np.testing.assert_allclose(found.covariance[i], one.covariance, rtol=1e-9)


@pytest.mark.parametrize("mode", list(Mode))
def test_scans_with_gaps_are_what_is_left_of_them(mode):
    truth, z, prior = scans(3, runs=3)
    z[0, 1] = np.nan
    z[1, :2] = np.nan
    z[2] = np.nan
    found = converted.prelocalize(RangeScan(SENSORS, z, MODEL), prior.mean[:, :2], mode=mode)
    assert found.ok.tolist() == [True, False, False]
    left = RangeScan(SENSORS[[0, 2, 3]], z[:1, [0, 2, 3]], MODEL)
    alone = converted.prelocalize(left, prior.mean[:1, :2], mode=mode)
    np.testing.assert_allclose(found.position[0], alone.position[0], atol=1e-8)
    assert np.isfinite(found.position).all()
    assert np.isfinite(found.covariance).all()
    assert np.hypot(*(found.position[0] - truth[0])) < 0.2


def test_without_a_position_only_the_prediction_is_left():
    _, z, belief = scans(4, runs=2)
    z[0, :2] = np.nan
    motion = SteppedAcceleration((0.0027, 0.0027))
    posterior, info = converted.step(belief, RangeScan(SENSORS, z, MODEL), motion=motion, dt_s=0.2)
    np.testing.assert_allclose(posterior.mean[0], info.prior.mean[0], rtol=1e-13)
    np.testing.assert_allclose(posterior.covariance[0], info.prior.covariance[0], rtol=1e-12)
    assert info.update.readings.tolist() == [0.0, 2.0]
    # and with one: Wang (18)-(21), the position read directly
    position, R = info.prelocalized.position[1], info.prelocalized.covariance[1]
    P = info.prior.covariance[1]
    K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
    wanted = info.prior.mean[1] + K @ (position - info.prior.mean[1, :2])
    np.testing.assert_allclose(posterior.mean[1], wanted, rtol=1e-10)
    np.testing.assert_allclose(
        posterior.covariance[1], P - K @ (P[:2, :2] + R) @ K.T, rtol=1e-9, atol=1e-15
    )


def test_newton_strays_from_bad_starts_and_the_safe_search_does_not():
    truth, z, _ = scans(5, runs=400)
    starts = truth + np.random.default_rng(6).uniform(-3, 3, truth.shape)
    scan = RangeScan(SENSORS, z, MODEL)
    error = {}
    for mode in Mode:
        found = converted.prelocalize(scan, starts, mode=mode)
        missed = np.linalg.norm(found.position - truth, axis=1) > 0.2
        error[mode] = np.mean(missed | ~found.ok)
    assert error[Mode.PAPER] > 0.02
    assert error[Mode.FISHER] <= error[Mode.PAPER]
    assert error[Mode.SAFE] == 0.0


def test_the_safe_search_takes_the_likelier_side_of_sensors_almost_in_line():
    sensors = np.array([[0.0, 0.0], [2.0, 0.3], [4.0, 0.0], [6.0, 0.2]])
    truth = np.array([[2.5, 1.5], [2.5, -1.5]])
    z = np.linalg.norm(truth[:, None] - sensors, axis=-1)
    scan = RangeScan(sensors, z, RangeModel(sigma_m=0.02))
    astray = converted.prelocalize(scan, truth[::-1] * [1.0, 1.1], mode=Mode.FISHER)
    assert (np.linalg.norm(astray.position - truth, axis=1) > 1.0).all()
    found = [
        converted.prelocalize(scan, starts, mode=Mode.SAFE).position
        for starts in (truth[::-1] * [1.0, 1.1], truth)
    ]
    # One of the two is on the side to which the middle of the sensors leads.
    right = np.linalg.norm(found[0] - truth, axis=1) < 1e-6
    assert right.any()
    np.testing.assert_allclose(found[1], truth, atol=1e-6)


def test_step_is_prediction_prelocalization_and_update():
    _, z, belief = scans(7, runs=3)
    motion, scan = SteppedAcceleration((0.01, 0.02)), RangeScan(SENSORS, z, MODEL)
    posterior, info = converted.step(belief, scan, motion=motion, dt_s=0.2, mode=Mode.FISHER)
    prior = kalman.predict(belief, motion.transition(0.2), motion.noise(0.2))
    found = converted.prelocalize(scan, prior.mean[:, :2], mode=Mode.FISHER)
    np.testing.assert_array_equal(info.prior.mean, prior.mean)
    np.testing.assert_array_equal(posterior.mean, converted.update(prior, found).posterior.mean)
