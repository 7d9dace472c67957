"""Tracking under a soft bound: promises kept, lost targets found, runs apart."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from trackfield.errors import ConfigurationError
from trackfield.filtering import kalman, second_order
from trackfield.motion import SteppedAcceleration
from trackfield.raster import Region
from trackfield.scheduling import soft_tracking
from trackfield.scheduling.soft_bound import choose
from trackfield.scheduling.soft_tracking import Service, State
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

SIGMA = 0.1
MODEL = RangeModel(sigma_m=SIGMA, max_range_m=1.4)
SERVICE = Service(MODEL, 3.0 * SIGMA**2, field=Region(0.0, 0.0, 10.0, 10.0))
MOTION = SteppedAcceleration((0.06**2, 0.06**2))
SENSORS = np.random.default_rng(7).uniform(0.0, 10.0, (1, 441, 2))
WEIGHTS = np.ones((1, 441))


def state(x, y, *, spread=0.1, missed=0):
    P = np.diag([spread**2, spread**2, 0.1**2, 0.1**2])
    return State(Gaussian(np.array([[x, y, 0.4, 0.0]]), P[None]), np.array([missed], np.int32))


def predicted(now):
    belief = kalman.predict(now.belief, MOTION.transition(1.0), MOTION.noise(1.0))
    return now._replace(belief=belief)


def listen(asked, truth, rng, *, deaf=()):
    at = SENSORS[0, np.maximum(asked[0], 0)]
    r = np.linalg.norm(at - truth, axis=1)
    hears = (asked[0] >= 0) & (r <= 1.4) & ~np.isin(asked[0], deaf)
    return np.where(hears, r + SIGMA * rng.standard_normal(r.shape), np.nan)[None]


def tracked(now, path, rng):
    """Follow a target; errors in sigma, sensors asked, squared distances."""
    rows = []
    for truth in path:
        now = predicted(now)
        request = soft_tracking.ask(now, SENSORS, service=SERVICE, weights=WEIGHTS)
        z = listen(request.sensors, truth, rng)
        now, info = soft_tracking.hear(now, request, z, sensors=SENSORS, service=SERVICE)
        error = np.linalg.norm(now.belief.mean[0, :2] - truth) / SIGMA
        rows.append((error, (request.sensors >= 0).sum(), info.kept[0], request.searching[0]))
    return np.array(rows).T


def straight(x, y, steps):
    return np.column_stack([x + 0.4 * np.arange(1, steps + 1), np.full(steps, y)])


def test_a_target_that_is_where_it_is_believed_costs_one_or_two_sensors():
    error, asked, kept, searching = tracked(
        state(1.0, 5.0), straight(1.0, 5.0, 20), np.random.default_rng(0)
    )
    assert kept.all()
    assert not searching.any()
    assert 1.0 <= asked.mean() <= 2.0
    assert np.sqrt((error**2).mean()) < 3.0**0.5


@pytest.mark.parametrize("seed", range(8))
def test_a_target_that_is_not_where_it_is_believed_is_found(seed):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi)
    off = rng.uniform(0.6, 2.0) * np.array([np.cos(angle), np.sin(angle)])
    path = straight(2.0, 5.0, 14) + np.clip(off, -1.5, 1.5)
    error, asked, _, _ = tracked(state(2.0, 5.0), path, rng)
    assert (error[-4:] < 6.0).all()
    assert asked[-3:].mean() <= 3.0  # and then it is cheap again


def test_where_all_is_well_the_update_is_the_filter_s_own():
    now = predicted(state(4.0, 5.0, spread=0.15))
    request = soft_tracking.ask(now, SENSORS, service=SERVICE, weights=WEIGHTS)
    plain = choose(
        now.belief,
        SENSORS,
        models=MODEL,
        bound_m2=SERVICE.bound_m2,
        weights=WEIGHTS,
        care=SERVICE.care,
    )
    assert_array_equal(request.sensors, plain.choice.sensors)
    z = listen(request.sensors, np.array([4.4, 5.0]), np.random.default_rng(3))
    after, info = soft_tracking.hear(now, request, z, sensors=SENSORS, service=SERVICE)
    made = request.sensors[0] >= 0
    expected = second_order.update(
        now.belief, z[:, made], SENSORS[:, request.sensors[0, made]], models=MODEL
    ).posterior
    assert not info.doubted.any()
    assert_allclose(after.belief.mean, expected.mean)
    assert_allclose(after.belief.covariance, expected.covariance)


def test_silence_makes_the_belief_wide_and_the_next_look_a_net():
    now = predicted(state(4.0, 5.0))
    request = soft_tracking.ask(now, SENSORS, service=SERVICE, weights=WEIGHTS)
    silent = np.full(request.sensors.shape, np.nan)
    after, info = soft_tracking.hear(now, request, silent, sensors=SENSORS, service=SERVICE)
    assert info.doubted.all()
    assert not info.kept.any()
    assert after.missed[0] == 1
    before = np.trace(now.belief.covariance[0, :2, :2])
    assert np.trace(after.belief.covariance[0, :2, :2]) > 4.0 * before
    for look in range(8):
        now = predicted(after)
        request = soft_tracking.ask(now, SENSORS, service=SERVICE, weights=WEIGHTS)
        silent = np.full(request.sensors.shape, np.nan)
        after, _ = soft_tracking.hear(now, request, silent, sensors=SENSORS, service=SERVICE)
        assert after.missed[0] == look + 2
    assert request.searching.all()
    assert not request.choice.feasible.any()
    assert 8 < (request.sensors >= 0).sum() <= 24
    assert np.isfinite(after.belief.mean).all()


def test_one_lost_run_does_not_touch_the_others():
    fine, lost = state(4.0, 5.0), state(6.0, 5.0, spread=1.5, missed=2)
    both = State(
        Gaussian(
            np.concatenate([fine.belief.mean, lost.belief.mean]),
            np.concatenate([fine.belief.covariance, lost.belief.covariance]),
        ),
        np.concatenate([fine.missed, lost.missed]),
    )
    sensors = np.repeat(SENSORS, 2, axis=0)
    request = soft_tracking.ask(both, sensors, service=SERVICE, weights=np.ones((2, 441)))
    alone = soft_tracking.ask(fine, SENSORS, service=SERVICE, weights=WEIGHTS)
    assert list(request.searching) == [False, True]
    assert_array_equal(request.sensors[0, :3], alone.sensors[0])
    assert (request.sensors[0, 3:] == -1).all()
    z = np.full(request.sensors.shape, np.nan)
    z[0, :3] = listen(alone.sensors, np.array([4.0, 5.0]), np.random.default_rng(1))[0]
    after, _ = soft_tracking.hear(both, request, z, sensors=sensors, service=SERVICE)
    one, _ = soft_tracking.hear(fine, alone, z[:1, :3], sensors=SENSORS, service=SERVICE)
    assert_allclose(after.belief.mean[0], one.belief.mean[0])
    assert list(after.missed) == [0, 3]


def test_with_every_battery_empty_the_belief_only_widens():
    now = soft_tracking.init(predicted(state(4.0, 5.0)).belief)
    for _ in range(6):
        request = soft_tracking.ask(
            now, SENSORS, service=SERVICE, weights=np.full((1, 441), np.inf)
        )
        assert (request.sensors == -1).all()
        silent = np.full(request.sensors.shape, np.nan)
        now, info = soft_tracking.hear(now, request, silent, sensors=SENSORS, service=SERVICE)
        now = predicted(now)
    assert not info.kept.any()
    assert np.isfinite(now.belief.covariance).all()


def test_a_service_that_cannot_be_is_refused():
    with pytest.raises(ConfigurationError) as refused:
        Service(MODEL, np.array([0.1, 0.0]), gate=1.0, nets=())
    assert len(refused.value.problems) == 3
    assert Service(MODEL, np.array([0.1, 0.2])).gate == SERVICE.gate
