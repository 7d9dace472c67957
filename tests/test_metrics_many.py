"""Scores of many targets as one call: steps, tolerance, statuses, other scorers, and bad input."""

import json
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benches import load
from score_runs import make_tracks, make_truth, random_run
from trackfield.errors import InputError
from trackfield.metrics.cardinality import cardinality
from trackfield.metrics.many import Measure, asks_for_many, followed, score_many, score_steps
from trackfield.metrics.steps import pairs, side_by_side
from trackfield.types import Status, select_rows

BOTH = [(t, who, float(t), 10.0 * who) for t in range(20) for who in (0, 1)]


def scored(truth, tracks, **options):
    return score_many(make_truth(truth), make_tracks(tracks), **options)


def test_perfect_tracks_have_the_best_of_all_scores():
    found = scored(BOTH, BOTH).to_dict()
    best = {
        "ospa_m": 0, "gospa_m": 0, "localisation": 0, "missed": 0, "false": 0, "mota": 1,
        "motp_m": 0, "idf1": 1, "idp": 1, "idr": 1, "switches": 0, "fragments": 0,
        "completeness": 1, "ambiguity": 1, "spuriousness": 0, "position_error_m": 0,
        "breaks_per_s": 0, "longest_segment": 1, "cardinality_error": 0, "cardinality_bias": 0,
        "steps": 20, "targets": 2, "tracks": 2, "off_steps": 0, "cutoff_m": 5, "match_m": 5,
    }  # fmt: skip
    assert {name: found[name] for name in best} == best
    json.dumps(found, allow_nan=False)


def test_a_swap_costs_nothing_but_identities():
    swapped = [(t, (who + (t >= 10)) % 2, x, y) for t, who, x, y in BOTH]
    one, other = scored(BOTH, BOTH), scored(BOTH, swapped)
    assert other.sets == one.sets
    assert (other.clear_mot.switches, other.identity.idf1) == (2, 0.5)
    assert other.siap.longest_segment == pytest.approx(9 / 19)


def test_as_the_shared_scorers(shared):
    bench = load(shared / "bench" / "metrics.py")
    scorer = load(shared / "golden" / "lochness" / "scorer.py")
    agreed = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth, tracks = random_run(rng, targets=5, side_m=30.0)
        steps = side_by_side(make_truth(truth), make_tracks(tracks), times_s=np.arange(25.0))
        ours = score_steps(steps, measure=Measure(match_m=3.0))
        grid = np.full((5, 25, 2), np.nan)
        for t, who, x, y in truth:
            grid[who, int(t)] = x, y
        numbers = sorted({row[1] for row in tracks})
        lists = [{t: (x, y) for t, who, x, y in tracks if who == number} for number in numbers]
        theirs = bench.evaluate(grid, lists, c=5.0, p=2, thr=3.0)
        assert ours.sets.ospa_m == pytest.approx(theirs["ospa"], rel=1e-12)
        assert ours.sets.gospa_m == pytest.approx(theirs["gospa"], rel=1e-12)
        assert ours.sets.missed == pytest.approx(theirs["missed"])
        assert ours.sets.false == pytest.approx(theirs["false"])
        assert ours.siap[:3] == pytest.approx(
            [theirs[name] for name in ("completeness", "ambiguity", "spuriousness")]
        )
        other = score_steps(steps)
        theirs = scorer.score(np.array(truth), np.array(tracks), c=5.0, T=25)
        assert other.sets.gospa_m == pytest.approx(theirs["gospa"], rel=1e-12)
        assert other.sets.ospa_m == pytest.approx(theirs["ospa"], rel=1e-12)
        assert other.cardinality.cardinality_error == pytest.approx(theirs["card_err"])
        # It forgets a target's track as soon as it is missed: the same where that is no matter.
        agreed += other.clear_mot.mota == pytest.approx(theirs["mota"])
    assert agreed >= 10


def test_values_over_time_have_the_means_that_are_told():
    truth, tracks = random_run(np.random.default_rng(3))
    found = scored(truth, tracks)
    assert found.t_s.size == found.extent.steps == found.over_time.gospa_m.size
    assert found.sets.gospa_m == pytest.approx(np.mean(found.over_time.gospa_m))
    assert found.sets.false == pytest.approx(np.mean(found.over_time.false))


def test_cardinality_is_signed_and_not():
    tracks = [row for row in BOTH if row[0] >= 5] + [(t, 9, 50.0, 0.0) for t in range(15)]
    steps = side_by_side(make_truth(BOTH), make_tracks(tracks))
    found = cardinality(steps)
    assert found.cardinality_bias == pytest.approx((5 * -1 + 10 * 1 + 5 * 0) / 20)
    assert found.cardinality_error == pytest.approx(15 / 20)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.randoms(use_true_random=False))
def test_the_order_of_rows_says_nothing(seed, random):
    truth, tracks = random_run(np.random.default_rng(seed), targets=3, false=2)
    one = scored(truth, tracks).to_dict()
    random.shuffle(truth)
    random.shuffle(tracks)
    assert scored(truth, tracks).to_dict() == pytest.approx(one)


def test_only_shown_rows_count():
    tracks = make_tracks(BOTH)
    status = np.where(tracks.t_s < 5, Status.TENTATIVE, Status.COASTING)
    status[tracks.t_s >= 15] = Status.ENDED
    found = score_many(make_truth(BOTH), make_tracks(BOTH, status=status))
    shown = scored(BOTH, [row for row in BOTH if 5 <= row[0] < 15])
    assert found.to_dict() == shown.to_dict()
    assert found.clear_mot.misses == 20


def test_a_row_belongs_to_the_nearest_step_within_the_tolerance():
    late = [(t + 0.3, who, x, y) for t, who, x, y in BOTH]
    assert scored(BOTH, late).to_dict() == scored(BOTH, BOTH).to_dict()
    strict = scored(BOTH, late + BOTH[:2], tolerance_s=0.2)
    assert (strict.extent.off_steps, strict.clear_mot.matches) == (40, 2)
    half = [(t + 0.5, who, x, y) for t, who, x, y in BOTH[:-2]]  # belongs to the step that comes
    steps = side_by_side(make_truth(BOTH), make_tracks(half))
    assert sorted(set(steps.shown.step.tolist())) == list(range(1, 20))
    assert steps.shown.position[:, 0].tolist() == np.repeat(np.arange(19.0), 2).tolist()


def test_of_several_rows_of_a_track_at_a_step_the_nearest_counts_then_the_last():
    tracks = [(1.0, 0, 1.0, 7.0), (1.0, 0, 1.0, 8.0), (1.2, 0, 1.0, 9.0), (0.8, 0, 1.0, 3.0)]
    steps = side_by_side(make_truth(BOTH), make_tracks(tracks))
    assert steps.shown.position.tolist() == [[1.0, 8.0]]
    swapped = side_by_side(make_truth(BOTH), make_tracks([tracks[1], tracks[0]]))
    assert swapped.shown.position.tolist() == [[1.0, 7.0]]


def test_what_is_shown_outside_the_truth_is_counted_apart():
    found = scored(BOTH, [*BOTH, (25.0, 0, 0, 0), (-3.0, 1, 0, 0)])
    assert found.extent.off_steps == 2
    assert found.clear_mot.mota == 1.0


def test_an_empty_field_has_steps_too():
    truth = [row for row in BOTH if row[0] < 5] + [(t, 2, 0.0, 0.0) for t in range(15, 20)]
    assert scored(truth, truth).extent.steps == 20
    ghost = [(t, 9, 50.0, 50.0) for t in range(20)]
    found = scored(truth, truth + ghost)
    assert found.clear_mot.false_positives == 20
    assert found.sets.gospa_m == pytest.approx(np.sqrt(12.5))


def test_a_coarse_truth_has_no_steps_but_its_own():
    coarse = [row for row in BOTH if row[0] < 6 or row[0] % 4 == 0]
    assert scored(coarse, BOTH).extent.steps == len({row[0] for row in coarse})


def test_truth_between_its_rows_is_a_straight_line_where_asked_for():
    other = [(t + 0.5 * who, who, t + 0.5 * who, y) for t, who, _, y in BOTH]
    fine = [(t / 2, who, t / 2, 10.0 * who) for t in range(40) for who in (0, 1)]
    assert scored(other, fine).clear_mot.false_positives == 40
    assert scored(other, fine).extent.presence == pytest.approx(40 / 78)
    joined = scored(other, fine, max_gap_s=1.0)
    assert joined.extent.presence == 1.0
    assert joined.clear_mot.misses == 0
    assert joined.clear_mot.false_positives == 2  # beyond the ends of either
    assert joined.clear_mot.motp_m == pytest.approx(0.0, abs=1e-12)


def test_times_that_differ_by_rounding_are_one_step():
    t = np.arange(20) * 0.1
    truth = [(v, 0, v, 0.0) for v in t] + [(i / 10, 1, i / 10, 5.0) for i in range(20)]
    found = scored(truth, truth)
    assert found.extent.steps == 20
    assert found.clear_mot.mota == 1.0


def test_no_tracks_miss_everything():
    found = scored(BOTH, [])
    assert found.sets == (5.0, pytest.approx(5.0), 0.0, 2.0, 0.0)
    assert found.clear_mot.mota == 0.0
    tentative = make_tracks(BOTH, status=[Status.TENTATIVE] * len(BOTH))
    assert score_many(make_truth(BOTH), tentative).to_dict() == found.to_dict()


def test_no_targets_make_everything_false_at_told_times():
    steps = side_by_side(make_truth([], ()), make_tracks(BOTH), times_s=np.arange(25.0))
    found = score_steps(steps)
    assert found.clear_mot.mota is found.extent.presence is None
    assert found.sets.false == pytest.approx(40 / 25)
    json.dumps(found.to_dict(), allow_nan=False)
    empty = score_steps(side_by_side(make_truth([]), make_tracks([]), times_s=np.arange(3.0)))
    assert empty.sets == (0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("truth", "tracks", "options", "message"),
    [
        ([], BOTH, {}, "the truth holds no rows"),
        ([(0, 0, np.nan, 0)], BOTH, {}, "truth: found .*x_m nan"),
        ([(np.inf, 0, 0, 0)], BOTH, {}, "truth: found t_s inf"),
        (BOTH, [(0, 0, 0, np.nan)], {}, "tracks: found .*y_m nan"),
        (BOTH, [(np.nan, 0, 0, 0)], {}, "tracks: found t_s nan"),
        ([*BOTH, (3, 1, 4.0, 4.0)], BOTH, {}, "'t1' at two places at 3 s"),
        (BOTH, [(90.0, 0, 0, 0)], {}, "tracks at 90 to 90 s, truth at 0 to 19 s"),
        ([*BOTH, (1e9, 5, 0, 0)], BOTH, {}, "gaps of up to 1e.09 s at a spacing of 1 s"),
        (BOTH, BOTH, {"measure": Measure(match_m=0.0)}, "match distance of 0 m"),
        (BOTH, BOTH, {"measure": Measure(match_m=np.inf)}, "match distance of inf m"),
        (BOTH, BOTH, {"measure": Measure(cutoff_m=-1.0, match_m=1.0)}, "cut-off of -1 m"),
        (BOTH, BOTH, {"measure": Measure(order=0.0)}, "order 0"),
        (BOTH, BOTH, {"tolerance_s": -1.0}, "tolerance of -1 s"),
        (BOTH, BOTH, {"tolerance_s": np.nan}, "tolerance of nan s"),
    ],
)
def test_what_cannot_be_scored_is_told(truth, tracks, options, message):
    with pytest.raises(InputError, match=message):
        scored(truth, tracks, **options)


@pytest.mark.parametrize("times", [[], [0.0, np.nan], [np.inf]])
def test_times_of_steps_that_are_none_are_refused(times):
    with pytest.raises(InputError, match="times of steps"):
        side_by_side(make_truth(BOTH), make_tracks(BOTH), times_s=np.array(times))


def test_a_row_told_twice_is_one_row():
    assert scored([*BOTH, BOTH[4]], BOTH).to_dict() == scored(BOTH, BOTH).to_dict()


def test_pairs_are_all_within_reach_and_no_others():
    truth, tracks = random_run(np.random.default_rng(5))
    steps = side_by_side(make_truth(truth), make_tracks(tracks))
    near = pairs(steps, 4.0)
    a, b = steps.truth, steps.shown
    apart = np.linalg.norm(a.position[:, None] - b.position[None], axis=2)
    expected = np.argwhere((a.step[:, None] == b.step) & (apart < 4.0))
    assert np.column_stack(near[:2]).tolist() == expected.tolist()
    np.testing.assert_allclose(near.distance, apart[near.truth, near.shown])
    assert near.within(1.0).distance.tolist() == [d for d in near.distance if d < 1.0]


def test_near_is_less_than_the_reach():
    steps = side_by_side(make_truth([(0, 0, 0, 0)]), make_tracks([(0, 0, 3, 4)]))
    assert pairs(steps, 5.0).distance.size == 0
    assert pairs(steps, 5.001).within(5.0).distance.size == 0
    assert pairs(steps, 5.001).within(5.001).distance.size == 1


def test_rows_of_tracks_follow_the_targets_that_they_match():
    rows = [(0, 4, 0, 9), (0, 3, 0, 1), (1, 4, 1, 1), (1, 3, 1, 2), (2, 3, 2, 80), (2, 3, 2, 90)]
    found = followed(make_truth(BOTH), make_tracks(rows))
    assert found.tolist() == [1, 0, -1, 0, -1, -1]
    near = followed(make_truth(BOTH), make_tracks(rows), match_m=1.5)
    assert near.tolist() == [1, 0, 0, -1, -1, -1]
    hidden = make_tracks(rows, status=[Status.TENTATIVE] * 6)
    assert (followed(make_truth(BOTH), hidden) == -1).all()


def test_tracks_without_names_ask_for_scores_of_many():
    truth, tracks = make_truth(BOTH), make_tracks(BOTH)
    alone = select_rows(truth, truth.target == 0)
    assert asks_for_many(truth, tracks)
    assert asks_for_many(alone, tracks)  # two tracks at once
    assert not asks_for_many(alone, select_rows(tracks, tracks.track == 0))
    assert not asks_for_many(truth, select_rows(tracks, tracks.track == 7))
    named = make_tracks(BOTH)
    named.target[:] = 0
    assert not asks_for_many(truth, named)


@pytest.mark.speed
def test_a_hundred_targets_over_a_thousand_steps_take_about_a_second():
    rng = np.random.default_rng(0)
    t, who = np.repeat(np.arange(1000.0), 100), np.tile(np.arange(100), 1000)
    places = rng.uniform(0, 100, (1, 100, 2)) + np.cumsum(
        rng.normal(0, 0.5, (1000, 100, 2)), axis=0
    )
    flat = places.reshape(-1, 2)
    truth = make_truth(np.column_stack([t, who, flat]))
    tracks = make_tracks(
        np.column_stack([t, who + 100 * (t // 200), flat + rng.normal(0, 0.4, flat.shape)])
    )
    used = []
    for _ in range(3):
        before = time.process_time()
        found = score_many(truth, tracks)
        used.append(time.process_time() - before)
    assert found.clear_mot.switches >= 400
    assert min(used) < 3.0
