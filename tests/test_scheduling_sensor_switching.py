"""The paper's rule of switching against enumeration; the choice by information against it."""

from itertools import combinations

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.localization.information import fisher_information, reading_gains
from trackfield.scheduling import sensor_switching
from trackfield.sensing.angular_rate import AngularRateModel

RNG = np.random.default_rng(7)
FIELD = RNG.uniform(-3, 3, (9, 2))
ALL = np.arange(9, dtype=np.int32)
STATE = np.array([0.4, -0.3, 0.9, 0.2])
ACTIVE = np.array([0, 3, 5], np.int32)


def by_hand(position, old, new):
    def square(places):
        E = np.array([[-(position[1] - y), position[0] - x] for x, y in places])
        return E.T @ E, np.linalg.matrix_rank(E)

    return np.sqrt(((square(new)[0] - square(old)[0]) ** 2).sum()), square(new)[1]


def test_the_switch_is_the_best_of_all_sets():
    found = sensor_switching.switch(STATE[:2], FIELD, active=ACTIVE, usable=ALL[1:], k=3)
    costs = {
        s: by_hand(STATE[:2], FIELD[ACTIVE], FIELD[list(s)])[0]
        for s in combinations(range(1, 9), 3)
    }
    best = min(costs, key=costs.get)
    assert tuple(found.sensors) == best
    assert found.cost == pytest.approx(costs[best])
    assert found.found
    told = sensor_switching.switching_cost(STATE[:2], FIELD[ACTIVE], FIELD[found.sensors])
    assert told.cost == pytest.approx(found.cost)
    assert told.rank == 2


def test_who_may_stay_stays():
    found = sensor_switching.switch(STATE[:2], FIELD, active=ACTIVE, usable=ALL, k=3)
    assert found.sensors.tolist() == ACTIVE.tolist()
    assert found.cost == pytest.approx(0.0, abs=1e-12)


def test_sensors_in_line_with_the_target_are_passed_over():
    places = np.array([[-1.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.5]])
    at = np.zeros(2)
    active = np.array([0, 1], np.int32)
    every = np.arange(4, dtype=np.int32)
    found = sensor_switching.switch(at, places, active=active, usable=every, k=2)
    assert 3 in found.sensors
    assert found.found
    line = sensor_switching.switch(at, places, active=active, usable=every[:3], k=2)
    assert not line.found


def test_the_choice_by_information_leaves_least():
    model = AngularRateModel()
    prior = np.diag([50.0, 80.0, 20.0, 30.0])
    found = sensor_switching.informative(model, FIELD, STATE, prior=prior, usable=ALL[2:], k=3)
    scale = np.sqrt(np.diag(np.linalg.inv(prior)))

    def left(rows):
        told = fisher_information(reading_gains(model, FIELD[list(rows)], STATE)) + prior
        return (np.diag(np.linalg.inv(told)) / scale**2).sum()

    best = min(combinations(range(2, 9), 3), key=left)
    assert left(found.sensors) == pytest.approx(left(best))


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="found 0 sets of 3 among 2"):
        sensor_switching.switch(STATE[:2], FIELD, active=ACTIVE, usable=ALL[:2], k=3)
    many = np.arange(100, dtype=np.int32)
    with pytest.raises(InputError, match="expected 1 to"):
        sensor_switching.switch(STATE[:2], np.zeros((100, 2)), active=ACTIVE, usable=many, k=5)
    with pytest.raises(InputError, match="finite"):
        sensor_switching.switch(np.full(2, np.nan), FIELD, active=ACTIVE, usable=ALL, k=3)
