"""What readings cost: by what is left, by who is needed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from trackfield.errors import InputError
from trackfield.scheduling.soft_weights import shares, weights


def counted(sensors, places, reach, spread, near):
    """Place by place, sensor by sensor."""
    total = np.zeros(len(sensors))
    for p in places:
        serve = []
        for c in sensors:
            r = float(np.hypot(*(p - c)))
            ramp = min(max((reach - spread - r) / (3 * spread), 0.0), 1.0)
            serve.append(ramp if r >= near * spread else 0.0)
        if sum(serve) > 0:
            total += np.array(serve) / sum(serve)
    return np.maximum(total / total.mean(), 0.2)


def test_shares_are_those_of_counting():
    rng = np.random.default_rng(0)
    sensors, places = rng.uniform(0, 6, (40, 2)), rng.uniform(0, 6, (90, 2))
    found = shares(sensors, places, reach_m=1.4, spread_m=0.13)
    assert_allclose(found, counted(sensors, places, 1.4, 0.13, 3.0))
    assert found.max() > 1.5


def test_a_lone_sensor_on_the_way_is_needed_more_than_one_of_many():
    crowd = np.column_stack([np.linspace(0.0, 0.1, 9), np.full(9, 0.7)])
    sensors = np.concatenate([crowd, [[10.0, 0.7]]])
    found = shares(sensors, np.array([[0.0, 0.0], [10.0, 0.0]]), reach_m=1.4, spread_m=0.1)
    assert found[-1] == pytest.approx(9.0 * found[0], rel=0.05)


def test_where_nobody_serves_all_are_alike():
    assert_allclose(shares(np.zeros((3, 2)), np.full((5, 2), 9.0), reach_m=1.0, spread_m=0.1), 1.0)
    assert shares(np.zeros((0, 2)), np.zeros((5, 2)), reach_m=1.0, spread_m=0.1).shape == (0,)


def test_a_reading_costs_more_the_less_is_left_and_nothing_can_be_bought_of_the_empty():
    left = np.array([30.0, 2.0, 1.0, 0.5, 0.0])
    assert_allclose(weights(left), [29.01**-3, 1.01**-3, 0.01**-3, np.inf, np.inf])
    assert_allclose(weights(left[:2], np.array([2.0, 3.0])), [2 * 29.01**-3, 3 * 1.01**-3])


def test_what_makes_no_sense_is_refused():
    with pytest.raises(InputError, match="negative"):
        weights(np.array([-1.0]))
    with pytest.raises(InputError, match="negative or no number"):
        weights(np.array([1.0]), np.array([np.nan]))
    with pytest.raises(InputError, match="expected \\(n, d\\)"):
        shares(np.zeros((3, 3)), np.zeros((3, 2)), reach_m=1.0, spread_m=0.1)
