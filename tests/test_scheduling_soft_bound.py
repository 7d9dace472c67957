"""The soft bound: what is promised is kept by a filter, and only sure sensors are asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError, InputError
from trackfield.filtering import kalman
from trackfield.scheduling.soft_bound import Care, choose
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian

SIGMA = 0.1
MODEL = RangeModel(sigma_m=SIGMA, max_range_m=1.4)
BOUND = 3.0 * SIGMA**2
PLAIN = Care(0.0, 0.0, 0.0, 0.0, aim=1.0, thrift=0.0)


def belief(x=5.0, y=5.0, spread=0.15, speed=0.1):
    return Gaussian(np.array([x, y, 0.4, 0.0]), np.diag([spread**2, spread**2, speed**2, speed**2]))


def field(seed=0, n=441):
    return np.random.default_rng(seed).uniform(0.0, 10.0, (n, 2))


def ask(prior, sensors, *, bound=BOUND, weights=None, care=PLAIN):
    w = np.ones(len(sensors)) if weights is None else weights
    return choose(prior, sensors, models=MODEL, bound_m2=bound, weights=w, care=care)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), spread=st.floats(0.05, 0.3), share=st.floats(0.5, 4.0))
def test_the_trace_that_is_predicted_is_what_a_linear_filter_gets(seed, spread, share):
    rng = np.random.default_rng(seed)
    prior, sensors = belief(*rng.uniform(2, 8, 2), spread), field(seed)
    choice = ask(prior, sensors, bound=share * SIGMA**2).choice
    picks = choice.sensors[choice.sensors >= 0]
    offset = prior.mean[:2] - sensors[picks]
    r = np.linalg.norm(offset, axis=1)
    normal = offset[:, ::-1] * [1.0, -1.0] / r[:, None]
    across = np.einsum("mi,ij,mj->m", normal, prior.covariance[:2, :2], normal)
    H = np.hstack([offset / r[:, None], np.zeros((len(picks), 2))])
    variance = SIGMA**2 + (across / r) ** 2 / 2
    after = kalman.update(prior, H @ prior.mean, kalman.Linear(H, np.diag(variance))).posterior
    assert np.trace(after.covariance[:2, :2]) == pytest.approx(float(choice.trace), rel=1e-9)
    assert bool(choice.feasible) == (choice.trace <= share * SIGMA**2)


def test_what_the_filter_knows_saves_sensors():
    sensors = field(2)
    asked = [
        int((ask(belief(spread=s), sensors).choice.sensors >= 0).sum())
        for s in (0.1, 0.15, 0.25, 1.0)
    ]
    assert asked[0] == 0
    assert asked == sorted(asked)
    assert asked[-1] >= 2


def test_only_sensors_that_will_surely_hear_are_asked():
    prior = Gaussian(np.array([5.0, 5.0]), np.diag([0.3**2, 0.1**2]))
    sensors = np.array([[4.0, 5.0], [5.0, 6.0], [5.0, 3.7], [5.2, 5.0], [5.0, 5.5], [9.0, 9.0]])
    sure = ask(prior, sensors, care=Care(2.0, 2.5, 2.0, 2.5)).sure
    # 1 + 2 x .3 > 1.4; 1 + .2; 1.3 + .2 > 1.4; .2 < 2.5 x .1; .5 < 2.5 x .3; out of reach
    assert list(sure) == [False, True, False, False, False, False]
    prior_off = ask(prior, sensors, care=PLAIN).sure
    assert list(prior_off) == [True, True, True, True, True, False]


def test_sensors_that_are_less_sure_are_asked_where_else_the_bound_is_not_kept():
    prior = Gaussian(np.array([5.0, 5.0]), 0.2**2 * np.eye(2))
    near = np.array([[5.4, 5.0], [5.0, 5.4]])  # two standard deviations
    care = Care(aim=1.0)
    alone = ask(prior, near, care=care)
    assert alone.choice.feasible
    assert sorted(alone.choice.sensors) == [-1, 0, 1]
    far = np.array([[5.9, 5.0], [5.0, 5.9]])
    both = ask(prior, np.concatenate([near, far]), care=care)
    assert sorted(both.choice.sensors) == [-1, 2, 3]
    assert list(both.sure) == [False, False, True, True]
    strict = replace(care, least_near_sigmas=2.5)
    assert not ask(prior, near, care=strict).choice.feasible


def test_a_sensor_that_costs_more_is_spared():
    sensors = field(3)
    first = ask(belief(spread=0.2), sensors).choice
    weights = np.ones(len(sensors))
    spared = first.sensors[first.sensors >= 0]
    weights[spared] = 50.0
    again = ask(belief(spread=0.2), sensors, weights=weights).choice
    assert again.feasible
    assert not set(again.sensors) & set(spared)
    weights[spared] = np.inf
    assert not set(ask(belief(spread=0.2), sensors, weights=weights).choice.sensors) & set(spared)


def test_where_the_bound_cannot_be_kept_the_best_is_told():
    sensors = field(4)
    choice = ask(belief(spread=0.5), sensors, bound=0.5 * SIGMA**2).choice
    assert not choice.feasible
    assert (choice.sensors >= 0).sum() == 3
    others = np.random.default_rng(0).permutation(len(sensors))[:200]
    weights = np.full(len(sensors), np.inf)
    weights[others] = 1.0
    fewer = ask(belief(spread=0.5), sensors, bound=0.5 * SIGMA**2, weights=weights).choice
    assert fewer.trace >= choice.trace > 0.5 * SIGMA**2
    empty = ask(belief(spread=0.5), sensors, weights=np.full(len(sensors), np.inf)).choice
    assert float(empty.trace) == pytest.approx(2 * 0.5**2)
    assert not empty.feasible


def test_the_aim_is_sharper_than_the_bound_and_failing_it_is_no_failure():
    sensors = field(5)
    plain, careful = (ask(belief(spread=0.2), sensors, care=Care(aim=a)).choice for a in (1.0, 0.5))
    assert careful.trace <= 0.5 * BOUND < plain.trace <= BOUND
    bound = float(ask(belief(spread=0.2), sensors, bound=1e-9, care=Care()).choice.trace)
    reached = ask(belief(spread=0.2), sensors, bound=1.01 * bound, care=Care(aim=0.9)).choice
    assert reached.feasible
    assert reached.trace == pytest.approx(bound)


def test_thrift_pays_for_a_sharper_result_what_it_is_worth():
    sensors = field(6)
    rng = np.random.default_rng(0)
    weights = rng.uniform(1.0, 2.0, len(sensors))
    prior = belief(spread=0.18)
    plain, thrifty, lavish = (
        ask(prior, sensors, weights=weights, care=replace(PLAIN, thrift=t)).choice
        for t in (0.0, 1.5, 100.0)
    )
    assert plain.cost <= thrifty.cost <= lavish.cost
    assert plain.trace >= thrifty.trace >= lavish.trace
    assert lavish.trace == pytest.approx(
        float(ask(prior, sensors, bound=1e-9, weights=weights).choice.trace)
    )
    third = np.sort(weights[ask(prior, sensors, weights=weights).sure])[2]
    worth = 1.5 * third / BOUND
    for other in (plain, lavish):
        assert thrifty.cost + worth * thrifty.trace <= other.cost + worth * other.trace


def test_care_that_cannot_be_taken_is_refused():
    with pytest.raises(ConfigurationError) as refused:
        Care(1.0, np.nan, 2.0, 0.0, aim=1.5, thrift=np.inf, most=4)
    assert len(refused.value.problems) == 6
    with pytest.raises(InputError, match="not positive"):
        ask(belief(), field(), bound=0.0)
