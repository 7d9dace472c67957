import numpy as np
import pytest

from trackfield.network.site import Site
from trackfield.sensing.range import Nlos, RangeModel
from trackfield.simulation import tagged
from trackfield.simulation.tagged import World

ANCHORS = np.array([[0.0, 0.0, 2.0], [20.0, 0.0, 2.5], [20.0, 10.0, np.nan], [0.0, 10.0, 3.0]])


def site(**model):
    return Site("hall", ("a", "b", "c", "d"), ANCHORS, (RangeModel(**model),) * 4)


def test_a_table_holds_the_ranges_it_was_made_of():
    ranges = np.array([[[1.0, np.nan], [2.0, 3.0]], [[np.nan, 4.0], [np.nan, np.nan]]])
    table = tagged.to_readings(np.array([0.5, 1.0]), ranges, ("s", "t"), ("x", "y"))
    rows = list(
        zip(
            table.t_s.tolist(),
            (table.target_ids[i] for i in table.target),
            (table.sensor_ids[i] for i in table.sensor),
            table.value.tolist(),
            strict=True,
        )
    )
    assert rows == [
        (0.5, "x", "s", 1.0),
        (0.5, "y", "t", 4.0),
        (1.0, "x", "s", 2.0),
        (1.0, "x", "t", 3.0),
    ]
    assert len(table) == 4
    assert {table.kinds[k] for k in table.kind} == {"range"}
    assert np.isnan(table.sigma).all()
    assert np.isnan(table.arrival_s).all()
    assert table.sensor.dtype == table.target.dtype == table.kind.dtype == np.int32


def test_one_target_needs_no_axis_of_its_own():
    ranges = np.array([[1.0, np.nan], [2.0, 3.0]])
    table = tagged.to_readings(np.array([0.5, 1.0]), ranges, ("s", "t"))
    assert table.value.tolist() == [1.0, 2.0, 3.0]
    assert table.target.tolist() == [0, 0, 0]
    truth = tagged.to_truth(np.array([0.5, 1.0]), np.arange(8.0).reshape(2, 4))
    np.testing.assert_array_equal(truth.position[:, :2], [[0.0, 1.0], [4.0, 5.0]])
    assert np.isnan(truth.position[:, 2]).all()


def test_truth_is_in_order_of_time_then_target():
    states = np.arange(24.0).reshape(2, 3, 4)
    truth = tagged.to_truth(np.array([1.0, 2.0, 3.0]), states, ("x", "y"))
    assert truth.t_s.tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]
    assert truth.target.tolist() == [0, 1] * 3
    np.testing.assert_array_equal(truth.position[3, :2], states[1, 1, :2])


def test_a_world_without_noise_reads_its_own_distances():
    world = World(targets=45, steps=30, height_m=1.0)
    exact = site(sigma_m=0.0, scale=0.1, bias_m=0.3, max_range_m=12.0)
    readings, truth = tagged.wander(np.random.default_rng(0), exact, world)
    assert (np.diff(readings.t_s) >= 0).all()
    row = (np.rint(readings.t_s / 0.1).astype(int) - 1) * 45 + readings.target
    assert (truth.target[row] == readings.target).all()
    anchors = np.where(np.isnan(ANCHORS), 1.0, ANCHORS)[readings.sensor]
    here = np.column_stack([truth.position[row, :2], np.ones(len(readings))])
    distance = np.linalg.norm(here - anchors, axis=1)
    np.testing.assert_allclose(readings.value, 1.1 * distance + 0.3, rtol=1e-12)
    assert distance.max() <= 12.0
    every = (
        np.linalg.norm(truth.position[:, None, :2] - ANCHORS[None, :, :2], axis=-1) ** 2
        + (1.0 - np.where(np.isnan(ANCHORS[:, 2]), 1.0, ANCHORS[:, 2])) ** 2
    )
    assert len(readings) == (every <= 144.0).sum()
    order = np.lexsort((readings.sensor, readings.target, readings.t_s))
    np.testing.assert_array_equal(order, np.arange(len(readings)))


def test_targets_stay_inside_and_move_as_their_velocity_says():
    world = World(targets=50, steps=400, speed_m_s=2.0)
    states = tagged.paths(np.random.default_rng(1), site(), world)
    assert states[..., 0].min() >= 0.0
    assert states[..., 0].max() <= 20.0
    assert states[..., 1].min() >= 0.0
    assert states[..., 1].max() <= 10.0
    moved = np.diff(states[..., :2], axis=1) / 0.1
    mean = (states[:, 1:, 2:] + states[:, :-1, 2:]) / 2
    away = ((states[:, 1:, :2] > 0.6) & (states[:, 1:, :2] < [19.4, 9.4])).all(axis=-1)
    np.testing.assert_allclose(moved[away], mean[away], atol=1e-9)


def test_walls_throw_back_like_mirrors():
    world = World(targets=40, steps=300, speed_m_s=2.0, accel_sigma_m_s2=0.0)
    states = tagged.paths(np.random.default_rng(4), site(), world)
    t = 0.1 * np.arange(300)[:, None]
    for axis, width in ((0, 20.0), (1, 10.0)):
        straight = states[:, 0, axis] + t * states[:, 0, 2 + axis]
        folded = width - np.abs(straight % (2 * width) - width)
        np.testing.assert_allclose(states[..., axis].T, folded, atol=1e-9)


def test_noise_is_that_of_the_site():
    world = World(targets=100, steps=60)
    noisy, truth = tagged.wander(np.random.default_rng(2), site(sigma_m=0.3), world)
    plain, same = tagged.wander(np.random.default_rng(2), site(sigma_m=0.0), world)
    np.testing.assert_array_equal(truth.position, same.position)
    assert (noisy.value - plain.value).std() == pytest.approx(0.3, rel=0.03)
    late, _ = tagged.wander(np.random.default_rng(2), site(sigma_m=0.0), world, nlos=Nlos(0.2, 2.0))
    share = late.value - plain.value > 1e-9
    assert share.mean() == pytest.approx(0.2, abs=0.02)


def test_a_world_of_many_targets_is_made_in_seconds_not_minutes():
    readings, truth = tagged.wander(np.random.default_rng(3), site(), World(targets=200, steps=500))
    assert len(readings) == 400_000
    assert len(truth) == 100_000
