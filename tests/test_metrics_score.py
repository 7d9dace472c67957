"""Scoring: matching by target and time, errors, time covered, honesty of covariances."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from trackfield.errors import InputError
from trackfield.metrics.consistency import (
    INSIDE_95,
    clipped_nis,
    distances2,
    nees,
    share_inside,
)
from trackfield.metrics.error import availability, match, shown, summarize, truth_at
from trackfield.metrics.score import score, scores_by_target
from trackfield.types import Status, Tracks, Truth


def make_truth(t, position, target=None, names=("a",)):
    t = np.asarray(t, float)
    position = np.asarray(position, float)
    if position.shape[1] == 2:
        position = np.column_stack([position, np.full(t.size, np.nan)])
    target = np.zeros(t.size, np.int32) if target is None else np.asarray(target, np.int32)
    return Truth(t, target, position, names)


def make_tracks(t, position, *, target=None, names=("a",), status=None, covariance=None):
    t = np.asarray(t, float)
    n = t.size
    position = np.column_stack([np.asarray(position, float)[:, :2], np.full(n, np.nan)])
    target = np.zeros(n, np.int32) if target is None else np.asarray(target, np.int32)
    return Tracks(
        t_s=t,
        track=target,
        position=position,
        velocity=np.zeros((n, 3)),
        covariance=np.tile([1.0, 0.0, 1.0], (n, 1)) if covariance is None else covariance,
        status=np.full(n, Status.CONFIRMED, np.int32) if status is None else np.array(status),
        target=target,
        nis=np.full(n, np.nan),
        target_ids=names,
    )


LINE = make_truth(np.arange(0.0, 10.5, 0.5), np.column_stack([np.arange(21.0), np.zeros(21)]))


def test_truth_between_samples_is_the_straight_line():
    times = np.random.default_rng(1).uniform(0, 10, 50)
    found = truth_at(LINE, 0, times=times)
    np.testing.assert_allclose(found[:, 0], np.interp(times, LINE.t_s, LINE.position[:, 0]))


def test_truth_is_neither_extrapolated_nor_bridged_over_a_gap():
    truth = make_truth([0, 0.5, 5, 5.5], [[0, 0], [1, 0], [9, 0], [8, 0]])
    times = np.array([-0.1, 0, 0.25, 0.5, 0.6, 4.9, 5, 5.5, 5.6])
    found = truth_at(truth, 0, times=times)[:, 0]
    np.testing.assert_allclose(found, [np.nan, 0, 0.5, 1, np.nan, np.nan, 9, 8, np.nan])
    assert not np.isnan(truth_at(truth, 0, times=times[1:-1], max_gap_s=4.5)[:, 0]).any()


def test_truth_needs_no_order_and_bears_repeated_times():
    truth = make_truth([1, 0, 0.5, 0.5], [[2, 0], [0, 0], [1, 0], [1, 0]])
    np.testing.assert_allclose(truth_at(truth, 0, times=np.array([0.25, 0.75]))[:, 0], [0.5, 1.5])


def test_a_single_sample_of_truth_counts_at_its_own_time_only():
    truth = make_truth([2], [[1, 1]])
    found = truth_at(truth, 0, times=np.array([1.9, 2.0, 2.1]))[:, 0]
    np.testing.assert_array_equal(found, [np.nan, 1.0, np.nan])


def test_rows_are_matched_by_the_name_of_their_target_not_by_its_number():
    truth = make_truth([0, 1, 0, 1], [[0, 0], [0, 0], [5, 5], [5, 5]], [0, 0, 1, 1], ("a", "b"))
    tracks = make_tracks(
        [0.5, 0.5, 0.5], [[5, 6], [2, 0], [7, 7]], target=[0, 1, 2], names=("b", "a", "c")
    )
    found = scores_by_target(truth, tracks)
    assert {name: one.rmse_m for name, one in found.items()} == {"a": 2.0, "b": 1.0}
    assert score(truth, tracks).rows == 2
    assert score(truth, tracks, target="b").rmse_m == 1.0


def test_an_only_target_is_that_of_an_only_truth_whatever_they_are_called():
    assert score(LINE, make_tracks([1.0], [[2, 3]], names=("b",))).rmse_m == 3.0
    assert match(LINE, make_tracks([1.0], [[2, 3]], names=("b", "c"))).row.size == 0


def test_nameless_rows_are_those_of_the_only_target():
    tracks = make_tracks([1.0], [[2, 3]], target=[-1], names=())
    assert score(LINE, tracks).rmse_m == 3.0
    two = make_truth([0, 1], [[0, 0], [1, 1]], [0, 1], ("a", "b"))
    assert match(two, tracks).row.size == 0


def test_only_confirmed_and_coasting_rows_are_shown():
    status = [Status.TENTATIVE, Status.CONFIRMED, Status.COASTING, Status.ENDED]
    tracks = make_tracks([1, 2, 3, 4], [[9, 9], [4, 0], [6, 0], [9, 9]], status=status)
    np.testing.assert_array_equal(shown(tracks), [False, True, True, False])
    assert score(LINE, tracks).rmse_m == 0.0
    assert score(LINE, tracks).rows == 2


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=30))
def test_errors_are_summarized_as_by_hand(errors):
    found = summarize(np.array(errors))
    distance = [math.hypot(x, y) for x, y in errors]
    assert found.rmse_m == pytest.approx(math.sqrt(sum(d * d for d in distance) / len(distance)))
    assert found.median_m == pytest.approx(float(np.median(distance)))
    assert found.p95_m == pytest.approx(float(np.quantile(distance, 0.95)))


def test_errors_are_horizontal_and_heights_are_told_apart():
    truth = make_truth([0, 1], [[0, 0, 1.0], [0, 0, 1.0]])
    tracks = make_tracks([0, 1], [[3, 4], [3, 4]])
    assert score(truth, tracks).height_rmse_m is None
    tracks.position[:, 2] = 3.0
    found = score(truth, tracks)
    assert (found.rmse_m, found.height_rmse_m) == (5.0, 2.0)


def test_distances_are_those_of_a_solver():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(40, 2, 2))
    covariance = root @ root.transpose(0, 2, 1) + 0.01 * np.eye(2)
    error = rng.normal(size=(40, 2))
    packed = covariance[:, [0, 0, 1], [0, 1, 1]]
    by_solver = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    np.testing.assert_allclose(distances2(error, packed), by_solver)


def test_right_covariances_give_nees_2_and_95_percent_inside():
    rng = np.random.default_rng(3)
    covariance = np.array([[2.0, 0.7], [0.7, 1.0]])
    error = rng.multivariate_normal([0, 0], covariance, size=20_000)
    d2 = distances2(error, np.tile([2.0, 0.7, 1.0], (20_000, 1)))
    assert nees(d2) == pytest.approx(2.0, abs=0.06)  # 4 sigma: sigma = 2/sqrt(20000)
    assert share_inside(d2) == pytest.approx(0.95, abs=0.006)
    assert pytest.approx(stats.chi2(2).ppf(0.95)) == INSIDE_95


@pytest.mark.parametrize("packed", [[0.0, 0, 0], [1, 1, 1], [-1, 0, -1], [1, 2, 1]])
def test_what_is_no_covariance_holds_nothing_and_is_no_number(packed):
    tracks = make_tracks([1.0, 2.0], [[2, 0], [4, 0]], covariance=np.array([packed, packed], float))
    found = score(LINE, tracks)
    assert found.inside_95 == 0.0
    assert found.nees is None
    json.dumps(found.to_dict(), allow_nan=False)


def test_one_gross_innovation_counts_as_three_sigma():
    assert clipped_nis(np.array([1.0, 1e9, np.nan])) == 5.0
    assert clipped_nis(np.array([np.nan])) is None
    x = stats.norm.rvs(size=20_000, random_state=4)
    clipped = stats.norm.expect(lambda v: min(v * v, 9.0))
    assert clipped_nis(x**2) == pytest.approx(clipped, abs=0.04)


def test_availability_is_the_share_of_time_with_a_fresh_position():
    t = np.arange(0.0, 100.0, 0.1)
    truth = make_truth(t, np.zeros((t.size, 2)))
    status = np.where((t >= 10) & (t < 35), Status.TENTATIVE, Status.CONFIRMED)
    tracks = make_tracks(t, np.zeros((t.size, 2)), status=status)
    # 25 s without a shown row, of which the last position before covers the first second.
    assert availability(truth, tracks, target=0) == pytest.approx(1 - 0.24, abs=0.002)


def test_availability_counts_outages_but_not_the_time_outside_the_tracks():
    t = np.arange(0.0, 100.0, 0.1)
    truth = make_truth(t, np.zeros((t.size, 2)))
    rows = t[((t >= 20) & (t < 40)) | ((t >= 50) & (t < 60))]
    tracks = make_tracks(rows, np.zeros((rows.size, 2)))
    assert availability(truth, tracks, target=0) == pytest.approx(31 / 40, abs=0.01)


def test_availability_of_thinned_tracks_is_that_of_the_whole():
    t = np.arange(0.0, 100.0, 0.1)
    truth = make_truth(t, np.zeros((t.size, 2)))
    assert availability(truth, make_tracks(t[::50], np.zeros((20, 2))), target=0) == 1.0


def test_availability_without_a_shown_row_is_none_at_all():
    tracks = make_tracks([1.0, 2.0], [[2, 0], [4, 0]], status=[Status.TENTATIVE] * 2)
    assert availability(LINE, tracks, target=0) == 0.0
    empty = make_tracks([], np.empty((0, 2)))
    assert availability(LINE, empty, target=0) == 0.0


def test_a_target_that_was_never_tracked_lowers_availability_by_its_time():
    t = np.arange(0.0, 10.0, 0.5)
    truth = make_truth(np.tile(t, 2), np.zeros((40, 2)), np.repeat([0, 1], 20), names=("a", "b"))
    tracks = make_tracks(t, np.zeros((20, 2)), names=("a",))
    assert score(truth, tracks).availability == 0.5
    assert score(truth, tracks, target="a").availability == 1.0


@pytest.mark.parametrize(
    ("truth", "tracks", "message"),
    [
        (make_truth([], np.empty((0, 2)), names=()), make_tracks([1], [[0, 0]]), "holds no rows"),
        (LINE, make_tracks([1], [[0, 0]], status=[0]), "none of the 1 rows .* is confirmed"),
        (LINE, make_tracks([99], [[0, 0]]), "tracks at 99 to 99 s, truth at 0 to 10 s"),
        (LINE, make_tracks([1], [[0, 0]], names=("z", "y")), "tracks of z, y, truth of a"),
    ],
)
def test_nothing_to_score_says_why(truth, tracks, message):
    with pytest.raises(InputError, match=message):
        score(truth, tracks)


def test_an_unknown_target_is_told_with_the_known_ones():
    with pytest.raises(InputError, match="found no target 'z' in the truth, expected one of: a"):
        score(LINE, make_tracks([1], [[0, 0]]), target="z")
