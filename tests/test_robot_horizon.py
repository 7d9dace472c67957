"""The robot that looks ahead: what it foretells, that it keeps the hop, and what it saves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from robot_tracks import FIELD, NON_PERIODIC, sinusoid, wander
from trackfield.robot import forecast as robot_forecast
from trackfield.robot import waves as robot_waves
from trackfield.robot.forecast import Foresight
from trackfield.robot.horizon import Horizon, arrive, begin, horizon_path, step
from trackfield.robot.optimum import shortest_tour
from trackfield.robot.rule import beyond, path_length, rule_path

OVER_FIELD = Horizon(region=FIELD)


def led(track, seen, reach, horizon=OVER_FIELD):
    return horizon_path(
        track[0], seen, t_s=np.arange(float(len(seen))), reach_m=reach, horizon=horizon
    )


def remembered(track, t_s=None):
    memory = robot_forecast.NOTHING
    for t, place in zip(np.arange(len(track)) if t_s is None else t_s, track, strict=True):
        memory = robot_forecast.seen(memory, float(t), place)
    return memory


@settings(max_examples=50)
@given(
    st.floats(0.05, 0.8),
    st.integers(0, 10**6),
    st.integers(12, 60),
    st.floats(0.1, 10.0),
)
def test_a_wave_is_found_again(turn, seed, count, dt_s):
    """A drift and an oscillation, seen for a sixth of a period at least, give themselves away."""
    rng = np.random.default_rng(seed)
    count = max(count, int(1.0 / turn) + 2)
    t = 100.0 + dt_s * np.arange(count)
    made = robot_waves.Waves(t[-1:], np.full((1, 2), turn / dt_s), rng.normal(size=(1, 4, 2)))
    made.coefficients[0, 1] /= dt_s
    fit = robot_waves.fit_wave(t, robot_waves.at(made, t)[0])
    later = t[-1] + dt_s * np.arange(1.0, count / 2)
    assert_allclose(robot_waves.at(fit, later), robot_waves.at(made, later), atol=1e-3)


def test_each_axis_may_have_its_own_rate():
    t = np.arange(60.0)
    track = np.column_stack([5.0 - 5.0 * np.cos(0.1 * t), 4.0 + np.sin(0.35 * t + 1.0) - 0.1 * t])
    fit = robot_waves.fit_axes(t[:40], track[:40])
    assert_allclose(fit.rate, [[0.1, 0.35]], rtol=1e-6)
    assert_allclose(robot_waves.at(fit, t)[0], track, atol=1e-5)
    both = robot_waves.fit_wave(t[:40], track[:40])
    assert np.abs(robot_waves.at(both, t)[0] - track).max() > 0.1


def test_a_wave_is_least_squares_at_its_rate():
    rng = np.random.default_rng(0)
    t = np.arange(40.0)
    track = sinusoid(39, periods=2.0) + 0.1 * rng.standard_normal((40, 2))
    fit = robot_waves.fit_wave(t, track)
    s = t - t[-1]

    def left_over(rate):
        X = np.column_stack([np.ones(40), s, np.cos(rate * s), np.sin(rate * s)])
        return np.linalg.lstsq(X, track, rcond=None)[1].sum()

    found = np.square(robot_waves.at(fit, t)[0] - track).sum()
    rates = np.linspace(0.05, 2.0, 2000)
    assert found <= 1.02 * min(left_over(rate) for rate in rates)
    assert found >= left_over(fit.rate[0, 0]) * (1.0 - 1e-9)


def test_a_line_is_the_regression():
    rng = np.random.default_rng(1)
    t, track = np.array([0.0, 1.0, 2.5, 3.0]), rng.normal(size=(4, 2))
    fit = robot_waves.fit_line(t, track)
    expected = [np.polyval(np.polyfit(t, axis, 1), [4.0, 9.0]) for axis in track.T]
    assert_allclose(robot_waves.at(fit, np.array([4.0, 9.0]))[0].T, expected)


def test_memory_is_bounded_and_thins_evenly():
    memory = remembered(sinusoid(2000))
    assert len(memory.t_s) <= robot_forecast.KEPT
    assert_allclose(np.diff(memory.t_s), memory.spacing_s)
    assert memory.t_s[-1] >= 2000 - memory.spacing_s
    assert all(stack.t_s.size <= 64 for stack in memory.fits)


def test_what_held_is_believed_and_what_did_not_is_not():
    wide = Foresight()
    exact = remembered(sinusoid(96)[:30])
    told = robot_forecast.forecast(exact, 29.0, tolerance_m=0.5, foresight=wide)
    whole = sinusoid(960, periods=30.0, across=100.0)
    assert told.t_s[-1] - 29.0 > 190.0
    assert_allclose(told.position, whole[told.t_s.astype(int)], atol=1e-3)

    rng = np.random.default_rng(2)
    walk = remembered(np.cumsum(rng.normal(size=(60, 2)), axis=0))
    told = robot_forecast.forecast(walk, 59.0, tolerance_m=1.0, foresight=wide)
    assert len(told.t_s) == 0
    nothing = robot_forecast.forecast(robot_forecast.NOTHING, 0.0, tolerance_m=1.0, foresight=wide)
    assert len(nothing.position) == 0


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.sampled_from(NON_PERIODIC), st.floats(0.3, 3.0))
def test_the_hop_is_kept_and_the_stake_not_exceeded(seed, kind, reach):
    rng = np.random.default_rng(seed)
    track = wander(rng, kind, 40)
    seen = track + 0.05 * rng.standard_normal(track.shape)
    for stake in (0.0, 0.3):
        path = led(track, seen, reach, Horizon(stake=stake))
        assert (beyond(path, seen, reach_m=reach) == 0.0).all()
        rule = rule_path(track[0], seen, reach_m=reach)
        for k in range(0, 41, 10):  # at any time, not only at the end
            ours = path_length(track[0], path[: k + 1])
            assert ours <= path_length(track[0], rule[: k + 1]) + (stake + 1e-6) * reach
    assert_allclose(led(track, seen, reach, Horizon(stake=0.0)), rule, atol=1e-4)


def test_a_robot_that_sees_nothing_to_come_follows_the_rule():
    track = sinusoid(60)
    blind = Horizon(foresight=Foresight(most=0))
    assert_allclose(led(track, track, 0.6, blind), rule_path(track[0], track, reach_m=0.6))


def test_a_reach_may_change_from_step_to_step():
    track = sinusoid(60)
    reach = np.linspace(1.0, 0.4, 61)
    path = horizon_path(track[0], track, t_s=np.arange(61.0), reach_m=reach)
    assert (beyond(path, track, reach_m=reach) == 0.0).all()


def test_the_robot_moves_when_it_is_moved():
    state = begin([0.0, 0.0])
    far = np.array([3.0, 0.0])
    state, advice = step(state, far, t_s=0.0, reach_m=1.0, horizon=Horizon())
    assert_allclose(advice.place, [2.0, 0.0])
    assert_allclose(state.place, 0.0)
    state = arrive(state, np.array([1.0, 0.0]), way_m=1.5)
    assert state.way_m == 1.5
    state, advice = step(state, far, t_s=1.0, reach_m=1.0, horizon=Horizon())
    assert_allclose(advice.place, [2.0, 0.0])


# Reaches are those of communication ranges 2, 2.5, 4 and 6 with a sensing range of 1.4.
@pytest.mark.parametrize(("sigma", "bar"), [(0.0, 1.03), (0.02, 1.05), (0.1, 1.10)])
def test_sinusoids_cost_little_more_than_the_optimum(sigma, bar):
    rng = np.random.default_rng(77)
    for reach in (0.6, 1.1, 2.6, 4.6):
        ratios = []
        for periods, steps in ((2.0, 64), (3.0, 96)):
            for amplitude in (2.0, 3.0):
                track = sinusoid(steps, periods, amplitude, rng.uniform(0.0, 2 * np.pi))
                seen = track + sigma * rng.standard_normal(track.shape)
                best = shortest_tour(track[0], seen, radius_m=reach).length_m
                ratios.append(path_length(track[0], led(track, seen, reach)) / best)
        assert np.mean(ratios) <= bar


def test_paths_without_a_period_cost_no_more_than_the_rule():
    rng = np.random.default_rng(78)
    for kind in NON_PERIODIC:
        ours = rule = 0.0
        for reach in (0.6, 1.1, 2.6):
            track = wander(rng, kind, 120)
            ours += path_length(track[0], led(track, track, reach))
            rule += path_length(track[0], rule_path(track[0], track, reach_m=reach))
        assert ours <= 1.01 * rule
