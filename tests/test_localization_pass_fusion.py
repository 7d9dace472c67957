"""Fusion of energy messages: SciPy as oracle, symmetries, ambiguity told, honest covariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from pass_scene import LAYOUT, NOISY, PASS, QUIET, TIMES, drawn, messages
from trackfield.errors import InputError
from trackfield.localization.pass_bounds import pass_information
from trackfield.localization.pass_fusion import (
    PASS_REASONS,
    PassSettings,
    PassVerdict,
    fuse,
    fuse_as_printed,
)
from trackfield.localization.pass_messages import common_records, fishers
from trackfield.sensing import profile as profiles
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.pass_profile import predict

seeds = st.integers(0, 2**32 - 1)
RAYLEIGH = AmplitudeModel(sigma=0.3, fading="rayleigh")


def roots(theta, given_messages):
    """Signed roots (n, m) of the squared misfits, sample by sample, in plain NumPy."""
    model = given_messages.models[0]
    a = profiles.expected(profiles.profile_of(given_messages.profiles), TIMES)
    b = profiles.expected(predict(theta, given_messages.sensors), TIMES)
    if model.fading == "none":
        return (b - a) / model.sigma
    ratio = (model.sigma**2 + a**2) / (model.sigma**2 + b**2)
    return np.sign(b - a) * np.sqrt(2.0 * (ratio - 1.0 - np.log(ratio)))


def minimum(given_messages):
    """Theta of least deviance near `PASS`, by SciPy without our slopes."""

    def of(theta):
        return roots(theta, given_messages).ravel()

    found = least_squares(of, PASS, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-14)
    return found.x, 2.0 * found.cost


@pytest.mark.parametrize("model", [NOISY, QUIET, RAYLEIGH], ids=["10 dB", "25 dB", "rayleigh"])
@pytest.mark.parametrize("seed", range(3))
def test_the_best_trajectory_is_the_least_deviance_that_scipy_finds(model, seed):
    noisy = drawn(np.random.default_rng(seed), model=model)
    found = fuse(noisy)
    theta, least = minimum(noisy)
    best = int(np.argmin(found.deviance.sum(axis=1)))
    assert found.deviance[best].sum() <= least * (1 + 1e-6) + 1e-6
    deviance = (roots(found.theta[best], noisy) ** 2).sum(axis=1)
    np.testing.assert_allclose(found.deviance[best], deviance, rtol=1e-6)
    J = np.linalg.inv(found.covariance[best])
    away = found.theta[best] - theta
    assert away @ J @ away < 1e-2


def test_the_covariance_is_the_inverse_fisher_matrix_at_the_fused_trajectory():
    found = fuse(drawn(np.random.default_rng(1)))
    for theta, covariance in zip(found.theta, found.covariance, strict=True):
        J = pass_information(theta, LAYOUT[:5], TIMES, models=QUIET)
        np.testing.assert_allclose(covariance, np.linalg.inv(J), rtol=1e-6)


@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("n", [3, 4, 8, 20])
def test_messages_without_noise_give_the_truth(exponent, n):
    model = AmplitudeModel(exponent=exponent, sigma=0.01)
    for found in (fuse(messages(n, model=model)), fuse_printed(messages(n, model=model))):
        np.testing.assert_allclose(found.theta[0], PASS, rtol=1e-4)


def fuse_printed(given_messages):
    return fuse_as_printed(given_messages, fishers(given_messages))


def test_paper_mode_is_the_minimum_of_berger_18():
    noisy = drawn(np.random.default_rng(3))
    J = fishers(noisy)
    half = np.swapaxes(np.linalg.cholesky(J), 1, 2)

    def whitened(theta):
        off = noisy.profiles - predict(theta, noisy.sensors).array()
        return (half @ off[..., None]).ravel()

    oracle = least_squares(whitened, PASS, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12)
    found = fuse_as_printed(noisy, J)
    np.testing.assert_allclose(found.theta[0], oracle.x, rtol=1e-4)
    assert found.deviance[0].sum() == pytest.approx(2.0 * oracle.cost, rel=1e-6)
    assert len(found.theta) == 1


@given(seeds)
@settings(max_examples=20)
def test_turning_moving_and_scaling_the_world_does_so_to_the_result(seed):
    rng = np.random.default_rng(seed)
    noisy = drawn(rng)
    angle, shift, late = rng.uniform(0, 6), rng.normal(size=2) * 5.0, rng.uniform(-1e5, 1e5)
    length, time = np.exp(rng.uniform(-5, 5, 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = noisy._replace(
        sensors=length * (noisy.sensors @ turn.T + shift),
        profiles=noisy.profiles * [1.0, time, time] + [0.0, late, 0.0],
        records=common_records(5, late + time * TIMES),
        start_s=late,
    )
    a, b = fuse(noisy), fuse(moved)
    assert a.verdict == b.verdict
    P, x0, v = a.theta[0, 0], a.theta[0, 1:3], a.theta[0, 3:]
    other = [P * length**2, *(length * (turn @ x0 + shift)), *(length / time * (turn @ v))]
    np.testing.assert_allclose(b.theta[0], other, rtol=1e-3, atol=1e-3 * length)


def test_sensors_in_a_line_keep_the_mirror_image():
    line = np.column_stack([np.linspace(-1.5, 1.5, 7), np.zeros(7)])
    found = fuse(messages(sensors=line))
    assert found.verdict == PassVerdict.AMBIGUOUS
    np.testing.assert_allclose(found.weight, [0.5, 0.5], atol=1e-6)
    np.testing.assert_allclose(np.abs(found.theta), np.abs([PASS, PASS]), rtol=1e-5)
    assert found.theta[0, 2] == pytest.approx(-found.theta[1, 2], rel=1e-5)


def test_two_sensors_leave_four_trajectories():
    found = fuse(messages(2))
    assert found.verdict == PassVerdict.TOO_FEW
    assert len(found.theta) == 4
    assert np.abs(found.theta - PASS).max(axis=1).min() < 1e-5


def test_every_verdict_has_its_reason():
    assert set(PASS_REASONS) == set(PassVerdict)


@pytest.mark.parametrize("n", [0, 1])
def test_nothing_comes_of_nothing(n):
    found = fuse(messages(n))
    assert found.verdict == PassVerdict.NOTHING
    assert found.theta.shape == (0, 5)
    assert found.deviance.shape == (0, n)


@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_message_that_is_not_finite_is_refused(column):
    bad = messages(3)
    bad.profiles[1, column] = np.nan
    with pytest.raises(InputError, match="message 1"):
        fuse(bad)


def test_settings_reach_all_pairs():
    noisy = drawn(np.random.default_rng(5), n=8, model=NOISY)
    a, b = fuse(noisy), fuse(noisy, settings=PassSettings(starts="all"))
    np.testing.assert_allclose(a.theta[0], b.theta[0], rtol=1e-3, atol=1e-3)
