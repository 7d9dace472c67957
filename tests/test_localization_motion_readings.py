"""Readings of angles and motion: their misfit and slope, the kernel's twin, what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from motion_scenes import MODELS, RECTANGLE, joined, straight
from trackfield._core import _motion
from trackfield.errors import InputError
from trackfield.localization import motion_readings, motion_search
from trackfield.localization.motion_readings import readings
from trackfield.localization.motion_search import MotionSearch
from trackfield.sensing import angular_rate, bearing, motion_rate
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel


def mixed(rng, d, m=12, *, moving=True):
    """Readings of all kinds at random, of sensors that move."""
    models = [
        (
            MotionRateModel(falloff=rng.uniform(0.5, 2.0), sigma=rng.uniform(0.01, 0.1)),
            AngularRateModel(sigma_rad_s=rng.uniform(0.01, 0.1)),
            BearingModel(sigma_rad=rng.uniform(0.01, 0.1), bias_rad=0.3),
            MotionRateModel(sigma=0.1),
        )[i % 4]
        for i in range(m)
    ]
    return readings(
        models,
        rng.uniform(-1, 1, (m, d)),
        rng.uniform(0, 1, m),
        t_s=rng.uniform(-1, 1, m),
        velocities=rng.normal(size=(m, d)) if moving else None,
    )


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_misfit_is_that_of_the_models_of_each_kind(seed, d):
    rng = np.random.default_rng(seed)
    found, state = mixed(rng, d), rng.uniform(-1, 1, 2 * d)
    residual = motion_readings.misfit(found, state).residual
    for i, kind in enumerate(found.kind):
        p, v = state[:d] + found.t_s[i] * state[d:], state[d:] - found.velocities[i]
        at, sensor = np.concatenate([p, v]), found.sensors[i : i + 1]
        if kind == 0:
            h = bearing.expected(BearingModel(), sensor, positions=p)
            e = bearing.residual(found.value[i], h)
        elif kind == 1:
            e = found.value[i] - angular_rate.expected(AngularRateModel(), sensor, states=at)
        else:
            model = MotionRateModel(falloff=float(found.falloff[i]))
            e = found.value[i] - motion_rate.strength(model, sensor, states=at)
        assert residual[i] == pytest.approx(float(e[0]) / found.sigma[i], rel=1e-9, abs=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_gain_is_the_slope_of_what_is_expected(seed, d):
    rng = np.random.default_rng(seed)
    found, state = mixed(rng, d), rng.uniform(-1, 1, 2 * d)
    h = 1e-6

    def error(x):
        return motion_readings.misfit(found, x).residual

    slope = np.stack(
        [(error(state - h * e) - error(state + h * e)) / (2 * h) for e in np.eye(2 * d)]
    )
    gain = motion_readings.misfit(found, state).gain
    size = np.abs(gain).max(axis=1, keepdims=True)
    np.testing.assert_allclose(gain / size, slope.T / size, atol=1e-3)


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_the_kernel_charges_half_the_squared_residuals(seed, d):
    rng = np.random.default_rng(seed)
    found, states = mixed(rng, d), rng.uniform(-1, 1, (5, 2 * d))
    cost = _motion.costs(*motion_search.arrays(found), states)[:, 0]
    residual = motion_readings.misfit(found, states).residual
    np.testing.assert_allclose(cost, 0.5 * np.sum(residual**2, axis=1), rtol=1e-9)


@pytest.mark.parametrize("d", [2, 3])
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_descents_end_where_scipy_does(d, seed):
    rng = np.random.default_rng(seed)
    state = np.concatenate([rng.uniform(-0.5, 0.5, d), rng.normal(size=d)])
    sensors = rng.uniform(-1, 1, (5, d))
    parts = [
        straight(sensors, state, np.linspace(-1, 1, 6), model=model, rng=rng).given
        for model in MODELS.values()
    ]
    found = joined(*parts)
    start = state + 0.02 * rng.normal(size=2 * d)
    ours = motion_search.refine(found, start[None], search=MotionSearch(reach_m=10.0))
    theirs = least_squares(
        lambda x: motion_readings.misfit(found, x).residual,
        start,
        lambda x: -motion_readings.misfit(found, x).gain,
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
    )
    assert ours.converged[0]
    assert ours.cost[0] <= theirs.cost * (1.0 + 1e-9)
    if np.abs(theirs.x - ours.state[0]).max() < 0.01:  # else they found different maxima
        np.testing.assert_allclose(ours.state[0], theirs.x, atol=1e-5)


def test_a_window_is_thinned_to_block_means_whose_noise_is_that_of_a_mean():
    t = np.linspace(0.0, 8.0, 401)
    flown = straight(RECTANGLE, np.array([-0.5, 0.02, 0.12, 0.0]), t, model=MODELS["motion"])
    thin = motion_search.thinned(flown.given)
    assert len(thin.value) == 64
    rows = (flown.given.sensors == RECTANGLE[0]).all(axis=1)
    block = flown.given.rows(np.flatnonzero(rows)[: math.ceil(401 / 16)])
    own = np.flatnonzero((thin.sensors == RECTANGLE[0]).all(axis=1))[0]
    assert thin.value[own] == pytest.approx(block.value.mean(), rel=1e-12)
    assert thin.t_s[own] == pytest.approx(block.t_s.mean(), rel=1e-12)
    assert thin.sigma[own] == pytest.approx(0.02 / math.sqrt(len(block.value)), rel=1e-12)


def test_bearings_are_averaged_the_short_way_round():
    t = np.linspace(-1.0, 1.0, 200)
    state = np.array([-5.0, 0.0, 0.0, 0.05])
    flown = straight(np.zeros((1, 2)), state, t, model=MODELS["bearing"])
    thin = motion_search.thinned(flown.given)
    assert len(thin.value) < 200
    assert (np.abs(np.abs(thin.value) - np.pi) < 0.02).all()


def test_moving_sensors_are_thinned_by_leaving_readings_out():
    rng = np.random.default_rng(1)
    found = mixed(rng, 2, m=400)
    thin = motion_search.thinned(found)
    assert 64 <= len(thin.value) <= 400
    assert set(thin.value) <= set(found.value)


def test_what_is_known_of_a_state_at_rest_is_nothing():
    found = straight(RECTANGLE, np.array([0.1, 0.0, 0.1, 0.1]), np.zeros(1), model=MODELS["motion"])
    still = motion_readings.doubt(found.given, np.array([[0.1, 0.0, 0.0, 0.0]]), extent_m=0.3)
    moving = motion_readings.doubt(found.given, np.array([[0.1, 0.0, 0.1, 0.1]]), extent_m=0.3)
    assert not still.determined[0]
    assert moving.determined[0]
    assert np.isfinite(still.covariance).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.array([0.1, math.nan, 0.2, 0.3])}, "reading 1: value"),
        ({"values": np.array([0.1, 0.2, -0.2, 0.3])}, "reading 2: the size of a motion is -0.2"),
        ({"sensors": np.full((4, 2), math.inf)}, "reading 0: sensors"),
        ({"sensors": np.zeros((3, 2))}, "found values of shape"),
        ({"sensors": np.zeros((4, 4))}, "found values of shape"),
        ({"models": [MODELS["motion"]] * 3}, "3 models"),
        ({"models": RangeModel()}, "found a sensor of kind 'range'"),
        ({"t_s": math.nan}, "reading 0: t_s"),
        ({"sigma": np.array([0.1, 0.0, 0.1, 0.1])}, "reading 1: sigma is 0"),
        ({"velocities": np.zeros((4, 3))}, "velocities of shape"),
    ],
)
def test_bad_readings_are_refused(change, message):
    usual = {"models": MODELS["motion"], "sensors": RECTANGLE, "values": np.full(4, 0.2)} | change
    with pytest.raises(InputError, match=message):
        readings(usual.pop("models"), usual.pop("sensors"), usual.pop("values"), **usual)


def test_noise_may_take_a_size_a_little_below_zero_and_sigma_may_be_told():
    found = readings(
        MODELS["motion"],
        RECTANGLE,
        np.array([-0.05, 0.1, 0.1, 0.1]),
        sigma=np.array([math.nan, 0.5, math.nan, math.nan]),
    )
    np.testing.assert_array_equal(found.sigma, [0.02, 0.5, 0.02, 0.02])
