"""Shortest tours through discs: proved by their bound, and found by another solver too."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from trackfield.errors import InputError
from trackfield.robot.optimum import shortest_tour
from trackfield.robot.rule import path_length, rule_path


def tracks(seed, n):
    rng = np.random.default_rng(seed)
    return rng.normal(size=2), np.cumsum(rng.normal(size=(n, 2)), axis=0)


def by_slsqp(start, centres, radii):
    """The same by SciPy's general solver, lengths rounded off by 1e-7 m."""

    def length(flat):
        steps = np.diff(flat.reshape(-1, 2), axis=0, prepend=start[None])
        lengths = np.sqrt(np.square(steps).sum(axis=1) + 1e-14)
        pull = steps / lengths[:, None]
        return lengths.sum(), (pull - np.vstack([pull[1:], np.zeros(2)])).ravel()

    inside = {
        "type": "ineq",
        "fun": lambda flat: radii**2 - np.square(flat.reshape(-1, 2) - centres).sum(axis=1),
    }
    options = {"maxiter": 2000, "ftol": 1e-12}
    found = minimize(
        length, centres.ravel(), jac=True, constraints=inside, method="SLSQP", options=options
    )
    return found.fun


@pytest.mark.parametrize("seed", range(8))
def test_another_solver_finds_no_shorter_tour(seed):
    start, centres = tracks(seed, 6)
    radii = np.random.default_rng(seed).uniform(0.2, 1.5, 6)
    tour = shortest_tour(start, centres, radius_m=radii)
    other = by_slsqp(start, centres, radii)
    assert other == pytest.approx(tour.length_m, rel=2e-4)
    assert other >= tour.bound_m * (1.0 - 1e-6)


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(1, 40), st.floats(0.01, 5.0))
def test_a_tour_is_feasible_and_proves_itself(seed, n, radius):
    start, centres = tracks(seed, n)
    tour = shortest_tour(start, centres, radius_m=radius)
    assert (np.linalg.norm(tour.path - centres, axis=1) <= radius).all()
    assert path_length(start, tour.path) == pytest.approx(tour.length_m)
    assert tour.bound_m <= tour.length_m * (1.0 + 1e-9) + 1e-12
    gap = 1e-5 if tour.met else 1e-3  # where rounding ends it sooner, it says so
    assert tour.length_m - tour.bound_m <= gap * max(tour.length_m, radius)
    # no feasible path is below the bound: the rule's, and one drawn at random
    rng = np.random.default_rng(seed)
    turn, away = rng.uniform(0.0, 2 * np.pi, n), radius * np.sqrt(rng.random(n))
    drawn = centres + away[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    for path in (rule_path(start, centres, reach_m=radius), drawn):
        assert path_length(start, path) >= tour.bound_m - 1e-9


def test_closed_forms():
    # into one disc: straight to its border; through discs on a line: straight to the last
    one = shortest_tour(np.zeros(2), np.array([[3.0, 4.0]]), radius_m=1.0)
    assert one.length_m == pytest.approx(4.0, rel=1e-5)
    line = np.column_stack([np.arange(1.0, 9.0), np.zeros(8)])
    assert shortest_tour(np.zeros(2), line, radius_m=0.5).length_m == pytest.approx(7.5, rel=1e-5)
    # there and back: to the far disc's border, where a mirror would send light
    back = np.array([[2.0, 3.0], [4.0, 0.0]])
    tour = shortest_tour(np.zeros(2), back, radius_m=np.array([1.0, 1e-6]))
    assert tour.length_m == pytest.approx(2.0 * np.hypot(2.0, 2.0), rel=1e-5)
    assert_allclose(tour.path[0], [2.0, 2.0], atol=1e-2)


def test_a_robot_that_is_in_all_discs_stays():
    start, centres = np.array([0.1, 0.0]), np.random.default_rng(0).normal(0.0, 0.1, (9, 2))
    tour = shortest_tour(start, centres, radius_m=2.0)
    assert tour == (pytest.approx(np.tile(start, (9, 1))), 0.0, 0.0, True)


def test_equal_discs_in_thousands():
    """Targets that stand still put discs on discs: no step has a length then."""
    angle = np.repeat(np.linspace(0.0, 20.0, 100), 20)
    centres = np.column_stack([angle, 3.0 * np.sin(angle)])
    tour = shortest_tour(centres[0], centres, radius_m=0.6)
    single = shortest_tour(centres[0], centres[::20], radius_m=0.6)
    assert tour.met
    assert tour.length_m == pytest.approx(single.length_m, rel=3e-5)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
def test_radii_that_are_none_are_refused(radius):
    with pytest.raises(InputError, match="radius_m"):
        shortest_tour(np.zeros(2), np.ones((3, 2)), radius_m=radius)
