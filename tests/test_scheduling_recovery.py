"""Missed targets: wherever they went, who looks for them finds them, until they are gone."""

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.motion import ConstantVelocity
from trackfield.network.boxes import Box, box_of
from trackfield.network.node_index import NodeIndex
from trackfield.raster import Region
from trackfield.scheduling.recovery import search_believed, search_reachable

FIELD = Region(0.0, 0.0, 10.0, 10.0)
TICKS = 0.5 * np.arange(21)
GRID = NodeIndex(np.stack(np.meshgrid(TICKS, TICKS), axis=-1).reshape(-1, 2))
SPACE = Box(np.zeros(3), np.array([10.0, 10.0, 6.0]))


def looked_at(nodes, search, track, places, reach):
    watchers = search.node[search.track == track]
    apart = np.linalg.norm(places[:, None] - nodes.positions[watchers], axis=2)
    return (apart <= np.broadcast_to(reach, len(nodes))[watchers]).any(axis=1)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_target_that_stays_in_the_field_is_found_however_it_went(dimensions):
    rng = np.random.default_rng(dimensions)
    nodes = GRID if dimensions == 2 else NodeIndex(rng.uniform(0, [10, 10, 6], (1000, 3)))
    field, speed = FIELD if dimensions == 2 else SPACE, 1.5
    reach = rng.uniform(0.6, 1.3, len(nodes))
    box = box_of(field)
    last = rng.uniform(box.low, box.high, (3, dimensions))
    elapsed = np.array([0.2, 1.0, 4.0])
    search = search_reachable(
        nodes, last, elapsed_s=elapsed, max_speed_m_s=speed, reach_m=reach, field=field
    )
    for track in range(3):
        way = rng.normal(size=(1500, dimensions))
        way *= rng.uniform(0, 1, (1500, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
        places = last[track] + speed * elapsed[track] * way
        places = places[box.outside(places) == 0]
        apart = np.linalg.norm(places[:, None] - nodes.positions, axis=2)
        any_node = (apart <= reach).any(axis=1)  # in space there are holes, which nobody can help
        np.testing.assert_array_equal(looked_at(nodes, search, track, places, reach), any_node)
    assert not search.whole.any()
    assert not search.gone.any()


def test_the_search_widens_only_as_needed_and_ends_with_the_whole_field():
    last = np.array([[4.0, 6.0]])
    before, sizes, ends = set(), [], []
    for elapsed in np.linspace(0.0, 10.0, 21):
        search = search_reachable(
            GRID, last, elapsed_s=np.array([elapsed]), max_speed_m_s=1.0, reach_m=1.0, field=FIELD
        )
        looking = set(search.node.tolist())
        apart = np.linalg.norm(GRID.positions - last, axis=1)
        assert looking == set(np.flatnonzero(apart <= elapsed + 1.0 + 1e-9).tolist())
        assert before <= looking
        before = looking
        sizes.append(len(looking))
        ends.append(bool(search.whole[0]))
    assert sizes[0] == 13
    assert sizes[-1] == 441
    farthest = np.hypot(6.0, 6.0)
    assert ends == (np.linspace(0.0, 10.0, 21) >= farthest).tolist()


def test_nobody_looks_for_a_target_that_must_have_left():
    last = np.array([[12.0, 5.0], [12.0, 5.0]])
    search = search_reachable(
        GRID,
        last,
        elapsed_s=np.array([1.9, 2.1]),
        max_speed_m_s=1.0,
        reach_m=1.0,
        field=FIELD,
    )
    assert search.gone.tolist() == [True, False]
    assert set(search.track.tolist()) == {1}


def test_each_node_looks_as_far_as_it_sees():
    rng = np.random.default_rng(6)
    reach = rng.uniform(0.3, 2.0, 441)
    last = np.array([[4.0, 6.0]])
    apart = np.linalg.norm(GRID.positions - last, axis=1)
    reachable = search_reachable(
        GRID, last, elapsed_s=np.ones(1), max_speed_m_s=1.0, reach_m=reach, field=FIELD
    )
    assert reachable.node.tolist() == np.flatnonzero(apart <= 1.0 + reach).tolist()
    radius = np.sqrt(-2 * np.log(0.1) * 0.25)
    believed = search_believed(
        GRID,
        last,
        covariances=0.25 * np.eye(2)[None],
        probability=0.9,
        reach_m=reach,
        field=FIELD,
    )
    assert believed.node.tolist() == np.flatnonzero(apart <= radius + reach).tolist()


def test_a_believed_target_is_found_as_often_as_asked():
    """Coasting from the last update: the ellipsoid widens, and holds the target with .9."""
    rng = np.random.default_rng(4)
    motion, reach = ConstantVelocity(0.1), 1.0
    mean, root = np.array([4.0, 5.0, 0.6, -0.4]), np.diag([0.2, 0.2, 0.4, 0.4])
    sizes = []
    for elapsed in (0.5, 1.0, 2.0):
        F, Q = motion.transition(elapsed), motion.noise(elapsed)
        P = F @ root @ root @ F.T + Q
        search = search_believed(
            GRID,
            (F @ mean)[None, :2],
            covariances=P[None, :2, :2],
            probability=0.9,
            reach_m=reach,
            field=FIELD,
        )
        states = mean + rng.normal(size=(4000, 4)) @ root
        noise = np.linalg.cholesky(Q)
        places = (states @ F.T + rng.normal(size=(4000, 4)) @ noise.T)[:, :2]
        places = places[FIELD.contains(places)]
        found = looked_at(GRID, search, 0, places, reach).mean()
        assert found >= 0.9 - 3 * np.sqrt(0.09 / 4000)
        sizes.append(search.node.size)
        assert not search.whole[0]
    assert sizes == sorted(sizes)
    assert sizes[0] < 60
    # A node beyond reach of the ellipsoid sleeps: the least of it is what the axes say.
    gate = -2 * np.log(0.1)
    axis = (F @ mean)[0] + np.sqrt(gate * P[0, 0])
    watchers = GRID.positions[search.node]
    assert watchers[:, 0].max() <= axis + reach
    assert watchers[:, 0].max() >= axis + reach - 0.6


def test_a_belief_wider_than_the_field_ends_the_search_and_one_outside_is_gone():
    means = np.array([[5.0, 5.0], [5.0, 5.0], [25.0, 5.0]])
    covariances = np.array([100.0, 1.0, 1.0])[:, None, None] * np.eye(2)
    search = search_believed(
        GRID, means, covariances=covariances, probability=0.95, reach_m=1.0, field=FIELD
    )
    assert search.whole.tolist() == [True, False, False]
    assert search.gone.tolist() == [False, False, True]
    assert np.bincount(search.track).tolist()[0] == 441
    assert 2 not in search.track


def test_a_belief_ends_at_the_border_of_its_ellipse():
    """Wide in x, narrow in y, with a gate of 4.6: half an axis is 2.15 and 0.215 wide."""
    half = np.sqrt(-2 * np.log(0.1)) * np.array([1.0, 0.1])
    middle = np.array([5.0, 5.0])
    means = np.array(
        [
            [-half[0] - 0.01, 5.0],
            [-half[0] + 0.01, 5.0],
            [10.0 + half[0] + 0.01, 5.0],
            [10.0 + half[0] - 0.01, 5.0],
            [5.0, -half[1] - 0.01],
            [5.0, 10.0 + half[1] - 0.01],
        ]
    )
    search = search_believed(
        GRID,
        means,
        covariances=np.broadcast_to(np.diag([1.0, 0.01]), (6, 2, 2)),
        probability=0.9,
        reach_m=1.0,
        field=FIELD,
    )
    assert search.gone.tolist() == [True, False, True, False, True, False]
    # One that holds some corners of the field, and one that just holds all of them.
    reach = np.hypot(5.0, 5.0) / np.sqrt(-2 * np.log(0.1))
    corner = search_believed(
        GRID,
        np.array([[0.0, 0.0], [5.0, 5.0], middle]),
        covariances=np.array([1.0, (0.999 * reach) ** 2, (1.001 * reach) ** 2])[:, None, None]
        * np.eye(2),
        probability=0.9,
        reach_m=1.0,
        field=FIELD,
    )
    assert corner.whole.tolist() == [False, False, True]


def test_nodes_that_see_nothing_of_the_field_do_not_look():
    nodes = NodeIndex(np.array([[5.0, 5.0], [-0.5, 5.0], [-1.5, 5.0]]))
    search = search_reachable(
        nodes,
        np.array([[0.5, 5.0]]),
        elapsed_s=np.array([20.0]),
        max_speed_m_s=1.0,
        reach_m=1.0,
        field=FIELD,
    )
    assert search.node.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"max_speed_m_s": -1.0}, "negative"),
        ({"elapsed_s": np.array([-1.0])}, "negative"),
        ({"elapsed_s": np.array([np.nan])}, "negative"),
        ({"field": Region(0, 0, 0, 1)}, "low below high"),
        ({"field": Box(np.zeros(1), np.ones(1))}, "two or three"),
    ],
)
def test_a_search_that_cannot_be_is_refused(change, words):
    given = {
        "elapsed_s": np.array([1.0]),
        "max_speed_m_s": 1.0,
        "reach_m": 1.0,
        "field": FIELD,
    } | change
    with pytest.raises(InputError, match=words):
        search_reachable(GRID, np.array([[5.0, 5.0]]), **given)


def test_a_covariance_of_another_shape_is_refused():
    with pytest.raises(InputError, match=r"\(t, 2, 2\)"):
        search_believed(
            GRID,
            np.zeros((1, 2)),
            covariances=np.eye(3)[None],
            probability=0.9,
            reach_m=1.0,
            field=FIELD,
        )
