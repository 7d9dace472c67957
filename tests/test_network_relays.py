"""Paths through the field: fewest hops as SciPy finds them, and every hop within reach."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import shortest_path

from trackfield.errors import InputError
from trackfield.network.relays import path_between, path_of, relays


def hops_on_the_graph(nodes, hop_m, works):
    apart = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    edges = (apart <= hop_m) & works & works[:, None] & ~np.eye(len(nodes), dtype=bool)
    return shortest_path(edges.astype(float), unweighted=True)


@given(seed=st.integers(0, 10_000), hop_m=st.floats(0.5, 6.0))
def test_ways_are_shortest_paths_on_the_explicit_graph(seed, hop_m):
    rng = np.random.default_rng(seed)
    positions, sinks = rng.uniform(0, 10, (30, 2)), rng.uniform(0, 10, (2, 2))
    works = rng.random(30) < 0.9
    nodes = np.concatenate([positions, sinks])
    far = hops_on_the_graph(nodes, hop_m, np.append(works, [True, True]))
    way = relays(positions, sinks, hop_m=hop_m, works=works)
    fewest = far[30:, :30].min(axis=0)
    expected = np.where(np.isfinite(fewest) & works, fewest, -1)
    np.testing.assert_array_equal(way.hops, expected)
    np.testing.assert_array_equal(way.cut_off, np.flatnonzero(expected == -1))
    for i in range(30):
        path = path_of(way, i)
        assert len(path) - 1 == max(expected[i], 0)
        if len(path) > 1:
            assert path[-1] >= 30
            assert all(works[j] for j in path[:-1])
        legs = np.linalg.norm(np.diff(nodes[path], axis=0), axis=1)
        assert (legs <= hop_m * (1 + 1e-9)).all()


@given(seed=st.integers(0, 10_000), hop_m=st.floats(0.5, 6.0))
def test_paths_between_nodes_are_shortest(seed, hop_m):
    rng = np.random.default_rng(seed)
    positions, works = rng.uniform(0, 10, (25, 2)), rng.random(25) < 0.9
    a, b = rng.integers(0, 25, 2)
    works[[a, b]] = True
    far = hops_on_the_graph(positions, hop_m, works)[a, b]
    path = path_between(positions, (int(a), int(b)), hop_m=hop_m, works=works)
    if not np.isfinite(far):
        assert path is None
        return
    assert path[0] == a
    assert path[-1] == b
    assert len(path) - 1 == far
    legs = np.linalg.norm(np.diff(positions[path], axis=0), axis=1)
    assert (legs <= hop_m * (1 + 1e-9)).all()
    assert path_between(positions, (int(a), int(b))) == ([a] if a == b else [a, b])


def test_the_next_of_equals_is_the_nearest_and_a_hop_is_a_length():
    positions = np.array([[2.0, 0.0], [1.0, 0.4], [1.0, -0.1]])
    way = relays(positions, np.array([[0.0, 0.0]]), hop_m=1.2)
    assert way.next_node.tolist() == [2, 3, 3]
    with pytest.raises(InputError, match="hop_m: found 0"):
        relays(positions, positions[:1], hop_m=0.0)
