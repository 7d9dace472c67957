"""Chains of nodes on one line with the target, against a graph's components."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from trackfield.errors import InputError
from trackfield.scheduling.chains import ANGLE_RAD, chains, eliminate_collinear


def line_angles(u):
    """Angles between lines, each with each."""
    unit = u / np.linalg.norm(u, axis=1)[:, None]
    return np.arccos(np.clip(np.abs(unit @ unit.T), 0.0, 1.0))


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.floats(0.02, 0.6))
def test_chains_are_the_components_of_lines_closer_than_the_angle(seed, n, angle):
    u = np.random.default_rng(seed).standard_normal((n, 2))
    count, labels = connected_components(line_angles(u) < angle, directed=False)
    found = chains(u, angle_rad=angle)
    assert len(set(found.tolist())) == count
    same = found[:, None] == found
    np.testing.assert_array_equal(same, labels[:, None] == labels)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_two_of_each_chain_stay_those_with_most_energy(seed, n):
    rng = np.random.default_rng(seed)
    u, x = rng.standard_normal((n, 2)), rng.integers(0, 6, n).astype(float)
    kept = eliminate_collinear(u, x)
    numbers = chains(u)
    assert (np.diff(kept) > 0).all()
    for number in set(numbers.tolist()):
        members = np.flatnonzero(numbers == number)
        best = sorted(members, key=lambda i: (-x[i], i))[:2]
        assert sorted(best) == [i for i in kept if numbers[i] == number]


def test_opposite_sides_are_one_line_and_the_circle_closes():
    u = np.array([[1.0, 0.01], [-1.0, 0.0], [1.0, -0.01], [0.0, 1.0], [0.0, -2.0]])
    np.testing.assert_array_equal(chains(u) == chains(u)[0], [True, True, True, False, False])
    all_round = np.array([[math.cos(a), math.sin(a)] for a in np.arange(0, 2 * math.pi, 0.2)])
    assert set(chains(all_round).tolist()) == {0}
    assert len(eliminate_collinear(all_round, np.ones(len(all_round)))) == 2
    np.testing.assert_array_equal(chains(np.array([[1.0, -1e-20], [1.0, 0.0]])), [0, 0])


def test_a_node_at_the_target_has_no_line():
    u = np.array([[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_array_equal(chains(u), [-1, 0])
    np.testing.assert_array_equal(eliminate_collinear(u, np.ones(2)), [1])
    assert chains(np.zeros((2, 2))).tolist() == [-1, -1]
    assert eliminate_collinear(np.zeros((0, 2)), np.zeros(0)).size == 0


def test_of_24_nodes_in_a_disc_about_six_stay_as_in_the_paper():
    rng = np.random.default_rng(7)
    counts = []
    for _ in range(400):
        bearing = rng.uniform(0.0, 2.0 * math.pi, 24)
        u = np.column_stack([np.cos(bearing), np.sin(bearing)])
        counts.append(len(eliminate_collinear(u, rng.random(24), angle_rad=ANGLE_RAD)))
    assert np.mean(counts) == pytest.approx(6.1, abs=0.3)


@pytest.mark.parametrize(
    ("u", "x", "angle", "message"),
    [
        (np.zeros((2, 3)), np.ones(2), 0.2, r"\(2, 3\)"),
        (np.full((2, 2), np.nan), np.ones(2), 0.2, "finite"),
        (np.ones((2, 2)), np.ones(3), 0.2, "residual of shape"),
        (np.ones((2, 2)), np.array([1.0, -1.0]), 0.2, "0 or more"),
        (np.ones((2, 2)), np.ones(2), 0.0, "angle_rad"),
        (np.ones((2, 2)), np.ones(2), 4.0, "angle_rad"),
    ],
)
def test_bad_input_is_refused(u, x, angle, message):
    with pytest.raises(InputError, match=message):
        eliminate_collinear(u, x, angle_rad=angle)
