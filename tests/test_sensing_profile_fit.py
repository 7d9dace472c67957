"""Fits of a pass: the likeliest profile, as good as the bound, flagged where it is worth less."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize

from trackfield.errors import InputError
from trackfield.sensing import amplitude, profile
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.amplitude_likelihood import misfit
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import Profile, profile_of
from trackfield.sensing.profile_fit import QUALITY_REASONS, FitLimits, Quality, fit

T = np.arange(25.0)
SENSORS = np.array([[-1.2, 0.8], [0.95, -0.85], [0.25, 0.45]])
SEEN = predict(np.array([1.0, -2.4, -0.5, 0.196, 0.04]), SENSORS)
PLAIN = AmplitudeModel(sigma=10**-0.5)  # 10 dB at the distance where the power is told
FADING = replace(PLAIN, fading="rayleigh")
MODELS = [PLAIN, FADING, replace(PLAIN, saturation=0.8), replace(FADING, saturation=0.8)]
seeds = st.integers(0, 2**32 - 1)


def some(rng, *shape):
    return Profile(
        rng.uniform(0.5, 3, shape), rng.uniform(3, 21, shape), rng.uniform(1.5, 8, shape)
    )


def drawn(model, at, t_s, rng):
    return amplitude.noisy(model, profile.expected(at, t_s, exponent=model.exponent), rng=rng)


def repeated(at, runs):
    return Profile(*(np.broadcast_to(part, (runs,)) for part in at))


@given(seeds, st.floats(0.6, 3.5))
def test_samples_without_noise_give_back_their_profile(seed, exponent):
    rng = np.random.default_rng(seed)
    at = some(rng, 3)
    values = profile.expected(at, T, exponent=exponent)
    found = fit(AmplitudeModel(exponent, sigma=1e-3), T, values)
    np.testing.assert_allclose(found.profile.array(), at.array(), rtol=1e-6)
    assert (found.quality == Quality.GOOD).all()


@given(seeds, st.floats(0.01, 100.0), st.floats(0.01, 100.0), st.floats(-1e4, 1e4))
def test_units_and_the_origin_of_time_do_not_matter(seed, unit, second, origin):
    rng = np.random.default_rng(seed)
    values = drawn(PLAIN, some(rng, 4), T, rng)
    one = fit(PLAIN, T, values)
    scaled = replace(PLAIN, sigma=unit * PLAIN.sigma)
    other = fit(scaled, origin + second * T, unit * values)
    a, t_max, width = (part[one.gain > 20.0] for part in other.profile)
    back = np.stack([a / unit, (t_max - origin) / second, width / second], -1)
    np.testing.assert_allclose(back, one.profile.array()[one.gain > 20.0], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("model", MODELS)
def test_no_search_by_scipy_finds_a_likelier_profile(model):
    rng = np.random.default_rng(11)
    values = drawn(model, some(rng, 3), T, rng)
    found = fit(model, T, values)
    for z, cost in zip(values, -found.log_likelihood, strict=True):

        def nll(x, z=z):
            at = Profile(math.exp(x[0]), x[1], math.exp(x[2]))
            return float(profile.negative_log_likelihood(at, T, z, models=model))

        starts = [(0.0, t, math.log(w)) for t in (4.0, 12.0, 20.0) for w in (2, 8)]
        bounds = [(-6.0, 5.0), (0.0, 24.0), (math.log(0.25), math.log(36.0))]
        best = min(optimize.minimize(nll, x, bounds=bounds).fun for x in starts)
        assert cost < best + 1e-4


@pytest.mark.parametrize("model", MODELS)
def test_at_the_fit_the_score_is_zero_and_the_numbers_are_those_of_the_profile(model):
    rng = np.random.default_rng(12)
    values = drawn(model, some(rng, 40), T, rng)
    found = fit(model, T, values)
    inside = (found.quality <= Quality.CLIPPED) & (found.profile.width_s > 0.3)
    inside &= (found.profile.a_max < 20.0) & (np.abs(found.profile.t_max_s - 12.0) < 12.0)
    assert inside.sum() > 15
    mean = profile.expected(found.profile, T, exponent=model.exponent)
    G = profile.gradient(found.profile, T, exponent=model.exponent)
    score = np.sum(misfit(model, values, mean=mean).slope[..., None] * G, axis=-2)
    size = np.sqrt(np.diagonal(found.information, axis1=-2, axis2=-1))
    assert np.abs(score / size)[inside].max() < 1e-3
    np.testing.assert_allclose(found.information, profile.information(found.profile, T, model))

    cost = profile.negative_log_likelihood(found.profile, T, values, models=model)
    np.testing.assert_allclose(found.log_likelihood, -cost, rtol=1e-9, atol=1e-9)
    nothing = misfit(model, values, mean=np.zeros(values.shape)).cost.sum(axis=-1)
    np.testing.assert_allclose(found.gain, nothing - cost, rtol=1e-8, atol=1e-8)
    levels = np.linspace(0.01, 3.0, 600)
    constant = [misfit(model, values, mean=np.full((1, 25), a)).cost.sum(axis=-1) for a in levels]
    np.testing.assert_allclose(found.gain_of_change, np.min(constant, axis=0) - cost, atol=0.02)


@pytest.mark.parametrize(("model", "steps"), [(PLAIN, 3.7), (FADING, 6.5)])
def test_the_search_ends_in_a_few_steps_as_newtons_does(model, steps):
    model, rng = replace(model, sigma=0.03), np.random.default_rng(14)
    found = fit(model, T, drawn(model, some(rng, 500), T, rng), starts="paper")
    assert found.iterations.mean() < steps
    assert found.iterations.min() >= 1


@pytest.mark.parametrize("model", [PLAIN, FADING])
def test_the_papers_start_alone_is_never_better_and_worse_on_some_weak_records(model):
    rng = np.random.default_rng(13)
    at = Profile(rng.uniform(0.5, 2, 1500), rng.uniform(0, 24, 1500), rng.uniform(0.5, 15, 1500))
    values = drawn(replace(model, sigma=0.5), at, T, rng)
    both = (fit(replace(model, sigma=0.5), T, values, starts=s) for s in ("grid", "paper"))
    lost = np.subtract(*(found.log_likelihood for found in both))
    assert lost.min() > -1e-6
    assert 0.005 < (lost > 0.5).mean() < 0.1


@pytest.mark.parametrize(
    ("model", "rate_hz", "bound"),
    [
        (PLAIN, 1.0, 1.6),  # here the bound is too low for sensors 1 and 2: one fit in 30 is astray
        (replace(PLAIN, sigma=0.1), 1.0, 1.15),
        (replace(PLAIN, sigma=0.01), 1.0, 1.1),
        (replace(FADING, sigma=0.1), 2.0, 1.4),
        (FADING, 10.0, 1.15),
    ],
)
def test_errors_are_those_of_the_bound(model, rate_hz, bound):
    t_s = np.arange(24 * rate_hz + 1) / rate_hz
    truth = SEEN.array()
    deviation = np.sqrt(
        np.diagonal(np.linalg.inv(profile.information(SEEN, t_s, model)), axis1=-2, axis2=-1)
    )
    mean = profile.expected(SEEN, t_s)
    values = amplitude.noisy(
        model, np.broadcast_to(mean, (500, *mean.shape)), rng=np.random.default_rng(21)
    )
    found = fit(model, t_s, values)
    error = (found.profile.array() - truth) / deviation
    ratio = np.sqrt((error**2).mean(axis=0))
    assert ratio.max() < bound
    assert ratio.min() > 0.85
    np.testing.assert_allclose(np.median(np.abs(error), axis=0), 0.6745, rtol=0.25)


@pytest.mark.parametrize(("model", "tolerance"), [(PLAIN, 0.12), (FADING, 0.25)])
def test_information_at_the_estimate_tells_how_far_it_is_off(model, tolerance):
    rng = np.random.default_rng(22)
    t_s = np.arange(0, 24.01, 0.1)
    at = repeated(Profile(2.5, 13.9, 3.5), 1000)
    found = fit(model, t_s, drawn(model, at, t_s, rng))
    error = found.profile.array() - at.array()
    distance2 = np.einsum("...i,...ij,...j", error, found.information, error)
    assert distance2.mean() == pytest.approx(3.0, rel=tolerance)


@pytest.mark.parametrize("model", [PLAIN, FADING])
@pytest.mark.parametrize("m", [10, 25, 100])
def test_noise_and_what_does_not_change_are_seldom_taken_for_a_pass(model, m):
    rng = np.random.default_rng(23)
    quiet = amplitude.noisy(model, np.zeros((1000, m)), rng=rng)
    found = fit(model, np.arange(float(m)), quiet)
    assert (found.quality != Quality.EMPTY).mean() < 0.015
    steady = amplitude.noisy(model, np.full((1000, m), 20 * model.sigma), rng=rng)
    found = fit(model, np.arange(float(m)), steady)
    assert (found.quality != Quality.FLAT).mean() < 0.02


def test_a_pass_that_ends_before_or_begins_after_the_record_is_said_to():
    at = Profile(np.array([3.0, 3.0, 3.0]), np.array([-2.0, 12.0, 26.0]), np.full(3, 5.0))
    values = drawn(replace(PLAIN, sigma=0.01), at, T, np.random.default_rng(1))
    found = fit(replace(PLAIN, sigma=0.01), T, values)
    assert found.quality.tolist() == [Quality.NOT_PASSED, Quality.GOOD, Quality.NOT_PASSED]
    error = (found.profile.array() - at.array()) / at.array()
    assert np.abs(error).max() < 0.2  # with so little noise a tail tells the rest


def test_clipped_samples_count_as_at_least_and_are_told():
    model = replace(PLAIN, sigma=0.05, saturation=1.0)
    at = repeated(Profile(2.0, 11.7, 4.0), 300)
    values = drawn(model, at, T, np.random.default_rng(2))
    found, naive = fit(model, T, values), fit(replace(model, saturation=math.inf), T, values)
    assert (found.quality == Quality.CLIPPED).all()
    deviation = np.sqrt(
        np.diag(np.linalg.inv(profile.information(Profile(2.0, 11.7, 4.0), T, model)))
    )
    error = found.profile.array() - at.array()
    np.testing.assert_allclose(np.median(np.abs(error), axis=0) / deviation, 0.6745, rtol=0.2)
    assert naive.profile.a_max.max() < 1.4


def test_a_record_that_is_all_clipped_is_finite_and_told():
    for model in (replace(PLAIN, saturation=1.0), replace(FADING, saturation=1.0)):
        found = fit(model, T, np.ones(25))
        assert found.quality == Quality.CLIPPED
        assert np.isfinite(found.profile.array()).all()
        assert np.isfinite(found.information).all()


@pytest.mark.parametrize(("fading", "power"), [("none", 0.95), ("rayleigh", 0.7)])
def test_two_sources_in_one_record_are_no_pass(fading, power):
    model = replace(PLAIN, sigma=0.1, fading=fading)
    t_s, rng = np.arange(0, 24.01, 0.5), np.random.default_rng(3)
    two = [profile.expected(Profile(1.5, t, 1.5), t_s) for t in (6.0, 18.0)]
    both = np.broadcast_to(np.hypot(*two), (300, t_s.size))
    found = fit(model, t_s, amplitude.noisy(model, both, rng=rng))
    assert (found.quality == Quality.MISFIT).mean() > power
    one = np.broadcast_to(two[0], both.shape)
    found = fit(model, t_s, amplitude.noisy(model, one, rng=rng))
    assert (found.quality == Quality.MISFIT).mean() < 0.01


@pytest.mark.parametrize("m", [1, 2, 3])
def test_few_samples_are_told_to_be_few(m):
    found = fit(PLAIN, T[:m], np.linspace(1.0, 2.0, m))
    assert found.quality == Quality.TOO_FEW
    assert (found.profile.a_max, found.profile.t_max_s) == (
        (2.0, T[m - 1]) if m > 1 else (1.0, 0.0)
    )
    assert np.linalg.matrix_rank(found.information) <= m
    assert found.gain == found.gain_of_change == 0.0


@given(seeds, st.sampled_from(["none", "rayleigh"]), st.floats(0.3, 6.0))
def test_whatever_the_numbers_what_comes_back_is_finite(seed, fading, exponent):
    rng = np.random.default_rng(seed)
    t_s = rng.normal(0.0, 1e6) + np.cumsum(rng.uniform(0.01, 1.0, 20) ** rng.uniform(0.2, 4.0))
    sigma, top = 10 ** rng.uniform(-9, 6), 10 ** rng.uniform(-2, 8)
    values = sigma * 10 ** rng.uniform(-3, 9) * rng.standard_normal(20) * (rng.random(20) < 0.7)
    values = np.minimum(np.abs(values) if fading == "rayleigh" else values, sigma * top)
    found = fit(AmplitudeModel(exponent, sigma, fading, sigma * top), t_s, values)
    for part in (found.profile.array(), found.information, *found[2:5]):
        assert np.isfinite(part).all()
    length = t_s[-1] - t_s[0]
    assert t_s[0] - 0.11 * length < found.profile.t_max_s < t_s[-1] + 0.11 * length
    assert 0.0 < found.profile.width_s < 1.6 * length


def test_negative_amplitudes_are_noise_without_fading_only():
    assert fit(PLAIN, T, np.full(25, -0.1)).quality == Quality.EMPTY
    with pytest.raises(InputError, match="0 or more"):
        fit(FADING, T, np.full(25, -0.1))


@pytest.mark.parametrize(
    ("t_s", "values", "word"),
    [
        (T, np.full(25, math.nan), "finite"),
        (np.zeros(25), np.ones(25), "rise"),
        (T[::-1], np.ones(25), "rise"),
        (np.where(T == 3, math.nan, T), np.ones(25), "rise"),
        (T, np.ones(24), "shape"),
        (T[:0], np.ones(0), "shape"),
        (T, np.float64(1.0), "shape"),
    ],
)
def test_what_is_no_record_is_refused(t_s, values, word):
    with pytest.raises(InputError, match=word):
        fit(PLAIN, t_s, values)


def test_models_and_limits_without_sense_are_refused():
    with pytest.raises(InputError, match="sigma"):
        fit(replace(PLAIN, sigma=0.0), T, np.ones(25))
    for wrong in (FitLimits(margin=-1.0), FitLimits(narrowest=0.0), FitLimits(widest=1e-4)):
        with pytest.raises(InputError, match="limits"):
            fit(PLAIN, T, np.ones(25), limits=wrong)


def test_columns_and_own_clocks_give_what_each_record_gives_alone():
    rng = np.random.default_rng(4)
    models = [AmplitudeModel(e, s, saturation=c) for e, s, c in ((1, 0.1, 9.0), (2, 0.2, 1.0))]
    times = np.stack([T, 3.0 + 0.5 * T])
    at = some(rng, 3, 2)
    values = rng.normal(profile.expected(at, times, exponent=np.array([1.0, 2.0])), 0.1)
    values = np.minimum(values, np.array([9.0, 1.0])[:, None])
    table = amplitude.columns(models)
    whole = fit(table, np.broadcast_to(times, values.shape), values)
    for i, j in np.ndindex(3, 2):
        one = fit(models[j], times[j], values[i, j])
        assert whole.quality[i, j] == one.quality
        np.testing.assert_allclose(whole.profile.array()[i, j], one.profile.array(), rtol=1e-12)
        np.testing.assert_allclose(whole.information[i, j], one.information, rtol=1e-12)
    assert profile_of(whole.profile.array()).a_max.shape == (3, 2)


def test_every_quality_has_its_words():
    assert set(QUALITY_REASONS) == set(Quality)
