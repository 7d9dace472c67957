"""Energy messages: codes there and back, what is beyond them, and what rounding costs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.sensing import profile
from trackfield.sensing.energy_message import (
    NOTHING,
    EnergyMessageModel,
    amplitude_model,
    decode,
    encode,
    sample_times,
)
from trackfield.sensing.energy_message_accuracy import encoding_cost, message_information
from trackfield.sensing.energy_message_making import make, simulate
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import Profile
from trackfield.sensing.profile_fit import Quality

MODEL = EnergyMessageModel(sigma=0.1, sample_s=0.5, record_s=24.0, clock_sigma_s=0.2)
THETA = np.array([1.0, -2.4, -0.5, 0.196, 0.04])
SENSORS = np.array([[-1.2, 0.8], [0.95, -0.85], [0.25, 0.45]])
seeds = st.integers(0, 2**32 - 1)
widths = st.integers(2, 17)
END = 1000.0


def some(rng, *shape):
    """Profiles anywhere between the ends of the codes."""
    return Profile(
        MODEL.sigma * np.exp(rng.uniform(math.log(0.1), math.log(1e5), shape)),
        END + MODEL.record_s * rng.uniform(-1.1, 0.1, shape),
        np.exp(rng.uniform(math.log(0.01), math.log(36.0), shape)),
    )


@given(seeds, widths)
def test_what_comes_back_is_off_by_half_a_step_at_most(seed, bits):
    model = replace(MODEL, bits=bits)
    at = some(np.random.default_rng(seed), 20)
    word = encode(model, at, end_s=END)
    assert (word > 0).all()
    assert (word < 2 ** (3 * bits)).all()
    assert (word.astype(float).astype(np.int64) == word).all()
    told = decode(model, word.astype(float), end_s=END)
    top = 2**bits - 1
    off = np.abs(np.log(told.profile.a_max / at.a_max)) / (math.log(1e6) / (top - 1))
    assert off.max() < 0.5 + 1e-9
    assert (np.abs(told.profile.t_max_s - at.t_max_s) / (1.2 * 24.0 / top)).max() < 0.5 + 1e-6
    step = math.log(36.0 / 0.01) / top
    assert (np.abs(np.log(told.profile.width_s / at.width_s)) / step).max() < 0.5 + 1e-9
    assert told.seen.all()


@given(seeds, widths)
def test_a_decoded_profile_has_the_word_it_came_from(seed, bits):
    model = replace(MODEL, bits=bits)
    word = encode(model, some(np.random.default_rng(seed), 20), end_s=END)
    again = encode(model, decode(model, word, end_s=END).profile, end_s=END)
    np.testing.assert_array_equal(again, word)


@given(seeds, widths)
def test_larger_numbers_have_larger_codes(seed, bits):
    model = replace(MODEL, bits=bits)
    low, high = some(np.random.default_rng(seed), 2, 20).array()
    for k in range(3):
        pair = np.stack([low, low])
        pair[:, :, k] = np.sort(np.stack([low[:, k], high[:, k]]), axis=0)
        word = encode(model, profile.profile_of(pair), end_s=END)
        code = (word >> (bits * (2 - k))) % 2**bits
        assert (code[0] <= code[1]).all()


def test_rounding_has_the_covariance_that_is_told():
    at = some(np.random.default_rng(1), 20_000)
    for bits in (8, 12):
        model = replace(MODEL, bits=bits)
        told = decode(model, encode(model, at, end_s=END), end_s=END)
        sigmas = np.sqrt(np.diagonal(told.covariance, axis1=-2, axis2=-1))
        error = (told.profile.array() - at.array()) / sigmas
        np.testing.assert_allclose(np.cov(error.T), np.eye(3), atol=0.04)


def test_beyond_the_ends_stands_the_end_and_it_is_told():
    beyond = Profile(
        np.array([0.0, 1e9, 1.0, 1.0, 1.0, 1.0, 1.0]),
        END + np.array([-9.0, -9.0, -99.0, 99.0, -9.0, -9.0, -9.0]),
        np.array([5.0, 5.0, 5.0, 5.0, 0.0, math.inf, 5.0]),
    )
    told = decode(MODEL, encode(MODEL, beyond, end_s=END), end_s=END)
    assert told.at_limit.tolist() == [True] * 6 + [False]
    np.testing.assert_allclose(told.profile.a_max[:2], [0.01, 1e4])
    np.testing.assert_allclose(told.profile.t_max_s[2:4], END + np.array([-26.4, 2.4]))
    np.testing.assert_allclose(told.profile.width_s[4:6], [0.01, 36.0])


def test_nothing_seen_has_a_word_of_its_own():
    at = Profile(*(part[:3] for part in some(np.random.default_rng(2), 3)))
    word = encode(MODEL, at, end_s=END, seen=np.array([True, False, True]))
    assert (word == NOTHING).tolist() == [False, True, False]
    told = decode(MODEL, word, end_s=END)
    assert told.seen.tolist() == [True, False, True]
    assert not told.at_limit[1]
    assert np.isfinite(told.profile.array()).all()
    weakest = Profile(0.0, END - 99.0, 0.0)
    assert encode(MODEL, weakest, end_s=END) > NOTHING


@pytest.mark.parametrize("word", [-1, 1, 0.5, 2.0**24 - 1, 2.0**36, math.nan, math.inf])
def test_what_is_no_code_word_is_refused(word):
    with pytest.raises(InputError, match="code word"):
        decode(MODEL, np.array([2.0**30, word]), end_s=END)


@pytest.mark.parametrize("numbers", [(-1.0, 0.0, 1.0), (1.0, 0.0, -1.0), (1.0, math.nan, 1.0)])
def test_what_is_no_profile_is_refused(numbers):
    with pytest.raises(InputError, match="profiles"):
        encode(MODEL, Profile(*numbers), end_s=0.0)


def test_models_without_sense_are_refused():
    for wrong in ({"bits": 1}, {"bits": 18}, {"sigma": 0.0}, {"sample_s": 0.0}, {"record_s": 0.1}):
        with pytest.raises(InputError, match="expected"):
            encode(replace(MODEL, **wrong), Profile(1.0, 0.0, 1.0), end_s=0.0)
    for wrong in ({"record_s": 0.1}, {"sample_s": 0.0}, {"record_s": math.inf}):
        with pytest.raises(InputError, match="record"):
            sample_times(replace(MODEL, **wrong))


def test_a_record_has_a_sample_every_step_to_its_end():
    assert sample_times(replace(MODEL, sample_s=1.0)).tolist() == list(range(-24, 1))
    assert sample_times(replace(MODEL, sample_s=0.1, record_s=0.3)).size == 4
    assert sample_times(replace(MODEL, sample_s=7.0)).tolist() == [-21.0, -14.0, -7.0, 0.0]


def test_a_message_holds_what_the_samples_the_rounding_and_the_clock_leave():
    at = predict(THETA, SENSORS)
    told = decode(MODEL, encode(MODEL, at, end_s=24.0), end_s=24.0)
    J = profile.information(at, 24.0 + sample_times(MODEL), amplitude_model(MODEL))
    Q = told.covariance + np.diag([0.0, 0.04, 0.0])
    expected = np.linalg.inv(np.linalg.inv(J) + Q)
    found = message_information(MODEL, at, end_s=24.0, rounding=told.covariance)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    exact = message_information(replace(MODEL, clock_sigma_s=0.0), at, end_s=24.0)
    np.testing.assert_allclose(exact, J, rtol=1e-9)


def test_information_of_what_tells_nothing_is_finite():
    flat = Profile(1.0, 12.0, 1e9)
    rounding = np.diag([1e-6, 1e-4, 1e12])
    J = message_information(MODEL, flat, end_s=24.0, rounding=rounding)
    assert np.isfinite(J).all()
    assert J[0, 0] > 1.0
    assert (np.linalg.eigvalsh(J) >= -1e-9 * J[0, 0]).all()


def test_more_bits_cost_less_and_twelve_cost_next_to_nothing():
    at = predict(THETA, SENSORS)
    model = replace(MODEL, sample_s=1.0, sigma=10**-0.5)
    costs = [encoding_cost(model, at, end_s=24.0, bits=b) for b in (4, 6, 8, 10, 12, 16)]
    worst = [cost.max() for cost in costs]
    assert worst == sorted(worst, reverse=True)
    assert all((cost >= 1.0).all() for cost in costs)
    assert worst[4] < 1.0002
    assert worst[0] > 1.2


def test_simulated_messages_are_of_the_pass():
    model = replace(MODEL, sigma=0.01)
    t_s = 24.0 + sample_times(model)
    path = THETA[1:3] + t_s[:, None] * THETA[3:]
    drawn = simulate(
        model,
        SENSORS,
        path=np.broadcast_to(path, (200, *path.shape)),
        power=THETA[0],
        rng=np.random.default_rng(7),
    )
    assert drawn.word.shape == drawn.ahead_s.shape == (200, 3)
    assert (drawn.fit.quality == Quality.GOOD).all()
    assert drawn.ahead_s.std() == pytest.approx(0.2, rel=0.1)
    told = decode(model, drawn.word, end_s=24.0)
    at = predict(THETA, SENSORS)
    exact = replace(model, clock_sigma_s=0.0)
    J = message_information(exact, at, end_s=24.0, rounding=told.covariance.mean(axis=0))
    error = told.profile.array() - at.array()
    ratio = np.sqrt((error**2).mean(axis=0) / np.diagonal(np.linalg.inv(J), axis1=-2, axis2=-1))
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)


def test_a_sensor_that_hears_nothing_says_so():
    rng = np.random.default_rng(8)
    made = make(MODEL, rng.normal(0.0, MODEL.sigma, (50, 49)))
    assert (made.word == NOTHING).mean() > 0.9
    assert (made.word == NOTHING).tolist() == (made.fit.quality >= Quality.EMPTY).tolist()


def test_a_pass_far_beyond_the_record_stands_at_the_end_of_the_codes():
    model = replace(MODEL, sigma=0.01)
    values = profile.expected(Profile(2.0, 12.0, 6.0), sample_times(model))
    made = make(model, values)
    assert made.fit.quality == Quality.NOT_PASSED
    told = decode(model, made.word, end_s=END)
    assert told.at_limit
    assert told.profile.t_max_s == pytest.approx(END + 2.4)
