"""Identities over a run: against py-motmetrics, and what a swap must cost."""

import itertools

import numpy as np
import pytest

import peers
from score_runs import make_tracks, make_truth, random_run
from trackfield.metrics.identity import identity
from trackfield.metrics.steps import pairs, side_by_side

STEPS = 25


def beside(truth, tracks):
    times = np.arange(float(STEPS))
    return side_by_side(make_truth(truth), make_tracks(tracks), times_s=times)


def scored(truth, tracks, match_m=3.0):
    steps = beside(truth, tracks)
    return identity(steps, pairs(steps, match_m))


def test_as_motmetrics():
    for seed in range(12):
        rng = np.random.default_rng(seed)
        steps = beside(*random_run(rng, side_m=(5.0, 12.0)[seed % 2], swap=0.2))
        theirs = peers.clear_and_identity(steps, match_m=3.0)
        ours = identity(steps, pairs(steps, 3.0))
        expected = [theirs[name] for name in ("idf1", "idp", "idr")]
        np.testing.assert_allclose(ours, expected, rtol=1e-12, err_msg=str(seed))


def test_as_all_assignments_of_identities_tried():
    for seed in range(20):
        truth, tracks = random_run(np.random.default_rng(seed), targets=3, false=1, swap=0.05)
        steps = beside(truth, tracks)
        near = pairs(steps, 3.0)
        together = np.zeros((steps.targets, steps.tracks), int)
        np.add.at(together, (steps.truth.who[near.truth], steps.shown.who[near.shown]), 1)
        wide = np.pad(together, ((0, 0), (0, steps.targets)))
        best = max(
            wide[range(steps.targets), list(chosen)].sum()
            for chosen in itertools.permutations(range(wide.shape[1]), steps.targets)
        )
        assert scored(truth, tracks).idr == pytest.approx(best / len(truth))


BOTH = [(t, who, float(t), 10.0 * who) for t in range(STEPS) for who in (0, 1)]


def test_perfect_tracks_have_idf1_one():
    assert scored(BOTH, BOTH) == (1.0, 1.0, 1.0)


def test_a_swap_costs_the_shorter_part_of_both():
    for at in range(STEPS + 1):
        swapped = [(t, (who + (t >= at)) % 2, x, y) for t, who, x, y in BOTH]
        kept = max(at, STEPS - at) / STEPS
        assert scored(BOTH, swapped) == pytest.approx((kept, kept, kept))


def test_false_and_missing_rows_cost_precision_and_recall():
    false = [(t, 9, 500.0, 0.0) for t in range(10)]
    found = scored(BOTH, BOTH[:20] + false)
    assert found.idp == pytest.approx(20 / 30)
    assert found.idr == pytest.approx(20 / 50)
    assert found.idf1 == pytest.approx(2 * 20 / 80)


def test_a_share_of_nothing_is_none():
    assert scored([], []) == (None, None, None)
    assert scored(BOTH, []) == (0.0, None, 0.0)
    assert scored([], BOTH) == (0.0, 0.0, None)
