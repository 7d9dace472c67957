"""What readings of any kind say: the curvature of a divergence, the bound of ranges, mixtures."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError, InputError
from trackfield.localization.bounds import range_bound, range_information
from trackfield.localization.information import (
    fisher_information,
    pair_gains,
    position_bound,
    reading_gains,
    site_bound,
    site_gains,
    site_information,
)
from trackfield.localization.mixed_models import mixed, reach, taken
from trackfield.network.site import Site, Target
from trackfield.sensing import angular_rate, bearing, detection, motion_rate, rssi, signal
from trackfield.sensing import range as ranging
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.rssi import RssiModel
from trackfield.sensing.signal import SignalModel

MIXED = (
    RangeModel(sigma_m=0.1, scale=0.02, sigma_scale=0.05),
    BearingModel(sigma_rad=0.03, bias_rad=0.2),
    SignalModel(amplitude=30.0, falloff=0.2, placement_sigma_m=0.1, max_range_m=20.0),
    AngularRateModel(sigma_rad_s=0.02),
    DetectionModel(radius_m=6.0, p_detection=0.9, p_false=0.05, edge_m=10.0),
    RangeModel(sigma_m=0.3, correlated_sigma_m=0.1),
    AngularRateModel(sigma_rad_s=0.05),
    BearingModel(sigma_rad=0.1),
    MotionRateModel(falloff=1.5, sigma=0.02),
    RssiModel(exponent=1.7, sigma_db=3.0, shadow_db=2.0),
)


def fields(seed, n, d):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 4, (n, d)), rng.uniform(4.5, 6, d), rng.normal(size=d)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.booleans())
def test_ranges_give_the_information_of_ranges(seed, d, at_height):
    sensors, p, _ = fields(seed, 5, 3 if at_height else d)
    models = [RangeModel(0.1, 0.02, 0.1, 0.3), RangeModel(sigma_m=0.2, max_range_m=6.0)]
    models += [RangeModel(sigma_m=0.0, sigma_scale=0.1), *models]
    height, p = (1.0, p[:2]) if at_height else (None, p)
    columns = ranging.columns(models)
    found = fisher_information(reading_gains(models, sensors, p, height_m=height))
    J = range_information(sensors, p, models=columns, height_m=height)
    np.testing.assert_allclose(found, J, rtol=1e-11)
    ours, theirs = (
        position_bound(found),
        range_bound(sensors, p, models=columns, height_m=height),
    )
    assert ours.determined == theirs.determined
    if ours.determined:
        np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-6)


def slope(mean, state, h=1e-5):
    eye = np.eye(state.size)
    return np.stack([(mean(state + h * e) - mean(state - h * e)) / (2 * h) for e in eye], axis=-1)


@given(st.integers(0, 2**32 - 1))
def test_gains_are_the_slope_of_the_mean_over_the_noise(seed):
    """Of all kinds but ranges, whose noise tells of the distance too (tested above)."""
    sensors, p, v = fields(seed, len(MIXED), 2)
    state = np.concatenate([p, v])
    gains = reading_gains(MIXED, sensors, state)
    for i in (1, 7):
        expected = slope(
            lambda x, i=i: bearing.expected(MIXED[i], sensors[[i]], positions=x[:2]), state
        )
        np.testing.assert_allclose(gains[[i]], expected / MIXED[i].sigma_rad, atol=1e-5)
    for i in (3, 6):
        expected = slope(
            lambda x, i=i: angular_rate.expected(MIXED[i], sensors[[i]], states=x), state
        )
        np.testing.assert_allclose(gains[[i]], expected / MIXED[i].sigma_rad_s, atol=1e-5)
    at = MIXED[8]
    expected = slope(lambda x: motion_rate.strength(at, sensors[[8]], states=x), state)
    np.testing.assert_allclose(gains[[8]], expected / at.sigma, atol=1e-4)
    expected = slope(lambda x: rssi.expected(MIXED[9], rssi.distance(sensors[[9]], x[:2])), state)
    np.testing.assert_allclose(gains[[9]], expected / math.sqrt(13.0), atol=1e-5)
    expected = slope(lambda x: signal.expected(MIXED[2], sensors[[2]], targets=x[None, :2]), state)
    noise = signal.variance(MIXED[2], sensors[[2]], targets=state[None, :2])
    np.testing.assert_allclose(gains[[2]], expected / np.sqrt(noise), atol=1e-5)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["disc", "sector", "polygon"]))
def test_a_soft_detection_says_the_curvature_of_its_divergence(seed, shape):
    rng = np.random.default_rng(seed)
    region = {
        "disc": {"radius_m": 4.0},
        "sector": {"radius_m": 5.0, "heading_deg": 40.0, "width_deg": 120.0},
        "polygon": {"polygon": ((0.0, -2.0), (6.0, -1.0), (5.0, 5.0), (-1.0, 3.0))},
    }[shape]
    model = DetectionModel(p_detection=0.8, p_false=0.1, edge_m=2.0, **region)
    p = rng.uniform(-6, 6, 2)
    sensors = np.zeros((1, 2))

    def told(at):
        covered = detection.coverage(model, sensors, positions=at[None])
        return float(detection.probability(model, covered)[0])

    depth = float(detection.depth(model, sensors, positions=p)[0])
    g = reading_gains(model, sensors, p)[0]
    if abs(depth) > 1.0:
        assert (g == 0.0).all()
        return
    h = 1e-4
    if abs(depth) > 1.0 - 10 * h:  # at the very border of the edge there are two slopes
        return
    direction = g / np.linalg.norm(g)
    a, b = told(p), told(p + h * direction)
    divergence = a * math.log(a / b) + (1 - a) * math.log((1 - a) / (1 - b))
    assert 2 * divergence / h**2 == pytest.approx(g @ g, rel=5e-3)


def test_hard_regions_and_certain_models_are_finite():
    sensors = np.zeros((3, 2))
    models = (
        DetectionModel(radius_m=4.0),
        DetectionModel(radius_m=4.0, p_detection=1.0, p_false=0.0, edge_m=2.0),
        DetectionModel(radius_m=4.0, p_detection=1.0, p_false=0.0, edge_m=2.0),
    )
    gains = reading_gains(models, sensors, np.array([[4.999999, 0.0], [4.0, 0.0], [3.0, 0.0]]))
    assert (gains[:, 0] == 0.0).all()
    assert np.isfinite(gains).all()
    np.testing.assert_allclose(gains[1, 1], [-1.0, 0.0])  # P = 1/2, slope 1/2 over 1/2


def test_beacons_are_heard_as_far_as_the_receiver_is_sensitive_or_told_to_hear():
    models = mixed([RssiModel(min_dbm=-79.0), RssiModel(min_dbm=-79.0, max_range_m=4.0)])
    np.testing.assert_allclose(reach(models), [10.0, 4.0])
    sensors = np.zeros((2, 2))
    gains = reading_gains(models, sensors, np.array([[3.9, 0.0], [9.9, 0.0], [10.1, 0.0]]))
    np.testing.assert_array_equal(gains[..., 0] != 0.0, [[1, 1], [1, 0], [0, 0]])


@pytest.mark.parametrize("model", [AmplitudeModel(), EnergyMessageModel()])
def test_kinds_that_tell_no_place_by_themselves_are_not_planned_with(model):
    with pytest.raises(ConfigurationError, match="not planned with"):
        mixed([RangeModel(), model])


def test_kinds_mix_in_any_order_and_say_what_each_says_alone():
    sensors, p, v = fields(1, len(MIXED), 2)
    state = np.concatenate([p, v])
    gains = reading_gains(MIXED, sensors, state)
    for i, model in enumerate(MIXED):
        alone = reading_gains(model, sensors[[i]], state)
        np.testing.assert_allclose(gains[[i]], alone)
        assert np.abs(alone).max() > 0.0
        moves = isinstance(model, AngularRateModel | MotionRateModel)
        assert (gains[i, 2:] != 0.0).any() == moves
    np.testing.assert_allclose(
        reading_gains(MIXED, sensors, p)[[0, 1, 2, 4]], gains[[0, 1, 2, 4], :2]
    )
    order = np.array([5, 3, 0, 3, 1])
    some = taken(mixed(MIXED), order)
    np.testing.assert_allclose(reading_gains(some, sensors[order], state), gains[order])


def test_a_rate_says_nothing_of_the_place_where_the_velocity_is_unknown():
    sensors, p, v = fields(2, 6, 2)
    rates = AngularRateModel()
    assert (reading_gains(rates, sensors, p) == 0.0).all()
    full = reading_gains(rates, sensors, np.concatenate([p, v]))
    assert position_bound(fisher_information(full), 2).determined
    three = position_bound(fisher_information(full[:3]), 2)
    assert not three.determined
    still = reading_gains(rates, sensors, np.concatenate([p, np.zeros(2)]))
    assert (still[:, :2] == 0.0).all()
    assert not position_bound(fisher_information(still), 2).determined


@given(st.integers(0, 2**32 - 1))
def test_maps_and_pairs_are_their_points(seed):
    sensors, p, v = fields(seed, len(MIXED), 3)
    rng = np.random.default_rng(seed)
    states = np.concatenate([p, v]) + 0.3 * rng.normal(size=(4, 3, 6))
    every = reading_gains(MIXED, sensors, states)
    assert every.shape == (4, 3, len(MIXED), 6)
    np.testing.assert_allclose(every[2, 1], reading_gains(MIXED, sensors, states[2, 1]))
    i = rng.integers(0, len(MIXED), 20)
    k, l = rng.integers(0, 4, 20), rng.integers(0, 3, 20)  # noqa: E741
    pairs = pair_gains(taken(mixed(MIXED), i), sensors[i], states[k, l])
    np.testing.assert_allclose(pairs, every[k, l, i], atol=1e-12)


def test_beyond_their_reach_sensors_say_nothing():
    sensors = np.zeros((4, 3))
    models = (
        RangeModel(max_range_m=5.0),
        BearingModel(max_range_m=5.0),
        SignalModel(max_range_m=5.0),
        AngularRateModel(max_range_m=5.0),
    )
    state = np.array([3.9, 1.0, 0.0, 1.0])
    near = reading_gains(models, sensors, state, height_m=2.9)
    far = reading_gains(models, sensors, state, height_m=3.1)
    assert (np.abs(near).max(axis=1) > 0.0).all()
    assert (far == 0.0).all()
    deaf = SignalModel(saturation=50.0, max_range_m=20.0)
    r = np.array([[1.0, 0.0], [3.0, 0.0]])
    assert (np.abs(reading_gains(deaf, np.zeros((1, 2)), r)).max((1, 2)) > 0).tolist() == [
        False,
        True,
    ]


def test_at_a_height_the_plane_gets_its_block_of_space():
    sensors, p, v = fields(3, len(MIXED), 3)
    state = np.concatenate([p, v[:2], [0.0]])
    full = reading_gains(MIXED, sensors, state)
    flat = reading_gains(MIXED, sensors, state[[0, 1, 3, 4]], height_m=p[2])
    np.testing.assert_allclose(flat, full[:, [0, 1, 3, 4]])


def test_signal_noise_in_space_is_that_of_the_plane():
    models = signal.columns([SignalModel(placement_sigma_m=s, max_range_m=5.0) for s in (0.0, 0.4)])
    sensors = np.array([[0.0, 0.0], [1.0, 0.0]])
    targets = np.array([[3.0, 3.9], [1.0, 4.9], [2.0, 2.0]])
    r = np.linalg.norm(targets[:, None] - sensors, axis=-1)
    expected = signal.variance(models, sensors, targets=targets[:, None])
    np.testing.assert_allclose(signal.variance_at(models, r), expected)
    one = SignalModel(placement_sigma_m=0.3)
    alone = signal.variance(one, sensors, targets=targets[:, None])
    np.testing.assert_allclose(signal.variance_at(one, r), alone)


def test_a_bound_of_part_of_a_state_is_the_block_of_the_inverse():
    rng = np.random.default_rng(5)
    J = fisher_information(rng.normal(size=(7, 6, 4)))
    bound = position_bound(J, 2)
    assert bound.determined.all()
    np.testing.assert_allclose(bound.covariance, np.linalg.inv(J)[:, :2, :2], rtol=1e-8)
    no_velocity = np.zeros((4, 4))
    no_velocity[:2, :2] = J[0, :2, :2]
    alone = position_bound(no_velocity, 2)
    assert alone.determined
    np.testing.assert_allclose(alone.covariance, np.linalg.inv(J[0, :2, :2]))


def test_more_readings_never_make_the_bound_worse_and_one_bearing_completes_one_range():
    sensors, p, _ = fields(6, len(MIXED), 2)
    gains = reading_gains(MIXED, sensors, p)
    J = [fisher_information(gains[:k]) for k in range(1, len(MIXED) + 1)]
    least = [np.linalg.eigvalsh(b - a).min() for a, b in pairwise(J)]
    assert min(least) > -1e-9
    together = reading_gains(
        (RangeModel(sigma_m=0.2), BearingModel(sigma_rad=0.05)),
        np.zeros((2, 2)),
        np.array([4.0, 0]),
    )
    bound = position_bound(fisher_information(together))
    assert bound.determined
    np.testing.assert_allclose(bound.covariance, np.diag([0.04, 0.04]), atol=1e-12)


def site(positions, **target):
    return Site(
        name="mixed",
        sensor_ids=tuple(f"S{i}" for i in range(len(positions))),
        positions=positions,
        models=MIXED[: len(positions)],
        target=Target(**target),
    )


def test_a_site_has_its_own_height_and_sensors_without_one_stand_at_it():
    sensors, p, v = fields(7, len(MIXED), 3)
    flat = site(sensors)
    np.testing.assert_allclose(site_gains(flat, p[:2]), reading_gains(MIXED, sensors[:, :2], p[:2]))
    high = site(sensors, height_m=1.5)
    expected = reading_gains(MIXED, sensors, p[:2], height_m=1.5)
    np.testing.assert_allclose(site_gains(high, p[:2]), expected)
    np.testing.assert_allclose(site_gains(flat, p[:2], height_m=1.5), expected)
    on_plane = sensors.copy()
    on_plane[:, 2] = np.nan
    np.testing.assert_allclose(
        site_gains(site(on_plane, height_m=9.0), p[:2]), site_gains(flat, p[:2])
    )
    some = np.array([6, 2])
    np.testing.assert_allclose(site_gains(high, p[:2], chosen=some), expected[some])
    solid = site(sensors, dimensions=3)
    state = np.concatenate([p, v])
    np.testing.assert_allclose(
        site_information(solid, state), fisher_information(reading_gains(MIXED, sensors, state))
    )
    with pytest.raises(InputError, match="in space"):
        site_gains(solid, state, height_m=1.0)


def test_a_prior_on_the_velocity_lets_rates_tell_the_place():
    sensors, p, v = fields(8, 3, 2)
    rates = Site(
        name="rates",
        sensor_ids=("a", "b", "c"),
        positions=np.column_stack([sensors, np.full(3, np.nan)]),
        models=(AngularRateModel(),) * 3,
    )
    state = np.concatenate([p, v])
    assert not site_bound(rates, state).determined
    prior = np.diag([0.0, 0.0, 1.0, 1.0])
    found = site_bound(rates, state, prior=prior)
    assert found.determined
    full = np.linalg.inv(site_information(rates, state) + prior)
    np.testing.assert_allclose(found.covariance, full[:2, :2], rtol=1e-6)


@pytest.mark.parametrize(
    ("sensors", "states", "height", "words"),
    [
        ((3, 2), (3,), None, "expected"),
        ((3,), (2,), None, "expected"),
        ((3, 2), (2,), 1.0, "three coordinates"),
        ((3, 3), (3,), 1.0, "with a height"),
        ((3, 3), (2,), None, "expected"),
        ((3, 2), (), None, "expected"),
        ((2, 2), (2,), None, "3 models for 2 sensors"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(sensors, states, height, words):
    with pytest.raises(InputError, match=words):
        reading_gains(MIXED[:3], np.zeros(sensors), np.ones(states), height_m=height)


def test_pairs_must_be_pairs_and_values_finite():
    with pytest.raises(InputError, match="3 sensors"):
        pair_gains(MIXED[:3], np.zeros((3, 2)), np.ones((2, 2)))
    with pytest.raises(InputError, match="finite"):
        reading_gains(MIXED[:3], np.zeros((3, 2)), np.array([np.nan, 0.0]))


@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.sampled_from([1e-3, 1.0, 1e4]))
def test_fewer_readings_than_unknowns_leave_the_position_free_whatever_rounding_says(seed, m, unit):
    rng = np.random.default_rng(seed)
    gains = rng.normal(size=(50, m, 4)) * np.exp(2.0 * rng.normal(size=(50, m, 1)))
    gains *= [unit, unit, 1.0, 1.0]
    assert not position_bound(fisher_information(gains), 2).determined.any()
    known = np.concatenate([gains, np.tile(np.eye(4)[2:], (50, 1, 1))], axis=1)  # the velocity
    followed = position_bound(fisher_information(known), 2).determined
    assert followed.mean() > 0.8 if m >= 2 else not followed.any()
