"""Bounds of who knows all: against whole programs and integer ones, and above all policies."""

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from lifetime_fields import NEED, accurate_sets, field, passes, small
from trackfield.errors import InputError
from trackfield.scheduling.clairvoyant import first_death_bound, service_bound
from trackfield.scheduling.lifetime import lifetime
from trackfield.scheduling.lifetime_candidates import candidates, join


def most_served(known, capacity, last, *, whole):
    """Intervals of the first `last` that batteries can serve: all sets in one program."""
    sets = [(t, s) for t in range(last) for s in accurate_sets(known, t, NEED)]
    if not sets:
        return 0.0
    loads, once = np.zeros((known.count, len(sets))), np.zeros((last, len(sets)))
    for j, (t, s) in enumerate(sets):
        loads[list(s), j] = 1.0
        once[t, j] = 1.0
    found = milp(
        -np.ones(len(sets)),
        constraints=[
            LinearConstraint(loads, ub=capacity),
            LinearConstraint(once, ub=np.ones(last)),
        ],
        bounds=Bounds(0, 1),
        integrality=np.full(len(sets), int(whole)),
    )
    return -found.fun


@pytest.mark.parametrize("seed", range(4))
def test_bounds_are_those_of_the_program_with_all_sets(seed):
    known = small(seed, nodes=22, intervals=14)
    battery = np.full(known.count, 2.0)
    bound = service_bound(known, battery, need=NEED, rounds=20)
    served = most_served(known, battery, len(known), whole=False)
    assert len(known) - bound.failed <= np.floor(served * (1 + 2e-3) + 1e-6)
    assert len(known) - bound.failed >= np.floor(served + 1e-6)
    death = first_death_bound(known, battery, need=NEED, rounds=20)
    able = [t for t in range(len(known)) if accurate_sets(known, t, NEED)]
    spare = battery - 1.0
    last = 0
    while last < len(known) and most_served(known, spare, last + 1, whole=False) > (
        sum(t <= last for t in able) - 1e-6
    ):
        last += 1
    assert death.interval == (last + 1 if last < len(known) else None)


@pytest.mark.parametrize("seed", range(4))
def test_no_whole_schedule_does_better(seed):
    known = small(seed + 10, nodes=18, intervals=10)
    battery = np.full(known.count, 1.0)
    bound = service_bound(known, battery, need=NEED)
    assert most_served(known, battery, len(known), whole=True) <= len(known) - bound.failed


@pytest.mark.parametrize("name", ["geometry", "cost", "flow"])
def test_every_policy_is_below_the_bounds_and_the_best_come_near(name):
    rng = np.random.default_rng(3)
    made, paths = field(rng, 120, size_m=5.0, battery=5.0), passes(rng, 20, 12, size_m=5.0)
    known = candidates(made.sensors, paths, sigma_m=0.1, reach_m=1.4)
    battery = np.full(120, 5.0)
    death = first_death_bound(known, battery, need=NEED)
    service = service_bound(known, battery, need=NEED)
    found = lifetime(made, paths, need=NEED, chosen_by=name, forecast=paths)
    assert found.first_death <= death.interval
    assert found.failed >= service.failed
    assert death.gap < 0.02
    assert service.gap < 0.02
    if name == "flow":
        assert found.first_death > 0.8 * death.interval


def test_plenty_and_nothing():
    known = small(5)
    assert first_death_bound(known, np.full(known.count, 99.0), need=NEED).interval is None
    none = np.zeros(known.count)
    assert service_bound(known, none, need=NEED).failed == len(known)
    assert first_death_bound(known, none, need=NEED).interval is None
    assert first_death_bound(known, none + 1.0, need=NEED).interval == 1
    empty = join([], 4)
    assert first_death_bound(empty, np.ones(4), need=NEED).interval is None
    assert service_bound(empty, np.ones(4), need=NEED).failed == 0


@pytest.mark.parametrize("bound", [first_death_bound, service_bound])
def test_negative_energy_is_refused(bound):
    with pytest.raises(InputError, match=r"battery: found -1\.0"):
        bound(small(1), np.full(30, -1.0), need=NEED)
