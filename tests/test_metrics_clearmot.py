"""CLEAR-MOT: against py-motmetrics, by hand, and what a swap or a gap must cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import peers
from score_runs import make_tracks, make_truth, random_run
from trackfield.metrics.clearmot import clear_mot, match_steps
from trackfield.metrics.steps import pairs, side_by_side

STEPS = 25
THEIRS = {
    "mota": "mota",
    "motp_m": "motp",
    "recall": "recall",
    "precision": "precision",
    "misses": "num_misses",
    "false_positives": "num_false_positives",
    "switches": "num_switches",
    "fragments": "num_fragmentations",
    "mostly_tracked": "mostly_tracked",
    "partly_tracked": "partially_tracked",
    "mostly_lost": "mostly_lost",
}


def beside(truth, tracks):
    times = np.arange(float(STEPS))
    return side_by_side(make_truth(truth), make_tracks(tracks), times_s=times)


def scored(truth, tracks, match_m=3.0):
    steps = beside(truth, tracks)
    return clear_mot(steps, pairs(steps, match_m))


def test_as_motmetrics():
    switches = fragments = 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        steps = beside(*random_run(rng, side_m=(5.0, 12.0)[seed % 2], lost=0.3))
        ours = clear_mot(steps, pairs(steps, 3.0))
        theirs = peers.clear_and_identity(steps, match_m=3.0)
        for name, their_name in THEIRS.items():
            expected = pytest.approx(theirs[their_name], rel=1e-12)
            assert getattr(ours, name) == expected, (seed, name)
        switches, fragments = switches + ours.switches, fragments + ours.fragments
    assert min(switches, fragments) > 30


@given(st.integers(0, 10**6))
def test_all_rows_are_matched_missed_or_false(seed):
    truth, tracks = random_run(np.random.default_rng(seed), targets=4)
    found = scored(truth, tracks)
    assert found.matches + found.misses == len(truth)
    assert found.matches + found.false_positives == len(tracks)
    targets = len({who for _, who, *_ in truth})
    assert found.mostly_tracked + found.partly_tracked + found.mostly_lost == targets
    assert found.mota <= 1.0


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.floats(0, 6.28), st.permutations(range(6)))
def test_numbers_of_tracks_and_the_frame_of_reference_say_nothing(seed, angle, order):
    truth, tracks = random_run(np.random.default_rng(seed), targets=3, false=2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = [
        [(t, who, *(turn @ (x, y) + 7.0)) for t, who, x, y in rows] for rows in (truth, tracks)
    ]
    numbers = {number: i for i, number in enumerate(sorted({row[1] for row in tracks}))}
    renamed = [
        (t, order[i] if (i := numbers[who]) < 6 else i, *place) for t, who, *place in moved[1]
    ]
    one, other = scored(truth, tracks), scored(moved[0], renamed)
    assert other[4:] == one[4:]
    assert other.motp_m == pytest.approx(one.motp_m) if one.matches else other.motp_m is None


def walk(who, y, steps=range(STEPS)):
    return [(t, who, float(t), y) for t in steps]


BOTH = walk(0, 0.0) + walk(1, 10.0)


def test_perfect_tracks_have_mota_one():
    found = scored(BOTH, BOTH)
    assert found[:4] == (1.0, 0.0, 1.0, 1.0)
    assert found[4:] == (2 * STEPS, 0, 0, 0, 0, 2, 0, 0)


def test_a_swap_of_two_identities_costs_two_switches_each_time():
    for swaps in range(5):

        def number(t, who, swaps=swaps):
            return (who + sum(t >= 4 * (k + 1) for k in range(swaps))) % 2

        found = scored(BOTH, [(t, number(t, who), x, y) for t, who, x, y in BOTH])
        assert found.switches == 2 * swaps
        assert found.mota == pytest.approx(1 - 2 * swaps / len(BOTH))


def test_a_gap_costs_its_misses_and_a_fragment_and_no_switch():
    found = scored(BOTH, [row for row in BOTH if not 5 <= row[0] < 9])
    assert (found.misses, found.fragments, found.switches, found.false_positives) == (8, 2, 0, 0)
    ends = scored(BOTH, [row for row in BOTH if 3 <= row[0] < 20])
    assert (ends.fragments, ends.partly_tracked) == (0, 2)


def test_a_new_track_after_a_gap_is_a_switch():
    tracks = [(t, who + 10 * (t >= 9), x, y) for t, who, x, y in BOTH if not 5 <= t < 9]
    found = scored(BOTH, tracks)
    assert (found.switches, found.fragments) == (2, 2)


def test_a_target_keeps_its_track_although_another_is_nearer():
    other = [(t, 7, float(t), 0.1) for t in range(5, STEPS)]
    kept = [(t, 3, float(t), 2.0) for t in range(STEPS)]
    steps = beside(walk(0, 0.0), kept + other)
    near = pairs(steps, 3.0)
    found = match_steps(steps, near)
    assert not found.switched.any()
    assert clear_mot(steps, near).motp_m == pytest.approx(2.0)
    assert clear_mot(steps, near).false_positives == STEPS - 5


def test_of_two_targets_that_had_the_same_track_the_first_keeps_it():
    truth = [(0, 0, 0, 0), (1, 0, 99, 99), (1, 1, 0, 0), (2, 0, 0, 0), (2, 1, 0, 0.1)]
    tracks = [(0, 5, 0, 0), (1, 5, 0, 0), (2, 5, 0, 0.1), (2, 6, 0, 2)]
    steps = beside(truth, tracks)
    near = pairs(steps, 3.0)
    found = match_steps(steps, near)
    last = [
        (int(steps.truth.who[i]), int(steps.shown.who[j]), bool(switch))
        for i, j, switch in zip(
            near.truth[found.chosen],
            near.shown[found.chosen],
            found.switched[found.chosen],
            strict=True,
        )
        if steps.truth.step[i] == 2
    ]
    assert last == [(0, 0, False), (1, 1, True)]


def test_as_many_as_can_be_are_matched_before_distances_count():
    truth = [(0, 0, 0.0, 0.0), (0, 1, 2.0, 0.0)]
    tracks = [(0, 0, 1.9, 0.0), (0, 1, 4.0, 0.0)]  # the near pair would leave two alone
    found = scored(truth, tracks, match_m=2.5)
    assert found.matches == 2
    assert found.motp_m == pytest.approx(1.95)


def test_a_life_is_mostly_tracked_from_80_percent_and_lost_below_20():
    life = walk(0, 0.0, range(20))
    for held, expected in ((16, (1, 0, 0)), (15, (0, 1, 0)), (4, (0, 1, 0)), (3, (0, 0, 1))):
        assert scored(life, life[:held])[-3:] == expected


def test_a_share_of_nothing_is_none():
    assert scored([], BOTH)[:4] == (None, None, None, 0.0)
    assert scored(BOTH, [])[:4] == (0.0, None, 0.0, None)
    assert scored([], [])[:4] == (None, None, None, None)
