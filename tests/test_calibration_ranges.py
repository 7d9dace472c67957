"""Calibration finds what a simulated run was made with, and says how sure it is."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from trackfield.calibration.ranges import Calibration, calibrate
from trackfield.errors import InputError
from trackfield.network.site import Site, Target
from trackfield.sensing.range import UNCALIBRATED, RangeModel, correlated_errors
from trackfield.sensing.range_residuals import (
    correlation,
    displacement_sigma,
    fit_bias_and_scale,
    robust_sigma,
)
from trackfield.types import Readings, Truth, select_rows

SENSORS = np.array(
    [[0, 0, 2.5], [10, 0, 2.0], [0, 8, 2.2], [10, 8, 2.4], [5, -2, 2.0], [5, 10, 2.5]]
)
IDS = tuple("abcdef")
SITE = Site("room", IDS, SENSORS, (UNCALIBRATED,) * 6, Target(height_m=None))
Array = NDArray[np.float64]


class World(NamedTuple):
    """What a run is made with."""

    bias: Any = 0.2
    scale: float = 0.03
    sigma: float = 0.08
    clock_s: float = 0.0  # truth's clock is ahead of the readings' by this
    correlated: float = 0.0
    length: float = 1.0
    outliers: float = 0.0
    lever: tuple[float, float] = (0.0, 0.0)  # of the antenna beside the tracked point


def path(t: Array) -> Array:
    return np.stack([5 + 4 * np.cos(0.25 * t), 4 + 3 * np.sin(0.4 * t), 1 + 0.2 * np.sin(t)], 1)


def run(
    world: World, seed: int = 0, *, steps: int = 900, target: str = "tag"
) -> tuple[Readings, Truth]:
    rng = np.random.default_rng(seed)
    t = np.arange(steps) * 0.1
    antenna = path(t) + np.array([*world.lever, 0.0])
    r = np.linalg.norm(antenna[:, None] - SENSORS, axis=2)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path(t), axis=0), axis=1))])
    model = RangeModel(
        correlated_sigma_m=world.correlated, correlation_length_m=world.length, sigma_m=world.sigma
    )
    z = (1 + world.scale) * r + np.broadcast_to(world.bias, 6)
    z += world.sigma * rng.standard_normal(r.shape)
    z += correlated_errors(model, way, sensors=6, rng=rng)
    z += (rng.random(r.shape) < world.outliers) * rng.exponential(3.0, r.shape)
    n = z.size
    readings = Readings(
        np.repeat(t - world.clock_s, 6),
        np.tile(np.arange(6, dtype=np.int32), steps),
        z.ravel(),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.full(n, np.nan),
        np.full(n, np.nan),
        IDS,
        (target,),
        ("range",),
    )
    fine = np.arange(-2.0, t[-1] + 2.0, 0.05)
    truth = Truth(fine, np.zeros(fine.size, np.int32), path(fine), (target,))
    return readings, truth


def learn(world: World, seed: int = 0, **options: Any) -> Calibration:
    return calibrate(SITE, *run(world, seed), **options)


def test_bias_scale_and_noise_within_their_errors():
    deviations = []
    for seed in range(12):
        found = learn(World(), seed)
        row = found.sensors[0]
        deviations.append((row.scale - 0.03) / row.scale_error)
        for one in found.sensors:
            assert one.bias_m == pytest.approx(0.2, abs=0.05)
            assert one.sigma_m == pytest.approx(0.08, rel=0.15)
            assert one.readings == 900
        assert found.used == found.given == 5400
        assert found.clock_offset_s == {"tag": 0.0}
        assert found.site.models[0].clock_offset_s == 0.0
    assert 0.4 < float(np.sqrt(np.mean(np.square(deviations)))) < 1.8


def test_gross_errors_do_not_move_it():
    found = learn(World(outliers=0.1))
    assert found.sensors[0].scale == pytest.approx(0.03, abs=0.01)
    assert all(row.bias_m == pytest.approx(0.2, abs=0.06) for row in found.sensors)
    assert all(row.sigma_m == pytest.approx(0.08, rel=0.3) for row in found.sensors)


def test_sensors_differ_and_are_shrunk_towards_each_other():
    own = np.array([0.0, 0.1, -0.1, 0.3, -0.2, 0.05])
    found = learn(World(bias=0.2 + own))
    bias = np.array([row.bias_m for row in found.sensors])
    assert np.corrcoef(bias, own)[0, 1] > 0.99
    slope = np.polyfit(own, bias, 1)[0]
    assert 0.9 < slope < 1.0  # shrunk, but hardly: the sensors differ by much more than the noise


def test_sensors_that_do_not_differ_share_one_bias():
    bias = [row.bias_m for row in learn(World()).sensors]
    assert np.ptp(bias) < 0.02


@pytest.mark.parametrize("offset", [0.3, -0.12])
def test_the_clock_of_the_truth(offset: float):
    found = learn(World(clock_s=offset))
    assert found.clock_offset_s["tag"] == pytest.approx(offset, abs=0.02)
    assert 0 < found.clock_error_s["tag"] < 0.05
    assert found.site.models[0].clock_offset_s == found.clock_offset_s["tag"]
    assert found.sensors[0].scale == pytest.approx(0.03, abs=0.01)


def test_correlated_errors_are_told_from_white_ones():
    white = learn(World(sigma=0.1)).site.models[0]
    mixed = learn(World(sigma=0.06, correlated=0.09, length=1.5)).site.models[0]
    assert white.correlated_sigma_m == pytest.approx(0.5 * white.sigma_m)  # the least ratio
    assert mixed.correlated_sigma_m > 0.9 * mixed.sigma_m
    assert 0.5 < mixed.correlation_length_m <= 3.0
    total = np.hypot(mixed.sigma_m, mixed.correlated_sigma_m)
    assert total == pytest.approx(np.hypot(0.06, 0.09), rel=0.25)


def test_a_lever_arm_that_turns_shows_as_placement():
    """A constant displacement of the antenna looks like bias in no direction: it is placement."""
    still = learn(World(sigma=0.05)).site.models[0].placement_sigma_m
    moved = learn(World(sigma=0.05, lever=(0.3, 0.0))).site.models[0].placement_sigma_m
    assert still < 0.02
    assert moved > 0.05


def test_several_targets_are_calibrated_one_by_one():
    one, truth_one = run(World(bias=0.1), target="one")
    two, truth_two = run(World(bias=0.4), seed=1, target="two")
    both = Readings(
        *(
            np.concatenate([getattr(one, name), getattr(two, name) + extra])
            for name, extra in (
                ("t_s", 0),
                ("sensor", 0),
                ("value", 0),
                ("target", 1),
                ("kind", 0),
                ("sigma", 0),
                ("arrival_s", 0),
            )
        ),
        IDS,
        ("one", "two"),
        ("range",),
    )
    both = select_rows(both, np.arange(len(both)))
    both.target[len(one) :] = 1
    truth = Truth(
        np.concatenate([truth_one.t_s, truth_two.t_s]),
        np.repeat(np.array([0, 1], np.int32), len(truth_one)),
        np.concatenate([truth_one.position, truth_two.position]),
        ("one", "two"),
    )
    site = calibrate(SITE, both, truth).site
    assert set(site.target_models) == {"one", "two"}
    assert site.target_models["one"][0].bias_m == pytest.approx(0.1, abs=0.05)
    assert site.target_models["two"][0].bias_m == pytest.approx(0.4, abs=0.05)
    assert site.models[0].bias_m == pytest.approx(0.25, abs=0.05)
    assert site.models[0].bias_sigma_m > 0.1  # another tag may be like either


def test_a_sensor_that_was_not_heard_is_only_guessed_at():
    readings, truth = run(World())
    found = calibrate(SITE, select_rows(readings, readings.sensor != 5), truth)
    assert found.sensors[5].readings == 0
    assert found.site.models[5].bias_sigma_m > 0
    assert found.site.models[0].bias_sigma_m == 0


@pytest.mark.parametrize("method", ["weighted", "least squares"])
def test_the_papers_statistics(method: Any):
    found = learn(World(bias=0.1, scale=0.02, sigma=0.05), method=method)
    model = found.site.models[0]
    assert model.bias_m == pytest.approx(0.1, abs=0.03)
    assert model.scale == pytest.approx(0.02, abs=0.006)
    assert np.hypot(model.sigma_m, 5 * model.sigma_scale) == pytest.approx(0.05, rel=0.3)
    assert model.correlated_sigma_m == 0
    assert len({m.bias_m for m in found.site.models}) == 1


def test_readings_without_truth_beside_them_are_left_out():
    readings, truth = run(World())
    holes = select_rows(truth, (truth.t_s < 20) | (truth.t_s > 50))
    found = calibrate(SITE, readings, holes)
    assert found.used == pytest.approx(5400 - 30 * 60, abs=130)
    assert found.residuals.t_s.size == found.used


def test_no_target_in_common_is_said():
    readings, truth = run(World())
    other = Truth(truth.t_s + 1e6, truth.target, truth.position, truth.target_ids)
    with pytest.raises(InputError, match=r"no target with 30 readings beside its truth.*tag"):
        calibrate(SITE, readings, other)


def test_a_fit_over_one_distance_still_answers():
    """The scale cannot be told: it stays near its prior, and the error says so."""
    rng = np.random.default_rng(0)
    r = np.full(300, 5.0)
    fit = fit_bias_and_scale(r, 0.3 + 0.05 * rng.standard_normal(300), np.zeros(300, np.int32), 1)
    assert fit.bias[0] + 5 * fit.scale == pytest.approx(0.3, abs=0.01)
    assert fit.scale_error > 0.05


def test_robust_sigma_is_that_of_the_core():
    rng = np.random.default_rng(0)
    e = 0.1 * rng.standard_normal(4000)
    assert robust_sigma(e) == pytest.approx(e.std(), rel=0.05)
    e[:200] += 50
    assert robust_sigma(e) == pytest.approx(0.1, rel=0.1)
    assert robust_sigma(np.empty(0)) == 0.0


def test_white_residuals_have_no_correlation():
    rng = np.random.default_rng(0)
    share, _ = correlation(
        rng.standard_normal(3000), np.zeros(3000, np.int32), np.arange(3000) * 0.05
    )
    assert share < 0.1


def test_displacement_needs_readings_from_all_sides():
    t = np.zeros(20)
    alike = np.tile([[1.0, 0.0]], (20, 1))
    assert displacement_sigma(np.ones(20), alike, t, white_sigma=0.1) == 0.0


def test_readings_of_another_kind_are_refused():
    readings, truth = run(World(), 0)
    with pytest.raises(InputError, match="found readings of kind rssi, expected range"):
        calibrate(SITE, replace(readings, kinds=("rssi",)), truth)
