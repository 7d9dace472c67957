"""The bound, and the filters that reach it."""

import numpy as np
import pytest

from trackfield.filtering import extended, kalman, pcrb
from trackfield.motion import ConstantVelocity, SteppedAcceleration
from trackfield.sensing.range import RangeModel
from trackfield.simulation import roads
from trackfield.types import Gaussian

DT = roads.DT_S


def test_for_linear_readings_the_bound_is_the_filters_own_covariance():
    motion = ConstantVelocity(0.3)
    H, R = np.eye(2, 4), 0.2 * np.eye(2)
    belief = Gaussian(np.zeros(4), np.diag([1.0, 2.0, 0.5, 0.1]))
    information = H.T @ np.linalg.inv(R) @ H
    bounds = pcrb.recursion(belief.covariance, motion, dt_s=0.4, information=[information] * 5)
    for bound in bounds:
        belief, _ = kalman.step(
            belief, np.zeros(2), sensor=kalman.Linear(H, R), motion=motion, dt_s=0.4
        )
        np.testing.assert_allclose(bound, belief.covariance, rtol=1e-9, atol=1e-13)


def test_the_recursion_is_tichavskys():
    # J' = D22 - D21 (J + D11)^-1 D12, in information form, with an invertible Q.
    motion, rng = ConstantVelocity(0.3), np.random.default_rng(0)
    F, Qi = motion.transition(0.4), np.linalg.inv(motion.noise(0.4))
    root = rng.standard_normal((4, 4))
    J, gained = np.linalg.inv(root @ root.T), np.diag([3.0, 5.0, 0.0, 0.0])
    wanted = Qi + gained - Qi @ F @ np.linalg.inv(J + F.T @ Qi @ F) @ F.T @ Qi
    bound = pcrb.step(root @ root.T, motion, dt_s=0.4, information=gained)
    np.testing.assert_allclose(np.linalg.inv(bound), wanted, rtol=1e-6, atol=1e-6)


def test_information_of_ranges_is_the_variance_of_the_score():
    model = RangeModel(sigma_m=0.05, sigma_scale=0.08, max_range_m=5.0)
    sensors = np.array([[0.0, 0.0], [3.0, 0.5], [1.0, 2.5], [9.0, 9.0]])
    state = np.array([1.2, 0.9, 0.3, -0.1])
    rng = np.random.default_rng(1)
    r = np.linalg.norm(state[:2] - sensors[:3], axis=1)
    sigma = np.hypot(0.05, 0.08 * r)
    z = r + sigma * rng.standard_normal((200_000, 3))

    def log_density(p):
        at = np.linalg.norm(p - sensors[:3], axis=1)
        s = np.hypot(0.05, 0.08 * at)
        return (-0.5 * ((z - at) / s) ** 2 - np.log(s)).sum(axis=1)

    h = 1e-5
    score = np.stack(
        [
            (log_density(state[:2] + h * e) - log_density(state[:2] - h * e)) / (2 * h)
            for e in np.eye(2)
        ],
        axis=1,
    )
    information = pcrb.range_information(sensors, state, models=model)
    np.testing.assert_allclose(information[:2, :2], np.cov(score.T), rtol=0.02, atol=1.0)
    assert not information[2:].any()
    assert not information[:, 2:].any()


@pytest.fixture(scope="module")
def matched():
    """Errors (drives, K, runs, 4), their squared distances and bounds of the iterated filter."""
    rng = np.random.default_rng(11)
    motion, runs, steps = SteppedAcceleration((0.025, 0.01)), 10, 150
    start = 0.01 * np.eye(4)
    errors, nees, bounds = [], [], []
    for _ in range(16):
        drive = roads.matched(rng, steps=steps)
        z = roads.ranges(rng, drive, runs=runs)
        belief = Gaussian(roads.starts(rng, drive, runs=runs), np.broadcast_to(start, (runs, 4, 4)))
        information = pcrb.range_information(drive.sensors, drive.truth, models=roads.RANGES)
        bounds.append(pcrb.recursion(start, motion, dt_s=DT, information=information))
        for k in range(steps):
            heard = ~np.isnan(z[0, k])
            sensor = extended.Ranges(drive.sensors[heard], roads.RANGES)
            belief, _ = extended.step_iterated(
                belief, z[:, k, heard], sensor=sensor, motion=motion, dt_s=DT
            )
            error = belief.mean - drive.truth[k]
            errors.append(error)
            whitened = np.linalg.solve(belief.covariance, error[..., None])[..., 0]
            nees.append((error * whitened).sum(-1))
    return np.array(errors), np.array(nees), np.array(bounds)


def test_a_matched_iterated_filter_reaches_the_bound(matched):
    errors, _, bounds = matched
    rmse = np.sqrt((errors[..., :2] ** 2).sum(-1).mean())
    bound = np.sqrt(np.trace(bounds[..., :2, :2], axis1=-2, axis2=-1).mean())
    assert 0.94 < rmse / bound <= 1.04


def test_a_matched_iterated_filter_is_honest(matched):
    _, nees, _ = matched
    assert nees.mean() == pytest.approx(4.0, abs=0.3)
