"""One moment's readings: the right state among those returned, all exact ones, no false ones."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import fsolve

from motion_scenes import RECTANGLE, straight
from trackfield.errors import InputError
from trackfield.localization.motion_modes import Verdict
from trackfield.localization.motion_search import MotionSearch, refine
from trackfield.localization.motion_snapshot import locate, locate_vectors
from trackfield.sensing import motion_rate, motion_vector
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel

NOW = np.zeros(1)
SIZES = MotionRateModel(sigma=0.01)
RATES = AngularRateModel(sigma_rad_s=0.01)


def scene(rng, count, d=2):
    """Sensors and a target in the unit square or cube, at .05 to 1 m/s whichever way."""
    v = rng.normal(size=d)
    v *= rng.uniform(0.05, 1.0) / np.linalg.norm(v)
    return rng.random((count, d)), np.concatenate([rng.random(d), v])


def nearest(fit, state):
    return min((float(np.abs(m.state - state).max()) for m in fit.modes), default=math.inf)


@pytest.mark.parametrize("frame", ["square", "rectangle"])
def test_six_sizes_of_motion_have_the_true_state_among_those_returned(frame):
    rng = np.random.default_rng(66)
    found = 0
    for _ in range(25):
        sensors, state = scene(rng, 6)
        if frame == "rectangle":
            scale = np.array([0.6, 0.3])
            sensors, state = (sensors - 0.5) * scale, state.copy()
            state[:2] = (state[:2] - 0.5) * 2.0 * scale
        fit = locate(sensors, straight(sensors, state, NOW, model=SIZES).given.value, SIZES)
        found += nearest(fit, state) < 1e-5
        assert fit.verdict in {Verdict.EITHER_WAY, Verdict.SEVERAL}
    assert found == 25


def test_with_noise_the_maximum_next_to_the_truth_is_among_those_returned():
    rng = np.random.default_rng(67)
    model = MotionRateModel(sigma=0.002)
    found = 0
    for _ in range(25):
        sensors, state = scene(rng, 6)
        run = straight(sensors, state, NOW, model=model, rng=rng)
        there = refine(run.given, state[None], search=MotionSearch(reach_m=10.0))
        found += nearest(locate(sensors, run.given.value, model), there.state[0]) < 1e-3
    assert found >= 24


@pytest.mark.parametrize(("model", "count"), [(RATES, 4), (RATES, 6)])
def test_angular_rates_have_the_true_state_among_those_returned(model, count):
    rng = np.random.default_rng(68)
    found, unique = 0, 0
    for _ in range(6):
        sensors, state = scene(rng, count)
        fit = locate(sensors, straight(sensors, state, NOW, model=model).given.value, model)
        found += nearest(fit, state) < 1e-5
        unique += fit.verdict is Verdict.UNIQUE
    assert found == 6
    assert unique >= (4 if count == 6 else 0)


def test_six_sizes_in_space():
    rng = np.random.default_rng(69)
    found = 0
    for _ in range(2):
        sensors, state = scene(rng, 8, d=3)
        fit = locate(sensors, straight(sensors, state, NOW, model=SIZES).given.value, SIZES)
        found += nearest(fit, state) < 1e-5
    assert found == 2


def test_four_sensors_leave_all_states_that_an_exhaustive_search_finds():
    rng = np.random.default_rng(70)
    state = np.array([*rng.uniform(-0.25, 0.25, 2), *rng.normal(scale=0.1, size=2)])
    given = straight(RECTANGLE, state, NOW, model=SIZES).given
    fit = locate(RECTANGLE, given.value, SIZES)
    ours = [m.state for m in fit.modes if m.cost < 1e-12]

    def equations(x):
        seen = motion_vector.sighting(RECTANGLE, x)
        return motion_vector.scalar_residual(seen, given.value).value / 1e-3

    for _ in range(300):
        start = np.array([*rng.uniform(-0.8, 0.8, 2), *rng.normal(scale=0.3, size=2)])
        x, info, code, _ = fsolve(equations, start, full_output=True, xtol=1e-13)
        exact = code == 1 and np.abs(info["fvec"]).max() < 1e-9
        if exact and np.linalg.norm(x[:2]) < 0.9 and np.linalg.norm(x[2:]) > 1e-3:
            read = motion_rate.strength(SIZES, RECTANGLE, states=x)
            if np.abs(read - given.value).max() < 1e-9:
                assert min(np.abs(x - y).max() for y in ours) < 1e-5
    assert fit.verdict is Verdict.SEVERAL
    assert len(ours) % 2 == 0


def test_every_state_is_followed_by_the_one_with_the_opposite_velocity():
    rng = np.random.default_rng(71)
    sensors, state = scene(rng, 6)
    modes = locate(sensors, straight(sensors, state, NOW, model=SIZES).given.value, SIZES).modes
    for one, other in zip(modes[::2], modes[1::2], strict=True):
        np.testing.assert_array_equal(one.state * [1, 1, -1, -1], other.state)
        assert one.weight == other.weight
    assert sum(mode.weight for mode in modes) == pytest.approx(1.0)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 5), falloff=st.sampled_from([1.0, 2.0]))
def test_vector_outputs_are_solved_in_closed_form_in_any_dimension(seed, n, falloff):
    rng = np.random.default_rng(seed)
    sensors, state = scene(rng, n + 1, n)
    y = motion_vector.vector_output(motion_vector.sighting(sensors, state), falloff=falloff)
    found = locate_vectors(sensors, y, falloff=falloff)
    assert found.determined
    np.testing.assert_allclose(found.state, state, atol=1e-5)
    assert found.residual.max() < 1e-6 * np.abs(y).max()


def test_vector_outputs_of_two_sensors_are_enough_but_not_in_line_with_the_target():
    state = np.array([0.1, 0.05, 0.2, -0.1])
    for sensors, enough in ((RECTANGLE[:2], True), (np.array([[0.0, 0.0], [0.2, 0.1]]), False)):
        y = motion_vector.vector_output(motion_vector.sighting(sensors, state))
        found = locate_vectors(sensors, y)
        assert found.determined is enough
        assert np.isfinite(found.state).all()
    nothing = locate_vectors(RECTANGLE, np.zeros((4, 2)))
    assert not nothing.determined


@pytest.mark.parametrize(
    ("sensors", "values", "verdict"),
    [
        (RECTANGLE[:3], np.full(3, 0.2), Verdict.TOO_FEW),
        (RECTANGLE[[0, 1, 2, 2, 1]], np.full(5, 0.2), Verdict.TOO_FEW),
        (np.zeros((6, 2)), np.full(6, 0.2), Verdict.TOO_FEW),
        (RECTANGLE, np.zeros(4), Verdict.AT_REST),
        (RECTANGLE, np.full(4, 0.005), Verdict.AT_REST),
    ],
)
def test_what_cannot_be_told_is_told(sensors, values, verdict):
    assert locate(sensors, values, SIZES).verdict is verdict


def test_readings_of_no_state_are_not_explained():
    rng = np.random.default_rng(72)
    sensors = rng.random((9, 2))
    fit = locate(sensors, rng.uniform(0.1, 3.0, 9), SIZES)
    assert fit.verdict is Verdict.UNEXPLAINED


def test_bearings_of_one_moment_leave_the_velocity_free():
    state = np.array([0.1, 0.05, 0.2, -0.1])
    model = BearingModel(sigma_rad=0.01)
    fit = locate(RECTANGLE, straight(RECTANGLE, state, NOW, model=model).given.value, model)
    assert fit.verdict is Verdict.UNDETERMINED
    assert not any(mode.determined for mode in fit.modes)


def test_a_target_on_a_sensor_is_no_sure_answer():
    """Its own sensor reads next to nothing or anything, and no slope tells."""
    rng = np.random.default_rng(73)
    sensors, state = scene(rng, 6)
    state[:2] = sensors[2]
    values = straight(sensors, state, NOW, model=SIZES).given.value
    fit = locate(sensors, values, SIZES)
    assert fit.verdict is not Verdict.UNIQUE
    best = fit.modes[0] if fit.modes else None
    assert best is None or best.cost > 1.0 or np.abs(best.state[:2] - state[:2]).max() < 0.05


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.array([0.1, math.nan, 0.1, 0.1]), "value is nan"),
        (np.array([0.1, -0.3, 0.1, 0.1]), "none below zero"),
        (np.full(5, 0.1), "found values of shape"),
    ],
)
def test_bad_readings_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        locate(RECTANGLE, values, SIZES)


@pytest.mark.parametrize("sensors", [np.zeros((3, 1)), np.zeros(3)])
def test_vector_outputs_that_do_not_fit_are_refused(sensors):
    with pytest.raises(InputError, match="expected"):
        locate_vectors(sensors, sensors)
    with pytest.raises(InputError, match="finite"):
        locate_vectors(RECTANGLE, np.full((4, 2), math.inf))
