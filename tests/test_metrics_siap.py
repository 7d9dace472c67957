"""SIAP: against Stone Soup, against a slow twin, and by hand."""

import itertools

import numpy as np
import pytest

import peers
from score_runs import make_tracks, make_truth, random_run
from trackfield.metrics.siap import siap
from trackfield.metrics.steps import pairs, side_by_side

STEPS = 25
THEIRS = {
    "completeness": "SIAP Completeness",
    "ambiguity": "SIAP Ambiguity",
    "spuriousness": "SIAP Spuriousness",
    "position_error_m": "SIAP Position Accuracy",
    "breaks_per_s": "SIAP Rate of Track Number Change",
    "longest_segment": "SIAP Longest Track Segment",
}


def scored(truth, tracks, *, match_m=3.0, step_s=1.0):
    steps = side_by_side(
        make_truth(truth), make_tracks(tracks), times_s=np.arange(STEPS) * float(step_s)
    )
    return siap(steps, pairs(steps, match_m))


def by_identity(rows):
    found = {}
    for t, who, x, y in rows:
        found.setdefault(who, {})[t] = (x, y)
    return found


def test_as_stone_soup():
    compared = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        truth, tracks = random_run(rng, targets=4, side_m=60.0, gaps=False, false=4, swap=0.06)
        one, other = (list(by_identity(rows).values()) for rows in (truth, tracks))
        try:
            theirs = peers.siap(one, other, match_m=3.0)
        except ValueError:  # it has no word for a segment of a single step
            continue
        ours = scored(truth, tracks)._asdict()
        for name, title in THEIRS.items():
            assert ours[name] == pytest.approx(theirs[title], rel=1e-12), (seed, name)
        compared += ours["breaks_per_s"] > 0 and ours["spuriousness"] > 0
    assert compared >= 15


def slow(truth, tracks, match_m):
    """SIAP as its definition says, with sets and loops; fewest segments by trying all choices."""
    true, seen = by_identity(truth), by_identity(tracks)
    mine, apart = {}, []
    for number, places in seen.items():
        for t, place in places.items():
            here = {
                who: np.hypot(*np.subtract(place, true[who][t])) for who in true if t in true[who]
            }
            if here and min(here.values()) < match_m:
                mine[number, t] = min(here, key=here.get)
                apart.append(min(here.values()))
    held = {(who, t) for (_, t), who in mine.items()}
    runs = {who: [] for who in true}
    for (number, t), who in sorted(mine.items()):
        if runs[who] and runs[who][-1][0] == number and runs[who][-1][1][-1] == t - 1:
            runs[who][-1][1].append(t)
        else:
            runs[who].append((number, [t]))
    further = tracked = longest = life = 0
    for who, own in runs.items():
        life += max(true[who]) - min(true[who])
        sets = [frozenset(steps) for _, steps in own]
        tracked += len({t for one in sets for t in one if t + 1 in one})
        if sets:
            numbers = {number for number, _ in own}
            longest += max(sum(len(s) - 1 for n, s in own if n == number) for number in numbers)
            whole = frozenset().union(*sets)
            further += next(
                n - 1
                for n in range(1, len(sets) + 1)
                if any(whole == frozenset().union(*c) for c in itertools.combinations(sets, n))
            )
    return (
        len(held) / len(truth),
        len(mine) / len(held),
        1 - len(mine) / len(tracks),
        np.mean(apart),
        further / tracked,
        longest / life,
    )


def test_as_the_definition_says():
    for seed in range(40):
        truth, tracks = random_run(np.random.default_rng(seed), targets=4, false=2)
        found = scored(truth, tracks)
        np.testing.assert_allclose(found, slow(truth, tracks, 3.0), rtol=1e-12, err_msg=str(seed))


WALK = [(t, 0, t, 0.0) for t in range(STEPS)]


def test_a_perfect_picture():
    assert scored(WALK, WALK) == (1.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def test_one_break_is_one_further_track_in_the_time_tracked():
    cut = [(t, t >= 10, t, 0.5) for t in range(STEPS)]
    found = scored(WALK, cut)
    assert found.breaks_per_s == pytest.approx(1 / 23)  # from step 9 to 10 nobody goes on
    assert found.longest_segment == pytest.approx(14 / 24)
    assert found.completeness == 1.0
    assert found.position_error_m == pytest.approx(0.5)


def test_rates_are_by_seconds_and_shares_are_not():
    cut = [(t, t >= 10, t, 0.5) for t in range(STEPS)]
    slower = [(4.0 * t, *rest) for t, *rest in WALK], [(4.0 * t, *rest) for t, *rest in cut]
    ours, theirs = scored(WALK, cut), scored(*slower, step_s=4.0)
    assert theirs.breaks_per_s == pytest.approx(ours.breaks_per_s / 4)
    assert theirs._replace(breaks_per_s=0) == ours._replace(breaks_per_s=0)


def test_two_tracks_on_a_target_are_ambiguous_and_none_is_spurious():
    found = scored(WALK, [*WALK, *((t, 1, x, y + 1) for t, _, x, y in WALK)])
    assert (found.ambiguity, found.spuriousness, found.completeness) == (2.0, 0.0, 1.0)
    assert found.breaks_per_s == 0.0


def test_a_share_of_nothing_is_none():
    assert scored(WALK, []) == (0.0, None, None, None, None, 0.0)
    assert scored([], WALK) == (None, None, 1.0, None, None, None)
    assert scored(WALK[:1], WALK[:1]) == (1.0, 1.0, 0.0, 0.0, None, None)
