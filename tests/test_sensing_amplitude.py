"""Amplitudes: the law of distance, the moments of draws, likelihood and information of a sample."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from trackfield.errors import InputError
from trackfield.sensing import amplitude
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.amplitude_likelihood import misfit, sample_information

SENSORS = np.array([[0.0, 0.0, 1.0], [4.0, 1.0, 2.0], [-1.0, 5.0, 0.0]])
PLAIN = AmplitudeModel(exponent=1.3, sigma=0.2)
FADING = AmplitudeModel(exponent=1.3, sigma=0.2, fading="rayleigh")
MODELS = [
    PLAIN,
    FADING,
    replace(PLAIN, saturation=0.5),
    replace(FADING, saturation=0.5),
]


def density(model, mean):
    """Density of a sample that no saturation hides, by SciPy."""
    if model.fading == "none":
        return stats.norm(mean, model.sigma)
    return stats.rayleigh(scale=math.sqrt((model.sigma**2 + mean**2) / 2))


def test_the_amplitude_is_the_root_of_the_power_at_one_metre_and_falls_with_distance():
    positions = SENSORS[0] + np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    found = amplitude.expected(AmplitudeModel(exponent=2.0), SENSORS, positions=positions, power=9)
    np.testing.assert_allclose(found[:, 0], [3.0, 3.0 / 4.0])


def test_a_source_at_the_sensor_is_loud_and_finite():
    found = amplitude.expected(PLAIN, SENSORS, positions=SENSORS[1], power=1.0)
    assert np.isfinite(found).all()
    assert found[1] > 1e9


def test_columns_say_for_each_sensor_what_its_model_says():
    models = [replace(FADING, exponent=e, sigma=e / 10) for e in (1.0, 1.5, 2.0)]
    table = amplitude.columns(models)
    p = np.array([1.0, 2.0, 3.0])
    together = amplitude.expected(table, SENSORS, positions=p, power=2.0)
    told = misfit(table, np.full(3, 0.4), mean=together).cost
    for i, model in enumerate(models):
        one = amplitude.expected(model, SENSORS[i : i + 1], positions=p, power=2.0)
        assert together[i] == one[0]
        assert told[i] == misfit(model, np.array([0.4]), mean=one).cost[0]


def test_sensors_of_one_field_agree_in_their_fading():
    with pytest.raises(InputError, match="fading"):
        amplitude.columns([PLAIN, FADING])


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("mean", [0.05, 0.4, 1.0])
def test_draws_follow_the_density_and_end_at_the_saturation(model, mean):
    z = amplitude.noisy(model, np.full(20_000, mean), rng=np.random.default_rng(5))
    law = density(model, mean)
    clear = z < model.saturation
    hidden = law.sf(model.saturation)
    assert (~clear).mean() == pytest.approx(hidden, abs=4 * math.sqrt(0.25 / len(z)))
    assert z.max() <= model.saturation
    if clear.any():
        below = stats.kstest(law.cdf(z[clear]) / (1 - hidden), "uniform")
        assert below.pvalue > 1e-3


@pytest.mark.parametrize("model", MODELS)
@given(st.floats(0.01, 2.0), st.floats(0.001, 2.0))
def test_the_cost_is_the_negative_log_of_the_density_or_of_the_hidden_tail(model, mean, value):
    value = min(value, model.saturation)
    law = density(model, mean)
    expected = law.logsf(value) if value >= model.saturation else law.logpdf(value)
    found = misfit(model, np.array([value]), mean=np.array([mean]))
    np.testing.assert_allclose(found.cost, -expected, rtol=1e-9, atol=1e-9)
    assert found.clipped[0] == (value == model.saturation)


@pytest.mark.parametrize("model", MODELS)
@given(st.floats(0.01, 2.0), st.floats(0.001, 2.0))
def test_the_slope_of_the_cost_is_that_of_its_difference(model, mean, value):
    h = 1e-6
    values = np.full(2, min(value, model.saturation))
    up, down = misfit(model, values, mean=np.array([mean + h, mean - h])).cost
    found = misfit(model, values[:1], mean=np.array([mean])).slope[0]
    assert found == pytest.approx((up - down) / (2 * h), rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("mean", [0.05, 0.3, 0.6, 1.2])
def test_the_information_is_the_mean_square_of_the_slope(model, mean):
    law, top = density(model, mean), min(model.saturation, 6.0)

    def square(value):
        return misfit(model, np.array([value]), mean=np.array([mean])).slope[0] ** 2

    low = 0.0 if model.fading == "rayleigh" else mean - 8 * model.sigma
    seen, _ = integrate.quad(lambda z: square(z) * law.pdf(z), low, top * (1 - 1e-12), limit=200)
    hidden = square(model.saturation) * law.sf(model.saturation) if top < 6.0 else 0.0
    found = sample_information(model, np.array([mean]))[0]
    assert found == pytest.approx(seen + hidden, rel=1e-6)


def test_far_below_the_saturation_it_hides_nothing_and_far_above_it_everything():
    model = replace(PLAIN, saturation=50.0)
    told = sample_information(model, np.array([0.0, 1e3])) * model.sigma**2
    np.testing.assert_allclose(told, [1.0, 0.0], atol=1e-12)
    far = misfit(model, np.array([50.0]), mean=np.array([1e4]))
    assert far.cost[0] == 0.0
    assert far.slope[0] == 0.0


def test_clocks_stamp_each_run_and_sensor_with_an_error_of_their_own():
    model = replace(PLAIN, clock_sigma_s=0.5)
    path = np.zeros((2000, 1, 3))
    drawn = amplitude.simulate(model, SENSORS, path=path, power=1.0, rng=np.random.default_rng(2))
    assert drawn.ahead_s.shape == (2000, 3)
    np.testing.assert_allclose(drawn.ahead_s.std(axis=0), 0.5, rtol=0.07)
    exact = amplitude.simulate(PLAIN, SENSORS, path=path, power=1.0, rng=np.random.default_rng(2))
    assert (exact.ahead_s == 0.0).all()


def test_only_sources_within_reach_are_heard_and_height_counts():
    path = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 5.1]])
    model = replace(PLAIN, max_range_m=4.0)
    drawn = amplitude.simulate(
        model, SENSORS[:1], path=path, power=1.0, rng=np.random.default_rng()
    )
    assert drawn.heard[:, 0].tolist() == [True, False]


def test_amplitudes_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="finite"):
        misfit(PLAIN, np.array([1.0, math.nan]), mean=np.ones(2))
    with pytest.raises(InputError, match="0 or more"):
        misfit(FADING, np.array([1.0, -0.1]), mean=np.ones(2))
    assert np.isfinite(misfit(PLAIN, np.array([-0.1]), mean=np.ones(1)).cost).all()
    assert np.isfinite(misfit(FADING, np.array([0.0]), mean=np.ones(1)).cost).all()


@pytest.mark.parametrize("shapes", [((3, 2), (3,)), ((3,), (3,)), ((3, 4), (4,))])
def test_shapes_that_do_not_fit_are_refused(shapes):
    sensors, positions = (np.zeros(shape) for shape in shapes)
    with pytest.raises(InputError, match="positions"):
        amplitude.expected(PLAIN, sensors, positions=positions, power=1.0)
