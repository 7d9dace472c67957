"""The watch of the border: targets that come in, on any way, against the shifts of nodes."""

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, milp

from trackfield.errors import InputError
from trackfield.network.node_index import NodeIndex
from trackfield.raster import Region
from trackfield.scheduling.watch import on_duty, watch_border

REGION = Region(0.0, 0.0, 10.0, 10.0)
TICKS = 0.5 * np.arange(21)
PHAM = NodeIndex(np.stack(np.meshgrid(TICKS, TICKS), axis=-1).reshape(-1, 2))
"""The field of the thesis."""


def first_looks(rng, count, *, max_speed, step):
    """Places where targets stand at the first look after they came in: bent ways, any speed."""
    side, along = rng.integers(0, 4, count), rng.uniform(0, 10, count)
    border = np.select(
        [side[:, None] == s for s in range(4)],
        [
            np.column_stack([along, 0 * along]),
            np.column_stack([along, 0 * along + 10]),
            np.column_stack([0 * along, along]),
            np.column_stack([0 * along + 10, along]),
        ],
    )
    left = rng.uniform(0, step, (count, 1))  # from the entry to the next look
    share = rng.uniform(0, 1, (count, 1))
    for part in (share, 1 - share):  # two legs, each straight
        angle = rng.uniform(-np.pi, np.pi, count)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        border = border + part * left * max_speed * rng.uniform(0.5, 1, (count, 1)) * way
    return border[REGION.contains(border)]


def seen(places, watchers, reach):
    apart = np.linalg.norm(places[:, None] - PHAM.positions[watchers], axis=2)
    return (apart <= np.broadcast_to(reach, len(PHAM))[watchers]).any(axis=1)


@pytest.mark.parametrize("reach", [1.2, np.random.default_rng(0).uniform(0.8, 2.0, 441)])
def test_whoever_comes_in_is_seen_within_a_step_by_every_shift(reach):
    rng = np.random.default_rng(1)
    watch = watch_border(PHAM, REGION, reach_m=reach, depth_m=2.0 * 0.25)
    places = first_looks(rng, 20_000, max_speed=2.0, step=0.25)
    assert not watch.open.size
    assert len(watch.shifts) >= 7
    for shift in watch.shifts:
        assert seen(places, shift, reach).all()
        # Hardly a node is for nothing: without it, somebody comes in unseen.
        some = places[:8000]
        missed = [not seen(some, np.delete(shift, i), reach).all() for i in range(len(shift))]
        assert np.mean(missed) > 0.7


def test_faster_targets_slip_through():
    watch = watch_border(PHAM, REGION, reach_m=1.2, depth_m=0.5)
    places = first_looks(np.random.default_rng(2), 40_000, max_speed=8.0, step=0.25)
    assert not all(seen(places, shift, 1.2).all() for shift in watch.shifts)


def test_shifts_share_no_node_and_as_many_as_can_be_are_found():
    for seed in range(6):
        nodes = NodeIndex(np.random.default_rng(seed).uniform(0, 10, (441, 2)))
        watch = watch_border(nodes, REGION, reach_m=1.5, depth_m=0.3)
        every = np.concatenate(watch.shifts)
        assert np.unique(every).size == every.size
        assert watch.most - 1 <= len(watch.shifts) <= watch.most
    grid = watch_border(PHAM, REGION, reach_m=1.5, depth_m=0.3)
    assert len(grid.shifts) == grid.most == 9


def test_a_shift_is_hardly_larger_than_the_smallest_there_is():
    """The smallest set of nodes that sees the same cells, by integer programming."""
    watch = watch_border(PHAM, REGION, reach_m=1.5, depth_m=0.3, cell_m=0.25)
    ticks = 0.25 * (np.arange(40) + 0.5)
    cells = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    cells = cells[(np.minimum(cells, 10 - cells) - 0.125).min(axis=1) < 0.3]
    apart = np.linalg.norm(cells[:, None] - PHAM.positions, axis=2)
    sees = (apart <= 1.5 - 0.125 * np.sqrt(2)).astype(float)
    best = milp(
        np.ones(441),
        constraints=LinearConstraint(sees, lb=1.0),
        integrality=np.ones(441),
        bounds=(0, 1),
        options={"time_limit": 20.0},
    )
    assert best.success
    for shift in watch.shifts:
        seen_by = sees[:, shift].sum(axis=1)
        assert (seen_by >= 1).all()
        # No node can be left out: each is the only one to see some cell.
        assert (sees[seen_by == 1][:, shift].sum(axis=0) >= 1).all()
    assert len(watch.shifts[0]) <= 1.35 * round(best.fun)


def test_where_nobody_sees_is_said_and_the_rest_is_watched():
    hole = np.linalg.norm(PHAM.positions - [0.0, 5.0], axis=1) < 1.6
    nodes = NodeIndex(PHAM.positions[~hole])
    watch = watch_border(nodes, REGION, reach_m=0.8, depth_m=0.3)
    assert watch.open.size
    assert np.linalg.norm(watch.open - [0.0, 5.0], axis=1).max() < 1.6
    assert len(watch.shifts) == watch.most > 0


def test_nobody_watches_what_nobody_sees():
    watch = watch_border(NodeIndex(np.array([[5.0, 5.0]])), REGION, reach_m=1.0, depth_m=0.3)
    assert (watch.shifts, watch.most) == ((), 0)
    assert on_duty(watch, 3).size == 0


def test_turns_go_round():
    watch = watch_border(PHAM, REGION, reach_m=1.5, depth_m=0.3, most=3)
    assert len(watch.shifts) == 3
    for turn in range(7):
        np.testing.assert_array_equal(on_duty(watch, turn), watch.shifts[turn % 3])


def test_ten_thousand_nodes_share_a_watch():
    nodes = NodeIndex(np.random.default_rng(0).uniform(0, 100, (10_000, 2)))
    watch = watch_border(nodes, Region(0, 0, 100, 100), reach_m=3.0, depth_m=0.5)
    assert len(watch.shifts) == watch.most == 4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"nodes": NodeIndex(np.zeros((1, 3)))}, "in the plane"),
        ({"reach_m": 0.0}, "above 0"),
        ({"reach_m": np.nan}, "above 0"),
        ({"depth_m": -1.0}, "above 0"),
        ({"reach_m": np.ones(3)}, "one number or 441"),
        ({"cell_m": 1e-6}, "at most"),
        ({"cell_m": -1.0}, "at most"),
        ({"region": Region(0, 0, 0, 5)}, "area"),
    ],
)
def test_what_cannot_be_watched_is_refused(change, words):
    given = {"nodes": PHAM, "region": REGION, "reach_m": 1.0, "depth_m": 0.3} | change
    nodes, region = given.pop("nodes"), given.pop("region")
    with pytest.raises(InputError, match=words):
        watch_border(nodes, region, **given)
