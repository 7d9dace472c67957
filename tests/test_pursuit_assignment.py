"""Who chases whom, against all assignments listed."""

import itertools

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.pursuit.assignment import assign, bottleneck, chase, double, keep
from trackfield.pursuit.determinant import assign_by_determinants


def all_chases(c):
    """Times, worst first, of every assignment with as many finite pairs as can be."""
    p, e = c.shape
    found = []
    for columns in set(itertools.permutations(list(range(e)) + [-1] * p, p)):
        times = [c[i, j] for i, j in enumerate(columns) if j >= 0]
        if np.isfinite(times).all():
            found.append(sorted(times, reverse=True))
    most = max(map(len, found))
    return [times for times in found if len(times) == most]


def tables(count, seed):
    """Costs of all shapes: with ties, without, and with pairs that never meet."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        shape = tuple(map(int, rng.integers(1, 5, 2)))
        c = rng.integers(0, 8, shape).astype(float)
        if k % 3 == 0:
            c[rng.random(shape) < 0.3] = np.inf
        yield c + rng.random(shape) if k % 4 == 0 else c


def test_every_objective_is_that_of_all_assignments():
    for c in tables(250, 1):
        every = all_chases(c)
        worst = [times[0] if times else 0.0 for times in every]
        sums = [sum(times) for times in every]
        made = assign(c)
        assert made.last_s == min(worst) == bottleneck(c)
        tied = [s for s, w in zip(sums, worst, strict=True) if w == min(worst)]
        assert made.sum_s == pytest.approx(min(tied))
        assert assign(c, "sum").sum_s == pytest.approx(min(sums))
        vector = assign(c, "lexicographic").evader
        times = sorted((c[i, j] for i, j in enumerate(vector) if j >= 0), reverse=True)
        assert times == min(every)
        for one in (made.evader, vector, assign(c, "greedy").evader):
            taken = one[one >= 0]
            assert len(set(taken.tolist())) == len(taken)


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_ours_is_never_later_than_greedy_or_least_sum(n):
    rng = np.random.default_rng(n)
    ratios = []
    for _ in range(200):
        c = rng.uniform(1.0, 10.0, (n, n))
        last = assign(c).last_s
        ratios.append([assign(c, "greedy").last_s / last, assign(c, "sum").last_s / last])
    assert np.min(ratios) >= 1.0
    assert (np.mean(ratios, axis=0) > 1.005).all()


def test_determinants_find_the_last_capture_without_ties_and_fail_with_them():
    rng = np.random.default_rng(0)
    late = {"distinct": 0, "tied": 0}
    for _ in range(300):
        for kind, c in (
            ("distinct", rng.uniform(0.0, 9.0, (4, 4))),
            ("tied", rng.integers(0, 6, (4, 4)).astype(float)),
        ):
            found = chase(c, assign_by_determinants(c, rng=rng))
            late[kind] += found.last_s > bottleneck(c)
    assert late["distinct"] == 0
    assert late["tied"] > 10


def test_a_former_assignment_is_kept_within_the_margin_only():
    c = np.array([[5.0, 5.2], [5.2, 5.0]])
    before = np.array([1, 0], np.int32)
    fresh = assign(c)
    assert fresh.evader.tolist() == [0, 1]
    assert keep(c, before, fresh).evader.tolist() == [1, 0]
    assert keep(c, before, fresh, margin=0.01).evader.tolist() == [0, 1]
    never = np.array([[5.0, np.inf], [5.2, 5.0]])
    assert keep(never, before, assign(never)).evader.tolist() == [0, 1]
    alone = np.array([-1, 0], np.int32)  # one more could be chased now
    assert keep(c, alone, fresh).evader.tolist() == [0, 1]
    gone = np.array([2, 0], np.int32)
    assert keep(c, gone, fresh) is fresh
    assert keep(c, np.zeros(3, np.int32), fresh) is fresh


def test_spares_help_the_one_that_is_caught_last():
    c = np.array([[2.0, 9.0], [9.0, 8.0], [3.0, 6.0], [1.5, 20.0]])
    made = assign(c)
    both = double(c, made)
    assert made.last_s == 6.0
    assert (both >= 0).all()
    assert sorted(both.tolist()) == [0, 0, 1, 1]
    nobody = np.full((2, 2), np.inf)
    assert double(nobody, assign(nobody)).tolist() == [-1, -1]
    far = np.array([[1.0], [np.inf]])
    assert double(far, assign(far)).tolist() == [0, -1]


def test_more_evaders_leave_the_latest_and_say_so():
    made = assign(np.array([[4.0, 1.0, 9.0]]))
    assert made.evader.tolist() == [1]
    assert made.uncaught.tolist() == [0, 2]


@pytest.mark.parametrize("shape", [(0, 3), (3, 0), (0, 0)])
def test_nobody_to_chase_or_to_be_chased(shape):
    for objective in ("bottleneck", "lexicographic", "sum", "greedy"):
        made = assign(np.empty(shape), objective)
        assert made.evader.tolist() == [-1] * shape[0]
        assert made.last_s == 0.0


@pytest.mark.parametrize(
    ("costs", "said"),
    [(np.ones(3), "expected \\(pursuers, evaders\\)"), (-np.ones((2, 2)), "below 0")],
)
def test_bad_costs_are_refused(costs, said):
    with pytest.raises(InputError, match=said):
        assign(costs)


def test_determinants_want_a_square():
    with pytest.raises(InputError, match=r"\(n, n\)"):
        assign_by_determinants(np.ones((2, 3)), rng=np.random.default_rng(0))
