"""Beliefs weighed on a grid: against the Kalman filter, drawn samples, and what must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trackfield.filtering import extended, gridded
from trackfield.filtering.gridded import Answers, Doubt
from trackfield.raster import Region
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

MODEL = RangeModel(sigma_m=0.1, max_range_m=1.4)
NOBODY = np.zeros((0, 2))
SURE = Doubt(share=1e-12, wider=1.0, deaf=1e-9)
STATE = Gaussian(
    np.array([5.0, 5.0, 0.4, 0.1]),
    np.array(
        [[0.04, 0.01, 0.02, 0.0], [0.01, 0.03, 0.0, 0.01], [0.02, 0, 0.05, 0], [0, 0.01, 0, 0.04]]
    ),
)


def test_far_sensors_make_it_the_kalman_filter():
    sensors = np.array([[-95.0, 5.0], [5.0, 205.0]])
    z = np.array([100.1, 199.85])
    far = RangeModel(sigma_m=0.1)
    ours = gridded.update(STATE, Answers(sensors, z, NOBODY), models=far, doubt=SURE)
    plain = extended.update(STATE, z, extended.Ranges(sensors, far)).posterior
    assert_allclose(ours.mean, plain.mean, atol=2e-3)
    assert_allclose(ours.covariance, plain.covariance, atol=1e-3)


def test_silence_and_a_range_as_weighed_samples_have_it():
    heard = Answers(np.array([[4.4, 5.5]]), np.array([0.9]), np.array([[6.1, 5.2]]))
    doubt = Doubt(share=0.2, wider=9.0, deaf=0.05)
    rng = np.random.default_rng(1)
    P = STATE.covariance[:2, :2]
    scale = np.where(rng.random(400_000) < doubt.share, 3.0, 1.0)
    p = STATE.mean[:2] + scale[:, None] * (
        rng.standard_normal((400_000, 2)) @ np.linalg.cholesky(P).T
    )
    weight = np.exp(-0.5 * ((np.linalg.norm(p - heard.sensors[0], axis=1) - 0.9) / 0.1) ** 2)
    weight *= np.where(np.linalg.norm(p - heard.silent[0], axis=1) <= 1.4, doubt.deaf, 1.0)
    weight /= weight.sum()
    mean = weight @ p
    spread = (weight[:, None] * (p - mean)).T @ (p - mean)
    found = gridded.update(STATE, heard, models=MODEL, doubt=doubt)
    assert_allclose(found.mean[:2], mean, atol=0.01)
    assert_allclose(found.covariance[:2, :2], spread, rtol=0.06, atol=1.5e-3)


def test_two_ranges_that_leave_two_places_leave_both():
    prior = Gaussian(np.array([0.0, 0.05]), np.eye(2))
    heard = Answers(np.array([[-0.5, 0.0], [0.5, 0.0]]), np.full(2, np.hypot(0.5, 1.0)), NOBODY)
    both = gridded.update(prior, heard, models=MODEL)
    assert both.covariance[1, 1] == pytest.approx(1.0, abs=0.15)  # at y = +-1
    assert both.covariance[0, 0] < 0.05
    told = heard._replace(silent=np.array([[0.0, -1.6]]))  # would hear the lower place
    one = gridded.update(prior, told, models=MODEL)
    assert one.mean[1] == pytest.approx(1.0, abs=0.15)


def test_a_target_that_was_lost_is_found_where_the_readings_are():
    truth = np.array([6.0, 5.6])  # five standard deviations from where it was believed
    sensors = np.array([[5.5, 5.0], [6.5, 5.2], [5.8, 6.4]])
    z = np.linalg.norm(sensors - truth, axis=1)
    found = gridded.update(STATE, Answers(sensors, z, NOBODY), models=MODEL)
    assert_allclose(found.mean[:2], truth, atol=0.1)


def test_the_field_bounds_where_it_can_be():
    prior = Gaussian(np.array([0.1, 5.0]), np.diag([0.25, 0.01]))
    free = gridded.update(prior, Answers(NOBODY, np.zeros(0), NOBODY), models=MODEL)
    kept = gridded.update(
        prior, Answers(NOBODY, np.zeros(0), NOBODY), models=MODEL, field=Region(0, 0, 10, 10)
    )
    assert free.mean[0] == pytest.approx(0.1, abs=1e-6)
    assert kept.mean[0] > 0.4


def test_velocity_follows_the_position_as_the_prior_has_it():
    sensors = np.array([[4.0, 5.0]])
    heard = Answers(sensors, np.array([1.2]), NOBODY)
    found = gridded.update(STATE, heard, models=MODEL, doubt=SURE)
    P = STATE.covariance
    K = P[2:, :2] @ np.linalg.inv(P[:2, :2])
    moved = found.mean[:2] - STATE.mean[:2]
    assert_allclose(found.mean[2:], STATE.mean[2:] + K @ moved)
    rest = P[2:, 2:] - K @ P[:2, 2:]
    assert_allclose(found.covariance[2:, 2:], rest + K @ found.covariance[:2, :2] @ K.T)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), heard=st.integers(0, 4), silent=st.integers(0, 4))
def test_whatever_is_heard_it_stays_a_belief(seed, heard, silent):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((4, 4)) * rng.uniform(0.05, 1.0)
    prior = Gaussian(rng.uniform(0, 10, 4), root @ root.T + 1e-4 * np.eye(4))
    told = Answers(
        rng.uniform(0, 10, (heard, 2)), rng.uniform(0, 3, heard), rng.uniform(0, 10, (silent, 2))
    )
    found = gridded.update(prior, told, models=MODEL, field=Region(0, 0, 10, 10))
    assert np.isfinite(found.mean).all()
    assert np.linalg.eigvalsh(found.covariance).min() > 0
