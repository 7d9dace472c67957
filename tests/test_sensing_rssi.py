"""Signal strength of beacons: law, slope, mixture, and draws that have their moments."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from trackfield.errors import InputError
from trackfield.sensing import rssi, rssi_world
from trackfield.sensing.rssi import RssiModel

MIXED = (
    RssiModel(power_dbm=-60.0, exponent=2.0, sigma_db=3.0),
    RssiModel(power_dbm=-55.0, exponent=1.5, sigma_db=5.0, shadow_db=4.0, near_m=1.0),
    RssiModel(power_dbm=-65.0, exponent=3.0, p_blocked=0.2, p_outlier=0.1, min_dbm=-90.0),
)
SENSORS = np.array([[0.0, 0.0, 1.0], [4.0, 1.0, 2.0], [-1.0, 5.0, 0.0]])
BURSTS = RssiModel(p_blocked=0.25, blocked_db=6.0, blocked_sigma_db=0.0, burst_s=4.0, sigma_db=1e-9)


def test_expected_strength_by_hand():
    models = rssi.columns(MIXED)
    found = rssi.expected(models, np.array([[10.0, 100.0, 1.0], [0.01, 0.5, 0.3]]))
    near = -60.0 - 20.0 * math.log10(0.3)
    np.testing.assert_allclose(
        found, [[-80.0, -85.0, -65.0], [near, -55.0, -65.0 - 30.0 * math.log10(0.3)]]
    )
    np.testing.assert_allclose(rssi.variance(models, np.ones((5, 3)))[2], [9.0, 41.0, 25.0])
    assert rssi.variance(MIXED[0], np.ones((5, 3))).shape == (5, 3)
    assert rssi.distance(SENSORS, np.array([0.0, 3.0, 5.0]))[0] == 5.0


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_jacobian_is_the_slope_of_the_expected_strength(seed, d):
    rng = np.random.default_rng(seed)
    sensors, p = rng.uniform(-5, 5, (3, d)), rng.uniform(-5, 5, d)
    models = rssi.columns(MIXED)
    near = np.abs(rssi.distance(sensors, p) - models.near_m).min()
    h = 1e-4 * min(near, 0.1)

    def mean(position):
        return rssi.expected(models, rssi.distance(sensors, position))

    slope = np.stack([(mean(p + h * e) - mean(p - h * e)) / (2 * h) for e in np.eye(d)], axis=-1)
    found = rssi.jacobian(models, sensors, positions=p)
    np.testing.assert_allclose(found, slope, atol=1e-4 * (1.0 + np.abs(slope).max()))


def test_at_a_receiver_there_is_no_slope_and_no_nan():
    found = rssi.jacobian(RssiModel(near_m=1e-9), SENSORS, positions=SENSORS[0])
    assert (found[0] == 0.0).all()
    assert (found[1:] != 0.0).any(axis=-1).all()
    assert np.isfinite(rssi.expected(RssiModel(), np.zeros(2))).all()


def test_the_mixture_is_a_density_and_its_shares_are_bayes():
    model = RssiModel(p_blocked=0.2, p_outlier=0.05, blocked_db=7.0, blocked_sigma_db=2.0)

    def density(off):
        return math.exp(rssi.log_density(model, np.array(off), variance=np.array(9.0)))

    assert quad(density, -400, 400, points=[-7, 0])[0] == pytest.approx(1.0, abs=1e-6)
    mean = quad(lambda x: x * density(x), -400, 400, points=[-7, 0])[0]
    assert mean == pytest.approx(-0.2 * 7.0, abs=1e-5)

    def normal(x, m, v):
        return math.exp(-((x - m) ** 2) / (2 * v)) / math.sqrt(2 * math.pi * v)

    parts = np.array([0.75 * normal(-5, 0, 9), 0.2 * normal(-5, -7, 13), 0.05 * normal(-5, 0, 409)])
    found = rssi.shares(model, np.array(-5.0), variance=np.array(9.0))
    np.testing.assert_allclose(found, parts / parts.sum(), rtol=1e-12)
    assert density(-5.0) == pytest.approx(parts.sum())


def test_without_blocks_and_outliers_every_reading_is_clear():
    found = rssi.shares(RssiModel(), np.array([-30.0, 0.0, 80.0]), variance=np.full(3, 25.0))
    np.testing.assert_array_equal(found, [[1.0] * 3, [0.0] * 3, [0.0] * 3])


def test_draws_have_the_mean_and_variance_of_the_model():
    model = RssiModel(
        sigma_db=3.0, p_blocked=0.3, blocked_db=8.0, blocked_sigma_db=2.0, p_outlier=0.1
    )
    path = np.broadcast_to([2.0, 3.0, 1.5], (60_000, 1, 3))
    rng = np.random.default_rng(4)
    z = rssi_world.simulate(model, SENSORS, path=path, t_s=np.zeros(1), rng=rng).value[:, 0]
    off = z - rssi.expected(model, rssi.distance(SENSORS, path[0, 0]))
    mean = -0.3 * 8.0
    variance = 9.0 + 0.3 * (4.0 + 64.0) - mean**2 + 0.1 * 400.0
    assert (np.abs(off.mean(axis=0) - mean) / math.sqrt(variance / len(z))).max() < 3.5
    np.testing.assert_allclose(off.var(axis=0), variance, rtol=0.03)


def test_shadows_have_the_covariance_of_the_model():
    models = rssi.columns([RssiModel(shadow_db=4.0, shadow_m=2.0)] * 2000)
    shadows = rssi_world.draw_shadows(models, sensors=2000, rng=np.random.default_rng(5))
    places = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 2.0], [3.0, 4.0, 0.0], [1.0, 1.0, 0.0]])
    drawn = rssi_world.shadow_at(shadows, places)
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=-1)
    found = drawn @ drawn.T / 2000
    np.testing.assert_allclose(found, 16.0 * np.exp(-apart / 2.0), atol=4 * 16 * 2**0.5 / 2000**0.5)
    assert np.abs(drawn.mean(axis=1)).max() < 4 * 4.0 / 2000**0.5


def test_a_shadow_is_the_same_whenever_its_place_is_visited_again():
    models = rssi.columns([RssiModel(shadow_db=6.0, sigma_db=1e-9)] * 3)
    rng = np.random.default_rng(6)
    shadows = rssi_world.draw_shadows(models, sensors=3, rng=rng)
    there_and_back = np.array([[0.0, 0.0, 1.0], [2.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    z = [
        rssi_world.simulate(
            models, SENSORS, path=there_and_back, t_s=np.arange(3.0), rng=rng, shadows=shadows
        ).value
        for _ in range(2)
    ]
    np.testing.assert_allclose(z[0], z[1], atol=1e-6)
    np.testing.assert_allclose(z[0][0], z[0][2], atol=1e-6)
    own = rssi_world.simulate(models, SENSORS, path=there_and_back, t_s=np.arange(3.0), rng=rng)
    assert np.abs(own.value - z[0]).max() > 1.0


def test_a_body_stands_in_the_way_for_as_long_and_as_often_as_told():
    t = np.cumsum(np.random.default_rng(7).choice([0.5, 1.5], 4000))
    path = np.broadcast_to([2.0, 3.0, 1.5], (4000, 3))
    drawn = rssi_world.simulate(BURSTS, SENSORS, path=path, t_s=t, rng=np.random.default_rng(8))
    clear = rssi.expected(BURSTS, rssi.distance(SENSORS, path))
    np.testing.assert_allclose(clear - drawn.value, np.where(drawn.blocked, 6.0, 0.0), atol=1e-6)
    assert drawn.blocked.mean() == pytest.approx(0.25, abs=0.03)
    # Of what is blocked, exp(-dt / 3) + .25 (1 - exp(-dt / 3)) is blocked dt later.
    for dt in (0.5, 1.5):
        pair = np.isclose(np.diff(t), dt)
        stays = drawn.blocked[1:][pair] & drawn.blocked[:-1][pair]
        kept = math.exp(-dt / 3.0)
        share = stays.sum() / drawn.blocked[:-1][pair].sum()
        assert share == pytest.approx(kept + 0.25 * (1 - kept), abs=0.04)


def test_what_is_weak_or_far_is_not_heard():
    model = RssiModel(sigma_db=1e-9, min_dbm=-79.0, max_range_m=20.0)
    path = np.array([[3.0, 0.0], [9.9, 0.0], [10.1, 0.0], [21.0, 0.0]])
    near = rssi_world.simulate(
        model, np.zeros((1, 2)), path=path, t_s=np.arange(4.0), rng=np.random.default_rng(9)
    )
    assert near.heard[:, 0].tolist() == [True, True, False, False]
    loud = RssiModel(sigma_db=1e-9, max_range_m=20.0)
    far = rssi_world.simulate(
        loud, np.zeros((1, 2)), path=path, t_s=np.arange(4.0), rng=np.random.default_rng(9)
    )
    assert far.heard[:, 0].tolist() == [True, True, True, False]


@pytest.mark.parametrize("shapes", [((3, 2), (3,)), ((3,), (3,)), ((3, 4), (4,)), ((3, 2), ())])
def test_shapes_that_do_not_fit_are_refused(shapes):
    sensors, positions = (np.zeros(shape) for shape in shapes)
    with pytest.raises(InputError, match="same d"):
        rssi.jacobian(RssiModel(), sensors, positions=positions)


@pytest.mark.parametrize("t", [np.zeros(2), np.array([0.0, 2.0, 1.0])])
def test_times_that_do_not_fit_the_path_are_refused(t):
    with pytest.raises(InputError, match="in order"):
        rssi_world.simulate(
            RssiModel(), SENSORS, path=np.zeros((3, 3)), t_s=t, rng=np.random.default_rng(0)
        )
