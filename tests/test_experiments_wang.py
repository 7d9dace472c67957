"""The reproduction's quick form: its claims, its bookkeeping, its figures."""

import json
import math

import numpy as np
import pytest

from trackfield.experiments import wang, wang_contest, wang_roads, wang_testbed
from trackfield.experiments.wang_roads import (
    ADDITIVE,
    EKF,
    IEKF,
    LAGGED,
    LIVE,
    MLE,
    PAPER,
    ROBUST,
    SAFE,
    THREE,
)
from trackfield.experiments.wang_tables import (
    BAD_START,
    BOUND,
    MATCHED,
    ROADS,
    TESTBED,
    TESTBED_BETTER,
    blocked,
)
from trackfield.filtering import converted, extended
from trackfield.filtering.converted import Mode
from trackfield.localization.range_likelihood import RangeScan
from trackfield.simulation import roads
from trackfield.types import Gaussian


@pytest.fixture(scope="module")
def shares():
    return []


@pytest.fixture(scope="module")
def found(shares):
    return wang.reproduce(np.random.default_rng(0), quick=True, progress=shares.append)


def rmse(found, part, name):
    return found.scores[part][name].rmse.value


def gain(found, part, name):
    return found.scores[part][name].gain.value


@pytest.mark.parametrize("part", [MATCHED, "A-B-D", "A-B-C"])
def test_against_a_correct_extended_filter_there_is_no_gain(found, part):
    assert -8.0 < gain(found, part, EKF) < 3.0
    assert found.scores[part][EKF].gain.high < 8.0  # the paper: 15


def test_about_fifteen_percent_appear_against_a_crippled_filter(found):
    assert 9.0 < gain(found, "A-B-D", ADDITIVE) < 20.0
    assert 5.0 < gain(found, MATCHED, ADDITIVE) < 20.0
    for part in (MATCHED, *ROADS.values()):
        assert 12.0 < gain(found, part, THREE) < 32.0


@pytest.mark.parametrize("part", [MATCHED, "A-B-D", "A-B-C"])
def test_the_gain_over_likelihood_alone_is_real(found, part):
    assert 40.0 < gain(found, part, MLE) < 66.0
    assert found.scores[part][MLE].gain.low > 35.0


def test_a_filter_without_the_multiplicative_noise_deceives_itself(found):
    assert found.scores[MATCHED][ADDITIVE].nees > 10.0
    assert found.scores[MATCHED][IEKF].nees == pytest.approx(4.0, abs=0.6)


def test_matched_filters_reach_the_bound(found):
    for name in (PAPER, EKF, IEKF):
        assert 0.9 < rmse(found, MATCHED, name) / rmse(found, MATCHED, BOUND) < 1.1


def test_what_iterating_buys_is_bad_starts(found):
    for name in (IEKF, SAFE):
        assert rmse(found, BAD_START, name) < 1.2 * rmse(found, BAD_START, BOUND)
    assert rmse(found, BAD_START, EKF) > 2.5 * rmse(found, BAD_START, BOUND)


def test_on_the_testbed_less_process_noise_is_better(found):
    assert rmse(found, TESTBED_BETTER, PAPER) < 0.93 * rmse(found, TESTBED, PAPER)
    for part in (TESTBED, TESTBED_BETTER):
        assert rmse(found, part, PAPER) == pytest.approx(rmse(found, part, EKF), rel=0.03)
        assert rmse(found, part, PAPER) < 0.7 * rmse(found, part, MLE)


def test_the_default_tracker_is_better_than_the_papers_filter(found):
    for road in ROADS.values():
        assert rmse(found, road, LIVE) < rmse(found, road, PAPER)
        assert rmse(found, road, LAGGED) < 0.6 * rmse(found, road, PAPER)
        assert rmse(found, blocked(road), LIVE) < 0.5 * rmse(found, blocked(road), PAPER)
        assert rmse(found, blocked(road), ROBUST) < 0.7 * rmse(found, blocked(road), PAPER)


def test_tables_show_claims_beside_what_was_found(found):
    road = next(t for t in found.tables if "A-B-C" in t.columns or "A-B-C" in t.title)
    rows = {row[0]: row for row in road.rows}
    assert rows[EKF][-1] == "14.87"
    assert rows[MLE][-1] == "31.19"
    assert rows[EKF][1] == f"{rmse(found, 'A-B-C', EKF):.4f}"
    assert rows[EKF][3] == f"{gain(found, 'A-B-C', EKF):.1f}"
    for table in found.tables:
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert all(
            isinstance(cell, str) and "nan" not in cell for row in table.rows for cell in row
        )
    assert f"{gain(found, 'A-B-C', EKF):.1f} %" in found.findings[0]


def test_the_result_is_plain_json(found):
    again = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert again["scores"]["A-B-D"][EKF]["gain"]["value"] == gain(found, "A-B-D", EKF)
    assert again["tables"][0]["title"].startswith("4.2")
    assert len(again["findings"]) == 5


def test_progress_rises_to_one(found, shares):
    assert shares == sorted(shares)
    assert shares[0] > 0.0
    assert shares[-1] == 1.0


def test_figures_are_drawn(found, tmp_path):
    pytest.importorskip("matplotlib")
    drawn = found.figures()
    assert set(drawn) == {"testbed", "road_d", "road_c", "bad_start"}
    for name, figure in drawn.items():
        figure.savefig(tmp_path / f"{name}.png", dpi=40)
        assert (tmp_path / f"{name}.png").stat().st_size > 2000
    lines = {line.get_label() for line in drawn["road_c"].axes[-1].lines}
    assert {PAPER, EKF, MLE, LIVE} <= lines


def test_following_is_stepping():
    race = wang_roads.road(np.random.default_rng(1), "D", runs=3, from_m=60.0)
    followed = wang_contest.follow(wang_roads.RULES[SAFE], race)
    belief = Gaussian(race.start.mean, np.broadcast_to(race.start.covariance, (3, 4, 4)))
    for k in range(10):
        scan = RangeScan(race.drive.sensors, race.ranges[:, k], race.model)
        belief, info = converted.step(
            belief, scan, motion=race.motion, dt_s=race.dt_s, mode=Mode.SAFE
        )
        np.testing.assert_allclose(followed.position[k], belief.mean[:, :2], atol=1e-9)
        ok = info.prelocalized.ok
        np.testing.assert_allclose(
            followed.prelocalized[k][ok], info.prelocalized.position[ok], atol=1e-9
        )
        error = belief.mean - race.drive.truth[k]
        nees = [e @ np.linalg.inv(P) @ e for e, P in zip(error, belief.covariance, strict=True)]
        np.testing.assert_allclose(followed.nees[k], nees, rtol=1e-6)


def test_the_crippled_filters_are_crippled_as_they_say():
    rng = np.random.default_rng(2)
    sensors = rng.uniform(0, 4, (5, 2))
    prior = Gaussian(np.array([[2.0, 2.0, 0.0, 0.0]]), np.eye(4)[None])
    z = rng.uniform(1, 3, (1, 5))
    three = wang_contest.ekf_three(prior, z, sensors, roads.RANGES).belief
    near = np.sort(np.argsort(z[0])[:3])
    alone = extended.update(prior, z[:, near], extended.Ranges(sensors[near], roads.RANGES))
    np.testing.assert_allclose(three.mean, alone.posterior.mean, rtol=1e-12)
    additive = wang_contest.ekf_additive(prior, z, sensors, roads.RANGES).belief
    plain = extended.update(
        prior, z, extended.Ranges(sensors, roads.RANGES), variance=np.full((1, 5), 1e-3)
    )
    np.testing.assert_allclose(additive.mean, plain.posterior.mean, rtol=1e-9)


def test_gains_are_paired_and_their_intervals_cover():
    rng = np.random.default_rng(3)
    covered = 0
    for _ in range(200):
        level = rng.chisquare(5, 40)  # runs differ much, filters little
        theirs = level * (1 + 0.1 * rng.standard_normal(40))
        ours = 0.81 * level * (1 + 0.1 * rng.standard_normal(40))
        found = wang_contest.gain(ours, theirs, wang_contest.picks(rng, 40))
        assert found.low < found.value < found.high
        assert found.high - found.low < 8.0
        covered += found.low < 10.0 < found.high
    assert 0.88 < covered / 200 < 0.99
    same = wang_contest.gain(theirs, theirs, wang_contest.picks(rng, 40))
    assert tuple(same) == (0.0, 0.0, 0.0)


def test_errors_are_per_axis():
    drive = roads.follow_road(np.random.default_rng(4), "D", from_m=65.0)
    off = drive.truth[:, None, :2] + np.array([0.3, 0.4])
    square = wang_contest.squares(off, drive)
    np.testing.assert_allclose(square, 0.125)
    found = wang_contest.rmse(np.full(7, 0.125), wang_contest.picks(np.random.default_rng(5), 7))
    assert found.value == pytest.approx(math.sqrt(0.125))


def test_the_robot_goes_round_two_circles():
    drive = wang_testbed.drive()
    x, y = drive.truth[:, :2].T
    first = drive.t_s < 2 * math.pi / 0.122
    np.testing.assert_allclose(np.hypot(x - 1.0, y - 0.65)[first], 0.35, atol=1e-12)
    np.testing.assert_allclose(np.hypot(x - 1.0, y - 1.35)[~first], 0.35, atol=1e-12)
    assert y[0] < 1.0  # clockwise from the top of the lower circle
    assert x[1] > x[0] > 1.0
    assert y[~first][-1] == pytest.approx(1.0, abs=0.01)
    steps = np.diff(drive.truth[:, :2], axis=0) / 0.2
    mean = (drive.truth[1:, 2:] + drive.truth[:-1, 2:]) / 2
    np.testing.assert_allclose(steps, mean, atol=1e-3)
    np.testing.assert_allclose(drive.start, wang_testbed.START, atol=2e-4)


def test_bad_starts_are_two_metres_off_and_say_so():
    races = wang_roads.bad_starts(np.random.default_rng(6), wang_roads.Part(2, 5, 20))
    assert len(races) == 2
    for race in races:
        off = np.abs(race.start.mean[:, :2] - race.drive.start[:2])
        np.testing.assert_allclose(off, 2.0)
        assert race.start.covariance[0, 0] == 4.0
