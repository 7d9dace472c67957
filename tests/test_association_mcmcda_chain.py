"""The compiled chain against lists of all partitions: it visits them as the posterior says.

Five windows of about 100 to 2000 partitions, uniform and informed proposals, 2 million moves each.
"""

from functools import cache

import numpy as np
import pytest

from mcmcda_twin import MOVES, ROOM, Problem, window

WINDOWS = {
    "108": {"seed": 29, "slots": 5, "false": 3},
    "610": {
        "seed": 98,
        "slots": 8,
        "targets": 1,
        "false": 2,
        "round_reports": False,
        "region": ROOM,
    },
    "730": {"seed": 14, "slots": 4, "targets": 3, "false": 2, "log_death": np.log(0.1)},
    "1721": {"seed": 7, "slots": 5, "false": 3, "region": ROOM},
    # Tracks side by side: an exchange of tails changes how many can be exchanged.
    "364": {"seed": 2210, "slots": 4, "targets": 3, "false": 1},
}
SETTINGS = {"364": {"moves": [1.0, 1.2, 0.8, 1.1, 0.9, 1.0, 1.3, 20.0]}}  # of it, more switches
# Frozen slots: what they hold, a false alarm beside it. In the first two, tails could be exchanged
# in the frozen slots, of the second track or of the first; in the last one a track of three frozen
# reports may go on, and one more starts within the frozen slots, which could follow the first.
FROZEN = {
    "two": (2, "1721", {(1,), (2, 3)}),
    "crossed": (2, "1721", {(1, 3), (2,)}),
    "five": (5, "610", {(1, 2, 3), (4,)}),
}
LONG = 2_000_000
BOTH = pytest.mark.parametrize("informed", [False, True], ids=["uniform", "informed"])
EVERY = pytest.mark.parametrize("name", WINDOWS)


@cache
def problem(name, informed=False, **changed):
    settings = {**SETTINGS.get(name, {}), **changed}
    return Problem(window(**WINDOWS[name]), informed=informed, **settings)


@cache
def long_run(name, informed):
    sampler = problem(name, informed).sampler()
    return problem(name, informed).visits(sampler.trace(LONG, 1)), sampler


@EVERY
def test_the_problems_have_about_a_hundred_to_two_thousand_partitions(name):
    assert len(problem(name).partitions) == pytest.approx(int(name), rel=0.05)


@BOTH
@EVERY
def test_partitions_are_visited_as_often_as_their_posterior_says(name, informed):
    given = problem(name, informed)
    visits, _ = long_run(name, informed)
    share = np.bincount(visits, minlength=len(given.partitions)) / LONG
    assert abs(share - given.posterior).sum() / 2 < 0.02


@BOTH
@EVERY
def test_as_much_flows_forth_as_back(name, informed):
    given = problem(name, informed)
    visits, _ = long_run(name, informed)
    n = len(given.partitions)
    flow = np.zeros((n, n))
    np.add.at(flow, (visits[:-1], visits[1:]), 1.0)
    both = flow + flow.T
    often = np.triu(both, 1) >= 100
    excess = (flow - flow.T)[often] / np.sqrt(both[often])
    assert np.count_nonzero(often) >= 40
    assert abs(excess).max() < 4.5
    assert np.mean(excess**2) < 1.25


@BOTH
@EVERY
def test_the_way_from_each_partition_to_each_is_as_probable_as_in_the_twin(name, informed):
    given = problem(name, informed)
    visits, _ = long_run(name, informed)
    P = transitions(name, informed)
    n = len(given.partitions)
    flow = np.zeros((n, n))
    np.add.at(flow, (visits[:-1], visits[1:]), 1.0)
    assert not flow[P == 0].any()
    left = flow.sum(axis=1, keepdims=True)
    expected = left * P
    often = expected * (1 - P) >= 25
    np.fill_diagonal(often, val=False)
    excess = (flow - expected)[often] / np.sqrt((expected * (1 - P))[often])
    assert np.count_nonzero(often) >= 40
    assert abs(excess).max() < 5.0
    assert np.mean(excess**2) < 1.1


@BOTH
def test_the_twin_leaves_the_posterior_unchanged(informed):
    given = problem("610", informed)
    np.testing.assert_allclose(
        given.posterior @ transitions("610", informed), given.posterior, atol=1e-13
    )


@BOTH
@EVERY
def test_kept_scores_are_those_of_a_fresh_start(name, informed):
    given = problem(name, informed)
    _, sampler = long_run(name, informed)
    score, best, fresh = sampler.scores()
    assert score == pytest.approx(fresh, abs=1e-9)
    assert given.sampler(sampler.owners()).scores()[0] == pytest.approx(score, abs=1e-9)
    assert given.sampler(sampler.best()).scores()[0] == pytest.approx(best, abs=1e-9)


@BOTH
@EVERY
def test_the_best_partition_of_a_long_run_is_the_likeliest(name, informed):
    given = problem(name, informed)
    _, sampler = long_run(name, informed)
    likeliest = given.partitions[int(given.posterior.argmax())]
    np.testing.assert_array_equal(sampler.best(), given.owners([likeliest])[0])


@EVERY
def test_scores_are_those_of_dense_gaussians(name):
    given = problem(name)
    for partition, owner in zip(given.partitions, given.owners(given.partitions), strict=True):
        expected = sum(map(given.score, partition))
        assert given.sampler(owner).scores()[0] == pytest.approx(expected, abs=1e-8)


@BOTH
@pytest.mark.parametrize("case", FROZEN)
def test_frozen_slots_keep_their_tracks(case, informed):
    slots, name, head = FROZEN[case]
    given = problem(name, informed, frozen=slots)
    kept = [k for k, w in enumerate(given.partitions) if frozen_part(given, w) == head]
    start = given.partitions[kept[0]]
    visits = given.visits(given.sampler(given.owners([start])[0]).trace(LONG, 1))
    assert set(visits) <= set(kept)
    assert 10 < len(kept) < len(given.partitions) / 4
    exact = np.zeros(len(given.partitions))
    exact[kept] = given.posterior[kept] / given.posterior[kept].sum()
    share = np.bincount(visits, minlength=len(exact)) / visits.size
    assert abs(share - exact).sum() / 2 < 0.02


@BOTH
def test_every_move_is_tried_and_taken(informed):
    _, sampler = long_run("1721", informed)
    proposed, accepted = sampler.counts()
    assert sum(proposed) == LONG
    for move, tried, taken in zip(MOVES, proposed, accepted, strict=True):
        assert 0 < taken < tried, move


def test_the_same_words_give_the_same_chain_and_others_another():
    given = problem("730", informed=True)
    first, again, other = (
        given.sampler(random=r) for r in ((5, 6, 7, 8), (5, 6, 7, 8), (5, 6, 7, 9))
    )
    a, b, c = (sampler.trace(1000, 1) for sampler in (first, again, other))
    np.testing.assert_array_equal(a, b)
    assert (a != c).any()
    went_on = given.sampler(first.owners(), first.random()).trace(200, 1)
    np.testing.assert_array_equal(went_on, again.trace(200, 1))


@cache
def transitions(name, informed):
    return problem(name, informed).transitions()


def frozen_part(given, partition):
    """Tracks of the frozen reports; others may change."""
    heads = (tuple(i for i in t if given.slot[i] < given.settings["frozen"]) for t in partition)
    return frozenset(head for head in heads if head)
