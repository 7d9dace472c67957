"""Groups and hops: laws, and equality with shortest paths on the explicit graph."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import shortest_path

from trackfield.errors import InputError
from trackfield.network.channel import Channel
from trackfield.network.near import nearest_point, points_within
from trackfield.network.topology import (
    UNREACHED,
    hops_to_leaders,
    lay_out,
    links,
    misplaced,
    nearest,
)


def grid(side, spacing_m=1.0):
    ticks = spacing_m * (np.arange(side) + 0.5)
    return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


def hops_on_the_graph(positions, leaders, hop_m, alive):
    """SciPy's shortest paths on the graph with every edge written down."""
    nodes = np.concatenate([positions, leaders])
    works = np.concatenate([alive, np.ones(len(leaders), bool)])
    apart = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    edges = (apart <= hop_m) & works & works[:, None] & ~np.eye(len(nodes), dtype=bool)
    far = shortest_path(edges.astype(float), unweighted=True)[len(positions) :, : len(positions)]
    return np.where(np.isfinite(far), far, UNREACHED).astype(int)


@given(seed=st.integers(0, 10_000), hop_m=st.floats(0.5, 6.0), few=st.booleans())
def test_hops_are_those_of_shortest_paths_on_the_explicit_graph(seed, hop_m, few):
    rng = np.random.default_rng(seed)
    positions, leaders = rng.uniform(0, 10, (40, 2)), rng.uniform(0, 10, (3, 2))
    dead = [int(i) for i in np.flatnonzero(rng.random(40) < 0.1)]
    alive = np.ones(40, bool)
    alive[dead] = False
    expected = hops_on_the_graph(positions, leaders, hop_m, alive)
    found = hops_to_leaders(positions, leaders, hop_m=hop_m, alive=alive)
    np.testing.assert_array_equal(found, expected)

    laid = lay_out(Channel(hop_m=hop_m, fewest_links=few), positions, leaders, dead=dead)
    group, hops = laid.routes
    np.testing.assert_array_equal(hops, expected[group, np.arange(40)])
    near = np.linalg.norm(positions[:, None] - leaders, axis=2)
    for i in range(40):
        if few:
            far = [math.inf if h == UNREACHED else h for h in expected[:, i]]
            best = min(range(3), key=lambda j, far=far, i=i: (far[j], near[i, j]))
        else:
            best = int(np.argmin(near[i]))
        assert group[i] == best
    reached = hops != UNREACHED
    np.testing.assert_array_equal(laid.cut_off, np.flatnonzero(alive & ~reached))
    assert not (reached & ~alive).any()


@given(seed=st.integers(0, 1000), hop_m=st.floats(0.1, 20.0))
def test_links_join_exactly_those_within_a_hop(seed, hop_m):
    positions = np.random.default_rng(seed).uniform(0, 10, (25, 2))
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    expected = (apart <= hop_m) & ~np.eye(25, dtype=bool)
    np.testing.assert_array_equal(links(positions, hop_m).toarray().astype(bool), expected)


def test_a_hop_of_exactly_the_spacing_reaches_the_neighbour():
    """Rounding of positions must not cut a regular field into pieces."""
    positions = grid(7, 0.1)
    laid = lay_out(Channel(hop_m=0.1), positions, positions[:1])
    assert laid.cut_off.size == 0
    assert laid.routes.hops.max() == 12
    assert links(positions, 0.1).nnz == 2 * 2 * 6 * 7


def test_the_field_of_the_paper():
    """100 x 100 sensors, tier-2 nodes in the middle of the quadrants, hops of 11.5."""
    leaders = np.array([[25.0, 25.0], [75.0, 25.0], [25.0, 75.0], [75.0, 75.0]])
    laid = lay_out(Channel(hop_m=11.5), grid(100), leaders)
    assert np.bincount(laid.routes.group).tolist() == [2500] * 4
    distance = np.linalg.norm(laid.positions - leaders[laid.routes.group], axis=1)
    assert (laid.routes.hops >= np.ceil(distance / 11.5)).all()
    assert np.bincount(laid.routes.hops).tolist() == [0, 1632, 4832, 3520, 16]


def test_dead_nodes_relay_nothing_and_who_is_cut_off_is_known():
    line = np.column_stack([np.arange(6.0), np.zeros(6)])
    leader = np.array([[-1.0, 0.0]])
    assert lay_out(Channel(hop_m=1.0), line, leader).routes.hops.tolist() == [1, 2, 3, 4, 5, 6]
    laid = lay_out(Channel(hop_m=1.0), line, leader, dead=[2])
    assert laid.routes.hops.tolist() == [1, 2, -1, -1, -1, -1]
    assert laid.cut_off.tolist() == [3, 4, 5]


def test_fewest_links_goes_round_a_gap_to_the_leader_that_can_be_reached():
    positions = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    leaders = np.array([[-1.2, 0.0], [3.0, 0.0]])
    near = lay_out(Channel(hop_m=1.0), positions, leaders).routes
    few = lay_out(Channel(hop_m=1.0, fewest_links=True), positions, leaders).routes
    assert (near.group.tolist(), near.hops.tolist()) == ([0, 1, 1], [-1, 2, 1])
    assert (few.group.tolist(), few.hops.tolist()) == ([1, 1, 1], [3, 2, 1])


def test_without_leaders_every_living_node_is_one_hop_from_the_base():
    laid = lay_out(Channel(hop_m=0.1), grid(3), np.empty((0, 2)), dead=[4])
    assert laid.routes.hops.tolist() == [1, 1, 1, 1, -1, 1, 1, 1, 1]
    assert laid.cut_off.size == 0


@pytest.mark.parametrize("which", ["sensors", "tier-2 nodes"])
def test_positions_that_are_no_numbers_are_refused(which):
    positions, leaders = grid(2), np.zeros((1, 2))
    (positions if which == "sensors" else leaders)[0, 1] = math.nan
    with pytest.raises(InputError, match=rf"{which}: found a position .* \(number 0\)"):
        lay_out(Channel(), positions, leaders)


def test_misplaced_nodes_are_off_by_sigma_on_each_axis():
    off = misplaced(grid(100), 0.3, rng=np.random.default_rng(0)) - grid(100)
    np.testing.assert_allclose(off.std(axis=0), 0.3, rtol=0.02)
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.01)


@given(seed=st.integers(0, 1000), radius_m=st.floats(0.0, 5.0))
def test_near_points_are_those_of_a_plain_search(seed, radius_m):
    rng = np.random.default_rng(seed)
    points, places = rng.uniform(0, 10, (15, 2)), rng.uniform(0, 10, (7, 2))
    apart = np.linalg.norm(points[:, None] - places, axis=2)
    found = points_within(points, places, radius_m)
    expected = [(i, j) for j in range(7) for i in range(15) if apart[i, j] <= radius_m]
    assert list(zip(found.first.tolist(), found.second.tolist(), strict=True)) == expected
    np.testing.assert_allclose(found.distance, apart[found.first, found.second])
    best = nearest_point(points, places, within_m=radius_m)
    np.testing.assert_array_equal(np.isfinite(best.distance), (apart <= radius_m).any(axis=0))
    np.testing.assert_array_equal(nearest(places, points), apart.argmin(axis=0))
