"""Trajectories from raw amplitudes: SciPy as oracle, honest covariances, clocks, clipping."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import norm

from trackfield.errors import InputError
from trackfield.localization.pass_raw import RawPass, fit, fits
from trackfield.localization.pass_raw_starts import flipped_starts, spread_starts
from trackfield.sensing.amplitude import AmplitudeModel

FIELD = 1000.0 * np.array(
    [(-1.2, 0.8), (0.95, -0.85), (0.25, 0.45), (-0.6, -1.1), (1.4, 0.9), (-1.7, -1.5)]
)
TRUTH = np.array([1e6, -2400.0, -500.0, 196.0, 40.0])
TIMES = np.arange(25.0)


def means(theta, sensors, t_s, exponent):
    place = theta[1:3] + t_s[:, None] * theta[3:5]
    return math.sqrt(theta[0]) * np.hypot(*(place - sensors).T) ** -exponent


def scene(rng, model, *, k=5, ahead=0.0):
    """Samples of one pass by `TRUTH`; of exponent alpha the power is such that a is as in 1."""
    sensor = np.repeat(np.arange(k), TIMES.size).astype(np.int32)
    t = np.tile(TIMES, k)
    truth = TRUTH.copy()
    truth[0] = 1000.0 ** (2.0 * model.exponent)
    a = means(truth, FIELD[sensor], t, model.exponent)
    if model.fading == "none":
        z = a + model.sigma * rng.standard_normal(a.shape)
    else:
        z = np.sqrt((model.sigma**2 + a**2) * rng.standard_exponential(a.shape))
    clocks = ahead * np.ones(k) if np.isscalar(ahead) else ahead
    z = np.minimum(z, model.saturation)
    return RawPass(FIELD[:k], (model,) * k, sensor, t + clocks[sensor], z), truth


def cost(raw, theta, clocks=None):
    """The negative log-likelihood, sample by sample, by SciPy."""
    m = raw.models[0]
    off = np.zeros(len(raw.models)) if clocks is None else clocks
    a = means(theta, raw.sensors[raw.sensor], raw.t_s - off[raw.sensor], m.exponent)
    cut = raw.value >= m.saturation
    if m.fading == "none":
        each = np.where(
            cut, -norm.logsf(m.saturation, a, m.sigma), 0.5 * ((raw.value - a) / m.sigma) ** 2
        )
    else:
        v = m.sigma**2 + a**2
        each = np.where(cut, m.saturation**2 / v, np.log(v) + raw.value**2 / v)
    prior = 0.5 * np.sum((off / m.clock_sigma_s) ** 2) if m.clock_sigma_s else 0.0
    return each.sum() + prior


MODELS = [
    AmplitudeModel(sigma=0.1),
    AmplitudeModel(sigma=0.1, exponent=1.7),
    AmplitudeModel(sigma=0.1, saturation=1.5),
    AmplitudeModel(sigma=0.1, fading="rayleigh"),
    AmplitudeModel(sigma=0.1, fading="rayleigh", saturation=1.5),
    AmplitudeModel(sigma=0.1, clock_sigma_s=0.3),
]
names = ["free space", "steeper", "clipped", "fading", "fading, clipped", "clocks"]


@pytest.mark.parametrize("model", MODELS, ids=names)
def test_the_fit_is_the_maximum_that_scipy_finds(model):
    rng = np.random.default_rng(3)
    raw, truth = scene(rng, model)
    found = fit(raw, truth * [1.2, 1.02, 0.9, 1.03, 1.1])
    assert found.converged
    assert found.cost == pytest.approx(cost(raw, found.theta, found.clock_s), rel=1e-9)
    assert found.cost == pytest.approx(found.costs.sum())
    scale = np.sqrt(np.diag(found.covariance))

    def about(x):
        return cost(raw, found.theta + x[:5] * scale, found.clock_s + x[5:] * 0.1)

    size = 5 + (5 if model.clock_sigma_s else 0)

    def padded(x):
        return about(np.concatenate([x, np.zeros(10 - size)]))

    better = minimize(padded, np.full(size, 0.1), method="BFGS", tol=1e-7)
    np.testing.assert_allclose(better.x, 0.0, atol=2e-3)


@pytest.mark.parametrize("model", MODELS, ids=names)
def test_the_covariance_is_the_inverse_of_the_information_by_differences(model):
    """Mean information: the slope of every amplitude, times what a sample of it tells."""
    raw, truth = scene(np.random.default_rng(4), model)
    found = fit(raw, truth)
    k = len(raw.models)

    def amplitudes(x):
        t = raw.t_s - x[5:][raw.sensor]
        return means(x[:5], raw.sensors[raw.sensor], t, model.exponent)

    x = np.concatenate([found.theta, found.clock_s])
    steps = np.diag(np.concatenate([1e-5 * np.abs(found.theta), np.full(k, 1e-5)]))
    J = np.array([(amplitudes(x + h) - amplitudes(x - h)) / (2 * h.sum()) for h in steps])
    a = amplitudes(x)
    weight = np.array([told_by_a_sample(model, one) for one in a])
    full = (J * weight) @ J.T
    if model.clock_sigma_s:
        full[5:, 5:] += np.eye(k) / model.clock_sigma_s**2
    else:
        full = full[:5, :5]
    unit = np.sqrt(np.diag(full))
    expected = (np.linalg.inv(full / np.outer(unit, unit)) / np.outer(unit, unit))[:5, :5]
    np.testing.assert_allclose(
        found.covariance / np.outer(unit[:5], unit[:5]) ** -1,
        expected / np.outer(unit[:5], unit[:5]) ** -1,
        rtol=2e-4,
        atol=2e-3,
    )


def told_by_a_sample(model, a, h=1e-4):
    """Fisher information about `a`, E[(d log f / d a)^2], by a sum over the sample space."""

    def density(b, z):
        if model.fading == "none":
            return norm.pdf(z, b, model.sigma)
        v = model.sigma**2 + b**2
        return 2 * z / v * np.exp(-(z**2) / v)

    def beyond(b):
        if model.fading == "none":
            return norm.sf(model.saturation, b, model.sigma)
        return math.exp(-(model.saturation**2) / (model.sigma**2 + b**2))

    low, high = (a - 9 * model.sigma, a + 9 * model.sigma)
    if model.fading == "rayleigh":
        low, high = 1e-9, 7 * math.hypot(model.sigma, a)
    z = np.linspace(low, min(high, model.saturation), 20001)
    slope = (density(a + h, z) - density(a - h, z)) / (2 * h)
    f = density(a, z)
    told = np.trapezoid(np.where(f > 1e-280, slope**2 / np.maximum(f, 1e-280), 0.0), z)
    if math.isfinite(model.saturation) and beyond(a) > 1e-12:
        told += ((beyond(a + h) - beyond(a - h)) / (2 * h)) ** 2 / beyond(a)
    return told


@pytest.mark.parametrize("model", MODELS, ids=names)
def test_errors_are_as_large_as_the_covariance_says(model):
    rng = np.random.default_rng(5)
    squares, misfits = [], []
    for _ in range(150):
        ahead = model.clock_sigma_s * rng.standard_normal(5)
        raw, truth = scene(rng, model, ahead=ahead)
        found = fit(raw, truth)
        assert found.converged
        assert found.determined
        e = found.theta - truth
        unit = np.sqrt(np.diag(found.covariance))
        squares.append(
            (e / unit) @ np.linalg.solve(found.covariance / np.outer(unit, unit), e / unit)
        )
        misfits.append(found.misfit)
    assert 0.8 < np.mean(squares) / 5 < 1.35
    assert abs(np.mean(misfits)) < 0.7
    assert max(misfits) < 4.0


def test_an_unknown_exponent_is_found():
    rng = np.random.default_rng(6)
    raw, truth = scene(rng, AmplitudeModel(sigma=0.02, exponent=1.4), k=6)
    told = raw._replace(models=(AmplitudeModel(sigma=0.02, exponent=1.0),) * 6)
    wrong = fit(told, TRUTH)
    found = fit(told, TRUTH, free_exponent=True)
    sd = math.sqrt(found.covariance[5, 5])
    assert found.converged
    assert abs(found.theta[5] - 1.4) < 4 * sd < 0.05
    assert wrong.misfit > 10 > found.misfit
    assert np.linalg.norm(found.theta[1:3] - truth[1:3]) < np.linalg.norm(
        wrong.theta[1:3] - truth[1:3]
    )


def test_the_order_of_samples_and_the_origin_of_time_do_not_matter():
    rng = np.random.default_rng(7)
    raw, truth = scene(rng, AmplitudeModel(sigma=0.1))
    found = fit(raw, truth)
    mixed = rng.permutation(raw.t_s.size)
    epoch = 1.7e9
    later = raw._replace(
        sensor=raw.sensor[mixed], t_s=raw.t_s[mixed] + epoch, value=raw.value[mixed], start_s=epoch
    )
    np.testing.assert_allclose(fit(later, truth).theta, found.theta, rtol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(-3.1, 3.1), st.floats(1e-3, 1e3))
def test_turning_and_scaling_the_field_turns_and_scales_the_answer(seed, angle, scale):
    raw, truth = scene(np.random.default_rng(seed), AmplitudeModel(sigma=0.05))
    turn = scale * np.array(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    )
    turned = raw._replace(sensors=raw.sensors @ turn.T)
    there = np.concatenate([[truth[0] * scale**2], turn @ truth[1:3], turn @ truth[3:]])
    here, found = fit(raw, truth), fit(turned, there)
    assert found.cost == pytest.approx(here.cost, rel=1e-7)
    np.testing.assert_allclose(found.theta[1:3], turn @ here.theta[1:3], rtol=1e-3, atol=scale)


def test_sensors_in_a_line_keep_a_mirror_image_of_equal_cost():
    model = AmplitudeModel(sigma=0.05)
    raw, truth = scene(np.random.default_rng(8), model)
    line = np.column_stack([FIELD[:5, 0], np.zeros(5)])
    a = means(truth, line[raw.sensor], raw.t_s, 1.0)
    raw = raw._replace(
        sensors=line, value=a + 0.05 * np.random.default_rng(9).standard_normal(a.size)
    )
    mirror = truth * [1, 1, -1, 1, -1]
    one, other = fits(raw, np.array([truth, mirror]))
    assert one.cost == pytest.approx(other.cost, rel=1e-9)
    np.testing.assert_allclose(one.theta, other.theta * [1, 1, -1, 1, -1], rtol=1e-4)


def test_one_sensor_leaves_directions_free_and_says_so():
    raw, truth = scene(np.random.default_rng(10), AmplitudeModel(sigma=0.05), k=1)
    found = fit(raw, truth)
    assert not found.determined
    assert np.isfinite(found.covariance).all()


def test_a_second_source_is_told_by_the_misfit():
    rng = np.random.default_rng(11)
    raw, truth = scene(rng, AmplitudeModel(sigma=0.05))
    other = means(np.array([1e6, 2400.0, -800.0, -150.0, 90.0]), FIELD[raw.sensor], raw.t_s, 1.0)
    assert fit(raw, truth).misfit < 4.0
    assert fit(raw._replace(value=raw.value + other), truth).misfit > 10.0


def test_far_starts_end_somewhere_finite():
    raw, truth = scene(np.random.default_rng(12), AmplitudeModel(sigma=0.1))
    for start in ([1e-3, 0, 0, 0, 0], [1e12, 1e6, 1e6, 1e4, -1e4], [1.0, *FIELD[0], 0.0, 0.0]):
        found = fit(raw, np.array(start, float))
        assert np.isfinite(found.theta).all()
        assert np.isfinite(found.covariance).all()
        assert found.cost >= fit(raw, truth).cost - 1e-6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"value": np.full(125, np.nan)}, "value: expected finite"),
        ({"t_s": np.full(125, np.inf)}, "t_s: expected finite"),
        ({"t_s": np.zeros(3)}, "the same shape"),
        ({"sensor": np.full(125, 7, np.int32)}, "found 7"),
        ({"sensors": FIELD[:2]}, "5 models"),
        ({"sensors": np.full((5, 2), np.nan)}, "finite places"),
        ({"t_s": np.empty(0), "value": np.empty(0), "sensor": np.empty(0, np.int32)}, "no samples"),
    ],
)
def test_bad_samples_are_refused(change, words):
    raw, truth = scene(np.random.default_rng(13), MODELS[0])
    with pytest.raises(InputError, match=words):
        fit(raw._replace(**change), truth)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ([0.0, 0, 0, 1, 1], "power above 0"),
        ([1.0, np.nan, 0, 1, 1], "power above 0"),
        ([np.inf, 0, 0, 1, 1], "infinite power"),
        ([1.0, 0, 0], "expected"),
    ],
)
def test_bad_starts_are_refused(start, words):
    raw, _ = scene(np.random.default_rng(14), MODELS[0])
    with pytest.raises(InputError, match=words):
        fit(raw, np.array(start))


def test_starts_all_over_find_the_maximum_without_any_help():
    rng = np.random.default_rng(15)
    for _ in range(4):
        raw, truth = scene(rng, AmplitudeModel(sigma=0.1))
        found = fits(raw, spread_starts(raw), within=12.0)
        best = fit(raw, truth)
        assert found[0].cost == pytest.approx(best.cost, rel=1e-9)
        assert found[0].theta == pytest.approx(best.theta, rel=1e-3)
        assert all(one.cost <= best.cost + 12.0 for one in found)
        places = {tuple(np.round(one.theta / best.theta, 3)) for one in found}
        assert len(places) == len(found)


def test_the_other_side_of_a_sensor_sounds_the_same_there():
    raw, truth = scene(np.random.default_rng(16), AmplitudeModel(sigma=0.1))
    sides = flipped_starts(raw, truth[None])
    assert sides.shape == (5, 5)
    for k, side in enumerate(sides):
        here, there = (means(one, FIELD[k], TIMES, 1.0) for one in (truth, side))
        np.testing.assert_allclose(there, here, rtol=1e-9)
        np.testing.assert_array_equal(side[3:], truth[3:])
        assert np.linalg.norm(side[1:3] - truth[1:3]) > 1.0


def test_starts_of_silence_are_finite():
    raw, _ = scene(np.random.default_rng(17), AmplitudeModel(sigma=0.1))
    starts = spread_starts(raw._replace(value=np.zeros(raw.t_s.size)))
    assert np.isfinite(starts).all()
    assert (starts[:, 0] > 0).all()
