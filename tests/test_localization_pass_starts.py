"""Closed forms of a pass: four of a pair, one of three or more; and the bounds of all of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime

from pass_scene import LAYOUT, NOISY, PASS, QUIET, TIMES, drawn, messages
from trackfield._core import _passes
from trackfield.errors import InputError
from trackfield.localization import pass_bounds, pass_lifted
from trackfield.localization.pass_messages import fishers
from trackfield.localization.pass_pairs import SIDES, pair_passes
from trackfield.sensing import amplitude
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import Profile

exponents = st.sampled_from([0.6, 1.0, 1.7, 2.0, 3.0])
seeds = st.integers(0, 2**32 - 1)


def random_pass(seed):
    rng = np.random.default_rng(seed)
    return rng, np.array([np.exp(rng.normal()), *rng.normal(size=2), *rng.normal(size=2)])


@given(seeds, exponents)
def test_all_four_passes_of_a_pair_send_its_messages(seed, exponent):
    rng, theta = random_pass(seed)
    sensors = rng.normal(size=(2, 2))
    sent = predict(theta, sensors, exponent=exponent).array()
    found = pair_passes(Profile(*sent[0]), Profile(*sent[1]), sensors, exponent=exponent)
    for each, sides in zip(found.theta[found.moves], SIDES[found.moves], strict=True):
        again = predict(each, sensors, exponent=exponent).array()
        np.testing.assert_allclose(again, sent, rtol=1e-6, atol=1e-6)
        offset = each[1:3] - sensors
        across = np.array([-each[4], each[3]])
        np.testing.assert_array_equal(np.sign(offset @ across), sides)
    assert np.abs(found.theta - theta).max(axis=1).min() < 1e-5 * (1.0 + np.abs(theta).max())


def test_equal_messages_have_two_passes_of_infinite_speed_between_equal_sensors():
    same = Profile(1.0, 5.0, 3.0)
    found = pair_passes(same, same, np.array([[0.0, 0.0], [2.0, 0.0]]))
    np.testing.assert_array_equal(found.moves, [True, True, False, False])
    np.testing.assert_array_equal(found.theta[2:], 0.0)
    assert np.isfinite(found.theta).all()


@pytest.mark.parametrize("psi", [(0.0, 1.0, 1.0), (1.0, 1.0, 0.0), (1.0, np.nan, 1.0)])
def test_a_pair_of_nothing_is_refused(psi):
    with pytest.raises(InputError, match="pair"):
        pair_passes(Profile(*psi), Profile(1.0, 2.0, 3.0), LAYOUT[:2])


def lifted(given_messages, *, order=None):
    n = len(given_messages.profiles)
    exponent = given_messages.models[0].exponent
    total = pass_lifted.empty(given_messages.sensors.mean(axis=0), time_s=12.0)
    J = fishers(given_messages)
    for k in range(n) if order is None else order:
        psi = Profile(*given_messages.profiles[k])
        total = total.added(psi, J[k], given_messages.sensors[k], exponent=exponent)
    return total


@given(seeds, exponents, st.integers(3, 12))
@settings(max_examples=40)
def test_the_lifted_solution_is_exact_without_noise(seed, exponent, n):
    rng = np.random.default_rng(seed)
    sent = messages(n, model=AmplitudeModel(exponent=exponent, sigma=0.1))
    found = lifted(sent, order=rng.permutation(n)).solved(exponent=exponent)
    assert found.determined
    assert found.rank == (7 if n == 3 else 8)
    np.testing.assert_allclose(found.theta, PASS, rtol=1e-5)


def test_the_lifted_solution_is_weighted_least_squares_on_the_quadratics():
    noisy = drawn(np.random.default_rng(2), n=6)
    rows, right = [], []
    for psi, J, (x, y) in zip(noisy.profiles, fishers(noisy), noisy.sensors, strict=True):

        def quadratic(p):
            a, t, w = p[0], p[1] - 12.0, p[2]
            return np.array([1.0 + 3.0 * (t / w) ** 2, -6.0 * t / w**2, 3.0 / w**2]) / a**2

        slopes = np.array(
            [approx_fprime(psi, lambda p, i=i: quadratic(p)[i], 1e-7) for i in range(3)]
        )
        inverse = np.linalg.inv(slopes)
        root = np.linalg.cholesky(inverse.T @ J @ inverse).T
        H = np.zeros((3, 8))
        H[0, :4] = x**2 + y**2, -2 * x, -2 * y, 1
        H[1, 4:7] = -2 * x, -2 * y, 2
        H[2, 7] = 1
        rows.append(root @ H)
        right.append(root @ quadratic(psi))
    z = np.linalg.lstsq(np.vstack(rows), np.hstack(right), rcond=None)[0]
    v = z[4:6] / z[0]
    found = lifted(noisy).solved()
    np.testing.assert_allclose(found.theta, [1 / z[0], *(z[1:3] / z[0] - 12.0 * v), *v], rtol=1e-3)


def test_sensors_in_a_line_are_told():
    line = np.column_stack([np.linspace(-1, 1, 6), np.linspace(-0.5, 0.5, 6)])
    found = lifted(messages(sensors=line)).solved()
    assert not found.determined
    assert found.rank == 6
    np.testing.assert_array_equal(found.theta, 0.0)
    two = lifted(messages(2)).solved()
    assert not two.determined
    assert two.rank < found.rank + 1


def test_a_message_of_nothing_cannot_be_added():
    with pytest.raises(InputError, match="a_max"):
        pass_lifted.empty(np.zeros(2)).added(Profile(0.0, 1.0, 1.0), np.eye(3), np.zeros(2))


@pytest.mark.parametrize("fading", ["none", "rayleigh"])
@pytest.mark.parametrize("unknown", [False, True])
def test_the_information_is_that_of_the_slopes_of_all_samples(fading, unknown):
    model = AmplitudeModel(exponent=1.4, sigma=0.2, fading=fading)
    sensors = LAYOUT[:4]

    def means(x):
        path = x[1:3] + TIMES[:, None] * x[3:5]
        told = AmplitudeModel(exponent=x[5])
        return amplitude.expected(told, sensors, positions=path, power=x[0]).ravel()

    x = np.array([*PASS, 1.4])
    G = np.array([approx_fprime(x, lambda p, i=i: means(p)[i], 1e-7) for i in range(4 * 25)])
    a = means(x)
    weight = 1 / 0.04 if fading == "none" else (2 * a / (0.04 + a**2)) ** 2
    size = 6 if unknown else 5
    J = (G.T @ (G * np.broadcast_to(weight, a.shape)[:, None]))[:size, :size]
    found = pass_bounds.pass_information(
        PASS, sensors, TIMES, models=model, unknown_exponent=unknown
    )
    np.testing.assert_allclose(found, J, rtol=1e-3, atol=1e-4 * np.abs(J).max())


@given(seeds)
@settings(max_examples=30)
def test_messages_lose_nothing_until_errors_are_added(seed):
    rng, theta = random_pass(seed)
    sensors = rng.normal(size=(5, 2)) * 2.0
    t_s = np.linspace(-5, 5, 40)
    all_samples = pass_bounds.pass_bound(theta, sensors, t_s, models=QUIET)
    told = pass_bounds.message_bound(theta, sensors, t_s, models=QUIET)
    np.testing.assert_allclose(told.covariance, all_samples.covariance, rtol=1e-4)
    worse = pass_bounds.message_bound(
        theta, sensors, t_s, models=QUIET, added=np.tile(0.01 * np.eye(3), (5, 1, 1))
    )
    assert (np.diag(worse.covariance) >= np.diag(told.covariance) * (1 - 1e-9)).all()


def test_the_slopes_of_messages_are_those_of_the_prediction():
    G = pass_bounds.message_slopes(PASS, LAYOUT[:6], exponent=1.3)
    for k in range(6):
        for i in range(3):
            slope = approx_fprime(
                PASS, lambda x, k=k, i=i: predict(x, LAYOUT[:6], exponent=1.3).array()[k, i], 1e-8
            )
            np.testing.assert_allclose(G[k, i], slope, rtol=1e-4, atol=1e-4)


def test_a_target_at_rest_has_no_message_bound_and_one_sensor_no_bound():
    with pytest.raises(InputError, match="rest"):
        pass_bounds.message_slopes(np.array([1.0, 0.0, 0.0, 0.0, 0.0]), LAYOUT[:3])
    assert not pass_bounds.pass_bound(PASS, LAYOUT[:1], TIMES, models=NOISY).determined
    with pytest.raises(InputError, match="expected"):
        pass_bounds.pass_bound(PASS[:4], LAYOUT, TIMES, models=NOISY)


def test_the_kernel_refuses_arrays_that_do_not_go_together():
    with pytest.raises(ValueError, match="expected"):
        _passes.modes(
            LAYOUT[:3],
            np.zeros((2, 3)),
            np.zeros((3, 7)),
            np.zeros((0, 3, 3)),
            np.zeros((0, 3, 3)),
            *(1.0, 0.0, 4, 6),
        )
