"""Windows of readings: Example 5.1, all kinds, moving sensors, mirror images, what says nothing."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from motion_scenes import MODELS, RECTANGLE, joined, straight
from trackfield.errors import InputError
from trackfield.localization.motion_modes import Verdict
from trackfield.localization.motion_readings import readings
from trackfield.localization.motion_search import MotionSearch
from trackfield.localization.motion_window import path, window_fit
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel

KINDS = {
    "motion": lambda sigma: MotionRateModel(sigma=sigma),
    "angular_rate": lambda sigma: AngularRateModel(sigma_rad_s=sigma),
    "bearing": lambda sigma: BearingModel(sigma_rad=sigma),
}


def robot(rng, *, lane=0.05, turn=0.1, hz=10.0):
    """Cheng's robot: .12 m/s along the x axis, from 40 cm before the middle to 40 cm after it."""
    heading = rng.uniform(-turn, turn)
    state = np.array(
        [rng.uniform(-0.02, 0.02), rng.uniform(-lane, lane), math.cos(heading), math.sin(heading)]
    )
    state[2:] *= 0.12
    return state, np.arange(-3.4, 3.4, 1.0 / hz)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sigma", [0.01, 0.05])
def test_the_robot_of_example_5_1_is_found_to_10_cm_in_every_run(kind, sigma):
    rng = np.random.default_rng(51)
    worst = []
    for _ in range(25):
        state, t = robot(rng)
        run = straight(RECTANGLE, state, t, model=KINDS[kind](sigma), rng=rng)
        fit = window_fit(run.given)
        assert fit.verdict is Verdict.UNIQUE
        error = np.linalg.norm(path(fit, t) - run.positions(), axis=1)
        worst.append(error[np.abs(run.positions()[:, 0]) <= 0.25].max())
    assert max(worst) < 0.02


def test_along_the_very_axis_of_the_rectangle_mirror_images_are_one():
    rng = np.random.default_rng(8)
    state = np.array([0.0, 0.0, 0.12, 0.0])
    run = straight(
        RECTANGLE, state, np.arange(-3.4, 3.4, 0.1), model=KINDS["motion"](0.03), rng=rng
    )
    fit = window_fit(run.given, t_s=0.0)
    assert fit.modes[0].weight > 0.99
    np.testing.assert_allclose(fit.modes[0].state, state, atol=0.01)


def test_errors_are_as_large_as_the_covariance_says():
    rng = np.random.default_rng(5)
    d2 = []
    for _ in range(60):
        state, t = robot(rng)
        run = straight(RECTANGLE, state, t, model=KINDS["motion"](0.02), rng=rng)
        best = window_fit(run.given, t_s=0.0).modes[0]
        error = best.state - state
        d2.append(error @ np.linalg.solve(best.covariance, error))
    low, high = chi2.ppf([0.0005, 0.9995], 4 * len(d2))
    assert low < sum(d2) < high


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), d=st.integers(2, 3))
def test_without_noise_the_state_is_found_exactly_from_any_mixture_of_kinds(seed, d):
    rng = np.random.default_rng(seed)
    sensors = rng.uniform(0.0, 1.0, (5, d))
    state = np.concatenate([rng.uniform(0.2, 0.8, d), rng.normal(size=d)])
    state[d:] *= 0.2 / np.linalg.norm(state[d:])
    t = np.linspace(-1.5, 1.5, 9)
    parts = [straight(sensors, state, t, model=model).given for model in MODELS.values()]
    fit = window_fit(joined(*parts), t_s=0.0)
    np.testing.assert_allclose(fit.modes[0].state, state, atol=1e-6)
    assert fit.modes[0].determined


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_states_are_those_of_the_time_asked_for(seed):
    rng = np.random.default_rng(seed)
    state, t = robot(rng)
    run = straight(RECTANGLE, state, t, model=MODELS["angular_rate"], rng=rng)
    early, late = window_fit(run.given, t_s=-1.0), window_fit(run.given)
    assert late.t_s == t[-1]
    F = np.eye(4) + (t[-1] + 1.0) * np.eye(4, k=2)
    np.testing.assert_allclose(late.modes[0].state, F @ early.modes[0].state, atol=1e-9)
    carried = F @ early.modes[0].covariance @ F.T
    np.testing.assert_allclose(late.modes[0].covariance, carried, rtol=1e-6, atol=1e-12)


def test_one_sensor_that_moves_is_enough_for_bearings_and_rates():
    t = np.linspace(0.0, 8.0, 33)
    own = np.column_stack([np.sin(t), 0.5 * np.cos(2.0 * t)])
    drift = np.column_stack([np.cos(t), -np.sin(2.0 * t)])
    state = np.array([2.0, 3.0, -0.3, 0.1])
    o, u = state[:2] + t[:, None] * state[2:] - own, state[2:] - drift
    rate = (o[:, 0] * u[:, 1] - o[:, 1] * u[:, 0]) / np.sum(o**2, axis=1)
    angle = np.arctan2(o[:, 1], o[:, 0])
    for model, z in ((MODELS["angular_rate"], rate), (MODELS["bearing"], angle)):
        given = readings(model, own, z, t_s=t, velocities=drift)
        fit = window_fit(given, t_s=0.0, search=MotionSearch(reach_m=10.0))
        assert fit.verdict is Verdict.UNIQUE
        np.testing.assert_allclose(fit.modes[0].state, state, atol=1e-6)


def test_sensors_on_a_line_leave_the_mirror_image():
    rng = np.random.default_rng(2)
    sensors = np.array([[-0.4, 0.0], [-0.1, 0.0], [0.15, 0.0], [0.4, 0.0]])
    state = np.array([0.05, 0.3, 0.15, 0.02])
    run = straight(sensors, state, np.arange(-3, 3, 0.1), model=KINDS["motion"](0.02), rng=rng)
    fit = window_fit(run.given, t_s=0.0)
    assert fit.verdict is Verdict.SEVERAL
    first, second = fit.modes[:2]
    np.testing.assert_allclose(first.state, second.state * [1, -1, 1, -1], atol=1e-4)
    assert first.weight == pytest.approx(0.5, abs=0.01)
    assert min(np.abs(m.state - state).max() for m in fit.modes[:2]) < 0.05


def test_weights_are_shares_of_the_likelihood():
    rng = np.random.default_rng(6)
    state = np.array([0.3, 0.6, 0.2, 0.1])
    sensors = rng.uniform(0, 1, (4, 2))
    run = straight(sensors, state, np.array([0.0, 0.1]), model=KINDS["motion"](0.05), rng=rng)
    fit = window_fit(run.given)
    weights, costs = (
        np.array([getattr(m, name) for m in fit.modes]) for name in ("weight", "cost")
    )
    assert len(weights) > 1
    assert weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.log(weights / weights[0]), costs[0] - costs, atol=1e-9)
    assert (np.diff(costs) >= 0.0).all()


def test_one_place_and_fewer_readings_than_unknowns_are_told():
    t = np.linspace(0, 5, 40)
    one = straight(RECTANGLE[:1], np.array([0.1, 0.0, 0.1, 0.05]), t, model=MODELS["motion"])
    few = straight(RECTANGLE[:3], np.array([0.1, 0.0, 0.1, 0.05]), t[:1], model=MODELS["motion"])
    for run in (one, few):
        fit = window_fit(run.given)
        assert (fit.verdict, fit.modes) == (Verdict.TOO_FEW, ())


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("kind", ["motion", "angular_rate"])
def test_a_target_at_rest_is_nowhere(kind, noise):
    rng = np.random.default_rng(3)
    model = KINDS[kind](0.02)
    still = straight(RECTANGLE, np.array([0.1, 0.05, 0.0, 0.0]), np.arange(0, 4, 0.2), model=model)
    z = noise * 0.02 * rng.standard_normal(still.given.value.size)
    fit = window_fit(still.given._replace(value=np.abs(z) if kind == "motion" else z))
    assert fit.verdict is Verdict.AT_REST


def test_a_target_at_rest_is_found_by_its_bearings():
    rng = np.random.default_rng(3)
    state = np.array([0.1, 0.05, 0.0, 0.0])
    still = straight(RECTANGLE, state, np.arange(0, 4, 0.2), model=KINDS["bearing"](0.02), rng=rng)
    fit = window_fit(still.given)
    assert fit.verdict is Verdict.UNIQUE
    np.testing.assert_allclose(fit.modes[0].state, state, atol=0.01)


def test_a_target_that_turns_is_not_explained():
    t = np.arange(0.0, 10.0, 0.1)
    p = 0.2 * np.column_stack([np.cos(t), np.sin(t)])
    v = 0.2 * np.column_stack([-np.sin(t), np.cos(t)])
    o = p[:, None] - RECTANGLE
    z = np.abs(o[..., 0] * v[:, None, 1] - o[..., 1] * v[:, None, 0]) / np.sum(o**2, axis=-1)
    given = readings(
        KINDS["motion"](0.01), np.tile(RECTANGLE, (100, 1)), z.ravel(), t_s=t.repeat(4)
    )
    assert window_fit(given).verdict is Verdict.UNEXPLAINED


def test_faster_and_farther_targets_than_told_are_left_out():
    rng = np.random.default_rng(4)
    state, t = robot(rng)
    run = straight(RECTANGLE, state, t, model=KINDS["motion"](0.02), rng=rng)
    slow = window_fit(run.given, search=MotionSearch(max_speed_m_s=0.05))
    assert (slow.verdict, slow.modes) == (Verdict.UNEXPLAINED, ())


def test_nothing_and_no_time_are_refused():
    nothing = readings(MODELS["motion"], np.zeros((0, 2)), np.zeros(0))
    with pytest.raises(InputError, match="no readings"):
        window_fit(nothing)
    some = readings(MODELS["motion"], RECTANGLE, np.full(4, 0.2))
    with pytest.raises(InputError, match="t_s = nan"):
        window_fit(some, t_s=math.nan)
