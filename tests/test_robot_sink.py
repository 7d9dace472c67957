"""The robot's way to the sink over the network, and the messages that it spares."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.robot.sink import (
    DIRECT,
    master_traffic,
    relays,
    robot_traffic,
    route,
)

LINE = np.column_stack([np.arange(1.0, 9.0), np.zeros(8)])
SINK = np.zeros(2)


def fewest_hops(nodes, sink, robot, hop):
    """Breadth first over all nodes, the robot as one of them."""
    places = [robot, *nodes, sink]
    seen, queue = {0: 0}, [(0, 0)]
    while queue:
        hops, here = heapq.heappop(queue)
        for k, place in enumerate(places):
            if k not in seen and math.dist(places[here], place) <= hop:
                seen[k] = hops + 1
                heapq.heappush(queue, (hops + 1, k))
    return seen.get(len(places) - 1, -1)


def test_routes_are_those_of_a_search_of_the_whole_graph():
    rng = np.random.default_rng(0)
    nodes, robots = rng.uniform(0.0, 10.0, (120, 2)), rng.uniform(-2.0, 11.0, (40, 2))
    sink = np.array([0.5, 0.5])
    net = relays(nodes, sink, hop_m=1.6)
    found = route(net, robots)
    expected = [fewest_hops(nodes, sink, robot, 1.6) for robot in robots]
    assert np.array_equal(found.hops, expected)
    assert -1 in expected
    assert max(expected) > 5
    for robot, relay, hops in zip(robots, found.relay, found.hops, strict=True):
        if relay != DIRECT:
            assert math.dist(robot, nodes[relay]) <= 1.6
            assert net.hops[relay] == hops - 1
            away = np.linalg.norm(nodes - robot, axis=1)
            same = (net.hops == hops - 1) & (away <= 1.6)
            assert away[relay] == away[same].min()


def test_dead_nodes_pass_nothing_on():
    alive = np.ones(8, bool)
    alive[3] = False
    robots = np.array([[0.5, 0.0], [2.5, 0.0], [6.5, 0.0]])
    assert route(relays(LINE, SINK, hop_m=1.1), robots).hops.tolist() == [1, 3, 7]
    broken = route(relays(LINE, SINK, hop_m=1.1, alive=alive), robots)
    assert broken.hops.tolist() == [1, 3, -1]
    assert broken.relay.tolist() == [DIRECT, 1, DIRECT]


def test_traffic_is_counted_message_by_message():
    net = relays(LINE, SINK, hop_m=1.1)
    robots, sensing = np.array([[1.5, 0.0], [4.5, 0.0]]), np.array([3, 2], np.int32)
    own = robot_traffic(net, robots, sensing, radio=True)
    assert own == (5, 0, 0, 0)
    # hops 2 and 5 in all; the first of each is sent by the robot itself
    passed = robot_traffic(net, robots, sensing, radio=False)
    assert passed == (5, 0, 1 + 4, 0)
    # masters at 2, 2 and 5 m: a hand-over over 3 m needs three hops; reports go 2 + 2 + 5 hops
    masters = master_traffic(net, np.array([1, 1, 4], np.int32), np.array([3, 1, 4], np.int32))
    assert masters == (2 + 0 + 3, 3, 9, 0)
    assert masters.total == 17
    far = robot_traffic(net, np.array([[20.0, 0.0]]), np.array([1], np.int32), radio=False)
    assert far == (1, 0, 0, 1)
    alone = relays(LINE[4:], SINK, hop_m=1.1)
    assert master_traffic(alone, np.array([0], np.int32), np.array([1], np.int32)) == (0, 0, 0, 1)


@pytest.mark.parametrize("hop", [0.0, -1.0, math.inf, math.nan])
def test_hops_that_are_none_are_refused(hop):
    with pytest.raises(InputError, match="hop_m"):
        relays(LINE, SINK, hop_m=hop)
