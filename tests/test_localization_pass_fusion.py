"""Fusion of energy messages: SciPy as oracle, symmetries, ambiguity told, honest covariances."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.stats import chi2

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
from trackfield.sensing.energy_message import (
    EnergyMessageModel,
    amplitude_model,
    decode,
    encode,
)
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile_fit import fit

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


def test_times_since_1970_cost_no_digits():
    late = 1.76e9
    exact = messages(6)
    then = exact._replace(
        profiles=exact.profiles + np.array([0.0, late, 0.0]),
        records=common_records(6, late + TIMES),
        start_s=late,
    )
    np.testing.assert_allclose(fuse(then).theta[0], PASS, rtol=1e-5)
    with pytest.raises(InputError, match="message 0"):
        fuse(then._replace(start_s=0.0))


def test_a_crowd_of_sensors_is_fused_in_bounded_time():
    rng = np.random.default_rng(13)
    sensors = rng.uniform(-2, 2, (300, 2))
    mean = profiles.expected(predict(PASS, sensors), TIMES)
    told = fit(NOISY, TIMES, mean + NOISY.sigma * rng.standard_normal(mean.shape)).profile
    crowd = messages(sensors=sensors, model=NOISY)._replace(profiles=told.array())
    before = time.process_time()
    found = fuse(crowd, settings=PassSettings(starts="all"))
    assert time.process_time() - before < 5.0
    off = found.theta[0] - PASS
    assert off @ np.linalg.solve(found.covariance[0], off) < 20.0
    assert found.verdict == PassVerdict.GOOD


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


@given(seeds)
@settings(max_examples=60)
def test_messages_at_random_give_no_confident_answer_that_they_contradict(seed):
    """Finite numbers always; and what is called good explains every message."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    psi = np.exp(rng.normal([0.0, 2.0, 1.5], [1.5, 1.5, 1.2], (n, 3))) * [1, rng.choice([-1, 1]), 1]
    psi[rng.random(n) < 0.1, rng.integers(0, 3)] = 0.0
    model = (QUIET, NOISY, RAYLEIGH)[seed % 3]
    junk = messages(n, model=model, sensors=rng.uniform(-2, 2, (n, 2)))._replace(profiles=psi)
    found = fuse(junk)
    for part in found[:-1]:
        assert np.isfinite(part).all()
    for covariance in found.covariance:
        assert np.linalg.eigvalsh(covariance / np.trace(covariance)).min() > -1e-9
    if len(found.weight):
        assert found.weight.sum() == pytest.approx(1.0)
        assert (np.diff(found.weight) <= 0.0).all()
    if found.verdict in (PassVerdict.GOOD, PassVerdict.AMBIGUOUS):
        explained = (roots(found.theta[0], junk) ** 2).sum()
        assert explained < chi2.isf(1e-6, 3 * n - 5) + 12.0 * n
        assert found.gain[0] > 12.0


def test_noise_alone_is_told_as_nothing():
    rng, verdicts = np.random.default_rng(4), []
    for n in (3, 5, 10, 20) * 5:
        records = 0.3 * rng.standard_normal((n, 25))
        profile = fit(AmplitudeModel(sigma=0.3), TIMES, records).profile
        noise = messages(n, model=AmplitudeModel(sigma=0.3))._replace(profiles=profile.array())
        verdicts.append(fuse(noise).verdict)
    assert set(verdicts) == {PassVerdict.NOTHING}


def test_a_target_at_rest_is_not_told_to_pass():
    rng = np.random.default_rng(5)
    r = np.linalg.norm(LAYOUT[:6] - [0.1, 0.2], axis=1)
    records = 1.0 / r[:, None] + QUIET.sigma * rng.standard_normal((6, 25))
    profile = fit(QUIET, TIMES, records).profile
    found = fuse(messages(6)._replace(profiles=profile.array()))
    assert found.verdict in (PassVerdict.UNCERTAIN, PassVerdict.CONTRADICTORY)


def test_identical_messages_of_sensors_apart_contradict_each_other():
    found = fuse(messages(5)._replace(profiles=np.tile([1.0, 12.0, 5.0], (5, 1))))
    assert found.verdict == PassVerdict.CONTRADICTORY


def test_sensors_at_one_place_are_one_sensor():
    assert fuse(messages(sensors=np.tile(LAYOUT[2], (4, 1)))).verdict == PassVerdict.NOTHING
    two = fuse(messages(sensors=LAYOUT[[2, 2, 0, 0]]))
    assert two.verdict == PassVerdict.TOO_FEW
    assert len(two.theta) == 4


def test_a_target_through_two_sensors_is_not_called_good():
    on_the_way = PASS[1:3] + np.outer([10.0, 15.0], PASS[3:])
    found = fuse(messages(sensors=np.vstack([on_the_way, LAYOUT[2:4]])))
    assert found.verdict != PassVerdict.GOOD
    assert np.isfinite(found.covariance).all()
    np.testing.assert_allclose(found.theta[0], PASS, atol=0.02)


@pytest.mark.parametrize("saturation", [np.inf, 1.5])
def test_clipped_amplitudes_lead_to_the_same_trajectory(saturation):
    rng, nees = np.random.default_rng(9), []
    model = AmplitudeModel(sigma=QUIET.sigma, saturation=saturation)
    mean = profiles.expected(predict(PASS, LAYOUT[:8]), TIMES)
    for _ in range(40):
        samples = np.minimum(mean + model.sigma * rng.standard_normal(mean.shape), saturation)
        told = messages(8, model=model)._replace(
            profiles=fit(model, TIMES, samples).profile.array()
        )
        found = fuse(told)
        assert found.verdict == PassVerdict.GOOD
        off = found.theta[0] - PASS
        nees.append(off @ np.linalg.solve(found.covariance[0], off) / 5)
    assert 0.7 < np.mean(nees) < 1.4


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_rounding_is_a_covariance_of_the_told_samples(exponent):
    """Against the dense Gaussian sigma^2 I + G A G', sensor by sensor, by SciPy."""
    model = AmplitudeModel(exponent=exponent, sigma=QUIET.sigma)
    noisy = drawn(np.random.default_rng(10), n=6, model=model)
    A = np.diag([0.02, 0.3, 0.2]) ** 2 + 1e-4
    rounded = noisy._replace(rounding=np.tile(A, (6, 1, 1)))
    psi = profiles.profile_of(noisy.profiles)
    G = profiles.gradient(psi, TIMES, exponent=exponent)
    dense = model.sigma**2 * np.eye(25) + G @ A @ np.swapaxes(G, 1, 2)
    half = np.swapaxes(np.linalg.cholesky(np.linalg.inv(dense)), 1, 2)
    told = profiles.expected(psi, TIMES, exponent=exponent)

    def whitened(theta):
        laid = profiles.expected(
            predict(theta, LAYOUT[:6], exponent=exponent), TIMES, exponent=exponent
        )
        return (half @ (laid - told)[..., None]).ravel()

    oracle = least_squares(whitened, PASS, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-14)
    found = fuse(rounded)
    np.testing.assert_allclose(found.theta[0], oracle.x, rtol=1e-3, atol=1e-4)
    assert found.deviance[0].sum() == pytest.approx(2.0 * oracle.cost, rel=1e-5)
    np.testing.assert_allclose(
        found.covariance[0], np.linalg.inv(oracle.jac.T @ oracle.jac), rtol=2e-2, atol=1e-6
    )


def test_coarse_code_words_are_believed_as_far_as_they_deserve():
    rng, nees = np.random.default_rng(11), []
    coarse = EnergyMessageModel(sigma=0.01, sample_s=1.0, record_s=24.0, bits=7)
    model = amplitude_model(coarse)
    for _ in range(40):
        theta = PASS * (1.0 + 0.05 * rng.standard_normal(5))
        exact = drawn(rng, n=6, theta=theta, model=model)
        words = encode(coarse, profiles.profile_of(exact.profiles), end_s=24.0)
        decoded = decode(coarse, words, end_s=24.0)
        told = exact._replace(profiles=decoded.profile.array(), rounding=decoded.covariance)
        found = fuse(told)
        assert found.verdict == PassVerdict.GOOD
        off = found.theta[0] - theta
        nees.append(off @ np.linalg.solve(found.covariance[0], off) / 5)
        assert fuse(told._replace(rounding=None)).verdict == PassVerdict.CONTRADICTORY
    assert 0.7 < np.mean(nees) < 1.4


def test_rounding_counts_in_paper_mode_and_with_an_unknown_exponent():
    noisy = drawn(np.random.default_rng(12), n=6)
    rounded = noisy._replace(rounding=np.tile(np.diag([0.1, 1.0, 1.0]) ** 2, (6, 1, 1)))
    J, fewer = fishers(noisy), fishers(rounded)
    np.testing.assert_allclose(
        np.linalg.inv(fewer) - np.linalg.inv(J), rounded.rounding, rtol=1e-6, atol=1e-6
    )
    free = PassSettings(exponent_sigma=0.3)
    wide, narrow = fuse(rounded, settings=free), fuse(noisy, settings=free)
    assert (np.diag(wide.covariance[0]) > np.diag(narrow.covariance[0])).all()
    with pytest.raises(InputError, match="rounding"):
        fuse(noisy._replace(rounding=np.zeros((5, 3, 3))))


def test_one_message_that_lies_is_noticed():
    exact = messages(6)
    exact.profiles[2, 1] += 5.0
    assert fuse(exact).verdict == PassVerdict.CONTRADICTORY


def test_a_sensor_that_heard_nothing_tells_where_the_target_did_not_pass():
    """Of four trajectories two sensors leave, the silent ones rule out those that pass them."""
    four = fuse(messages(2))
    silent = messages(5)
    silent.profiles[2:] = 0.0
    silent = silent._replace(sensors=np.vstack([LAYOUT[:2], np.tile(four.theta[0, 1:3], (3, 1))]))
    assert len(fuse(silent).theta) < 4


@pytest.mark.parametrize("clock_sigma_s", [0.5, 2.0])
def test_clocks_are_found_along_with_the_trajectory(clock_sigma_s):
    rng = np.random.default_rng(6)
    doubtful = AmplitudeModel(sigma=QUIET.sigma, clock_sigma_s=clock_sigma_s)
    believed, nees, errors, none = [], [], [], []
    for _ in range(40):
        noisy = drawn(rng, n=8)
        ahead = clock_sigma_s * rng.standard_normal(8)
        noisy.profiles[:, 1] += ahead
        found = fuse(noisy._replace(models=(doubtful,) * 8))
        off = found.theta[0] - PASS
        nees.append(off @ np.linalg.solve(found.covariance[0], off) / 5)
        believed.append(found.verdict)
        errors.append(off)
        none.append(fuse(noisy).theta[0] - PASS)
        assert np.corrcoef(found.ahead_s[0], ahead)[0, 1] > 0.5
    assert 0.7 < np.mean(nees) < 1.4
    assert np.std(errors, axis=0)[1] < 0.8 * np.std(none, axis=0)[1]
    assert believed.count(PassVerdict.GOOD) >= 38


def test_an_unknown_exponent_is_estimated_with_an_honest_covariance():
    rng, off = np.random.default_rng(7), []
    for _ in range(40):
        noisy = drawn(rng, n=8, model=AmplitudeModel(exponent=1.3, sigma=QUIET.sigma))
        thought = noisy._replace(models=(QUIET,) * 8)
        found = fuse(thought, settings=PassSettings(exponent_sigma=0.4))
        error = np.append(found.theta[0] - PASS, found.exponent[0] - 1.3)
        off.append(error @ np.linalg.solve(found.covariance[0], error) / 6)
        assert found.exponent[0] == pytest.approx(1.3, abs=0.1)
    assert 0.6 < np.mean(off) < 1.5


def test_slopes_with_clocks_and_exponent_lead_to_the_same_minimum_from_all_starts():
    noisy = drawn(np.random.default_rng(8), n=6)
    doubtful = (AmplitudeModel(sigma=QUIET.sigma, clock_sigma_s=0.3),) * 6
    chosen = PassSettings(exponent_sigma=0.2, starts="all", searches=30)
    a = fuse(noisy._replace(models=doubtful), settings=chosen)
    b = fuse(noisy._replace(models=doubtful), settings=PassSettings(exponent_sigma=0.2))
    assert a.converged[0]
    np.testing.assert_allclose(a.theta[0], b.theta[0], rtol=1e-3)


def test_fishers_of_silence_are_zero_and_those_of_the_paper_checked():
    silent = messages(3)
    silent.profiles[1] = 0.0
    J = fishers(silent)
    np.testing.assert_array_equal(J[1], 0.0)
    assert (np.linalg.eigvalsh(J[[0, 2]]) > 0.0).all()
    with pytest.raises(InputError, match="fishers"):
        fuse_as_printed(messages(3), J[:2])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"sensors": LAYOUT[:2]}, "sensors"),
        ({"sensors": np.full((3, 2), np.inf)}, "sensor 0"),
        ({"profiles": -np.ones((3, 3))}, "negative"),
        ({"models": (QUIET,) * 2}, "models"),
        ({"models": (QUIET, QUIET, AmplitudeModel(exponent=2.0))}, "exponents"),
    ],
)
def test_what_is_no_set_of_messages_is_refused(change, match):
    with pytest.raises(InputError, match=match):
        fuse(messages(3)._replace(**change))


@pytest.mark.parametrize(
    ("column", "value", "match"),
    [("step_s", 0.0, "steps"), ("samples", 0.0, "sample"), ("samples", 1e7, "at most")],
)
def test_records_that_cannot_be_are_refused(column, value, match):
    exact = messages(3)
    getattr(exact.records, column)[1] = value
    with pytest.raises(InputError, match=match):
        fuse(exact)


def test_settings_and_times_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="exponent_sigma"):
        fuse(messages(3), settings=PassSettings(exponent_sigma=-1.0))
    with pytest.raises(InputError, match="evenly"):
        common_records(3, np.array([0.0, 1.0, 3.0]))
    assert common_records(2, np.array([4.0])).step_s.tolist() == [1.0, 1.0]


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
