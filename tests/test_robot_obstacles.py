"""Obstacles: free places, clear segments and shortest ways, against plain twins of all corners."""

from __future__ import annotations

import heapq
import itertools
import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trackfield.errors import InputError
from trackfield.robot.convex_parts import grown, parts_of
from trackfield.robot.obstacles import Obstacles

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
HOOK = np.array([[0, 0], [5, 0], [5, 4], [0, 4], [0, 3], [4, 3], [4, 1], [0, 1.0]])


def star(rng, middle, size):
    """A polygon that sees all of itself from its middle, seldom convex."""
    corners = int(rng.integers(3, 9))
    angle = 2 * np.pi * (np.arange(corners) + rng.uniform(0.1, 0.9, corners)) / corners
    away = size * rng.uniform(0.3, 1.0, corners)
    return middle + away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def scene(seed, count=5, field=10.0):
    rng = np.random.default_rng(seed)
    return [star(rng, rng.uniform(0.0, field, 2), 1.6) for _ in range(count)], rng


def inside(polygon, x, y):
    """Even-odd rule, edge by edge; the border is outside."""
    odd = False
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        length = math.hypot(bx - ax, by - ay)
        if abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) < 1e-9 * length and (
            0.0 <= (bx - ax) * (x - ax) + (by - ay) * (y - ay) <= length**2
        ):
            return False
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            odd = not odd
    return odd


def plainly_clear(polygons, a, b):
    """Cut the segment at all edges; the middle of no piece is inside."""
    cuts = [0.0, 1.0]
    dx, dy = b[0] - a[0], b[1] - a[1]
    for polygon in polygons:
        for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            ex, ey = q[0] - p[0], q[1] - p[1]
            det = ex * dy - ey * dx
            if det:
                cuts.append((ex * (p[1] - a[1]) - ey * (p[0] - a[0])) / det)
    cuts = sorted(t for t in cuts if 0.0 <= t <= 1.0)
    middles = [(s + t) / 2 for s, t in itertools.pairwise(cuts) if t - s > 1e-7]
    return not any(inside(q, a[0] + t * dx, a[1] + t * dy) for t in middles for q in polygons)


def plain_length(polygons, a, b):
    """Dijkstra over every corner and both ends, every pair looked at."""
    nodes = [a, b, *np.concatenate(polygons)]
    best, queue = {}, [(0.0, 0)]
    while queue:
        so_far, here = heapq.heappop(queue)
        if here in best:
            continue
        best[here] = so_far
        if here == 1:
            return so_far
        for k, node in enumerate(nodes):
            if k not in best and plainly_clear(polygons, nodes[here], node):
                heapq.heappush(queue, (so_far + math.dist(nodes[here], node), k))
    return math.inf


@pytest.mark.parametrize("seed", range(6))
def test_free_and_clear_are_what_the_even_odd_rule_says(seed):
    polygons, rng = scene(seed)
    obstacles = Obstacles(polygons)
    places = rng.uniform(-1.0, 11.0, (300, 2))
    expected = [not any(inside(q, *p) for q in polygons) for p in places]
    assert np.array_equal(obstacles.free(places), expected)
    clear = obstacles.clear(places[::2], places[1::2])
    pairs = zip(places[::2], places[1::2], strict=True)
    assert np.array_equal(clear, [plainly_clear(polygons, *pair) for pair in pairs])
    assert 20 < clear.sum() < 140


@pytest.mark.parametrize("seed", range(6))
def test_shortest_ways_are_those_of_the_graph_of_all_corners(seed):
    polygons, rng = scene(seed, count=4, field=6.0)
    obstacles = Obstacles(polygons)
    places = rng.uniform(-1.0, 7.0, (40, 2))
    places = places[obstacles.free(places)][:12]
    bent = 0
    for a, b in zip(places[::2], places[1::2], strict=False):
        way = obstacles.shortest_path(a, b)
        assert way.length_m == pytest.approx(plain_length(polygons, a, b), rel=1e-7)
        assert way.found == math.isfinite(way.length_m)
        if way.found:
            assert obstacles.clear(way.places[:-1], way.places[1:]).all()
            steps = np.linalg.norm(np.diff(way.places, axis=0), axis=1)
            assert steps.sum() == pytest.approx(way.length_m)
            bent += len(way.places) > 2
    assert bent


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.floats(0.05, 0.8))
def test_a_margin_keeps_its_distance_and_not_much_more(seed, margin):
    rng = np.random.default_rng(seed)
    polygon = star(rng, np.zeros(2), 2.0)
    bare, wide = Obstacles([polygon]), Obstacles([polygon], margin_m=margin)
    places = rng.uniform(-4.0, 4.0, (200, 2))
    away = bare.distance(places)
    free = wide.free(places)
    assert (away[free] >= margin * (1.0 - 1e-6)).all()
    assert free[away > 1.09 * margin].all()
    assert (np.abs(wide.distance(places) - (away - margin))[free] < 0.09 * margin + 1e-9).all()


def test_distance_and_nearest_free_of_a_square():
    obstacles = Obstacles([SQUARE])
    assert_allclose(
        obstacles.distance([[3, 1], [3, 3], [1, 1], [1, -2.0]]), [1, math.sqrt(2), 0, 2]
    )
    assert_allclose(obstacles.nearest_free([1.5, 1.2]), [2.0, 1.2])
    assert_allclose(obstacles.nearest_free([3.0, 1.2]), [3.0, 1.2])
    two = Obstacles([SQUARE, SQUARE + np.array([1.0, 0.5])])  # the way out may be where they cross
    assert_allclose(two.nearest_free([1.05, 1.9]), [1.0, 2.0])
    assert two.free(two.nearest_free([1.5, 1.0]))


def test_ways_lead_around_corners_of_the_outside_only():
    hook = Obstacles([HOOK])
    assert {tuple(c) for c in hook.corners} == {(0, 0), (5, 0), (5, 4), (0, 4), (0, 3), (0, 1)}
    way = hook.shortest_path([3.5, 2.0], [6.0, 2.0])
    over = math.hypot(3.5, 1.0) + 1.0 + 5.0 + math.hypot(1.0, 2.0)
    assert way.length_m == pytest.approx(over)
    assert not hook.clear([3.5, 2.0], [6.0, 2.0])
    along = hook.shortest_path([0.0, 4.0], [5.0, 4.0])  # a border may be walked
    assert along.length_m == pytest.approx(5.0)


def test_no_way_is_said():
    ring = [HOOK, np.array([[-1, -1], [0, -1], [0, 5], [-1, 5.0]])]  # the pocket, closed
    closed = Obstacles(ring)
    for a, b in (([2, 2], [8, 8]), ([8, 8], [2, 2]), ([4.5, 2], [8, 8]), ([8, 8], [4.5, 2])):
        way = closed.shortest_path(a, b)
        assert not way.found
        assert way.length_m == math.inf
        assert_allclose(way.places, [a])
    assert closed.shortest_path([1, 2], [3, 2]).length_m == pytest.approx(2.0)


def test_no_segment_slips_between_the_parts_of_a_polygon():
    """The cuts of a polygon into convex parts are no way through it."""
    for polygon in (HOOK, *scene(3, count=20)[0]):
        obstacles = Obstacles([polygon])
        for part in obstacles.parts:
            after = np.roll(part.corners, -1, axis=0)
            for inner, a, b in zip(part.inner, part.corners, after, strict=True):
                assert obstacles.clear(a, b) != inner
                assert not (inner and obstacles.free((a + b) / 2))


def test_parts_cover_the_polygon_once():
    for polygon in (HOOK, HOOK[::-1], np.vstack([SQUARE, SQUARE[:1]]), *scene(4, count=20)[0]):
        x, y = polygon.T
        whole = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
        area = 0.0
        for corners, _ in parts_of(polygon):
            u, v = corners.T
            area += np.sum(u * np.roll(v, -1) - v * np.roll(u, -1)) / 2
            edges = np.roll(corners, -1, axis=0) - corners
            turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
            assert (turns >= -1e-12).all()
        assert area == pytest.approx(whole)
    assert len(parts_of(SQUARE)) == 1
    assert len(grown(parts_of(SQUARE)[0], 0.5).corners) == 8


def test_a_free_plane_hides_nothing():
    nothing = Obstacles()
    assert nothing.free([[0, 0], [1, 1.0]]).all()
    assert nothing.clear([0, 0], [[1, 1.0], [2, 2.0]]).all()
    assert nothing.distance([1.0, 2.0]) == math.inf
    assert nothing.shortest_path([0, 0], [3, 4.0]).length_m == 5.0
    assert_allclose(nothing.nearest_free([1.0, 2.0]), [1.0, 2.0])


@pytest.mark.parametrize(
    ("polygon", "word"),
    [
        (SQUARE[:2], "m >= 3"),
        (np.zeros((4, 3)), "m >= 3"),
        ([[0, 0], [1, math.nan], [1, 1]], "finite"),
        ([[0, 0], [1, 1], [2, 2]], "area"),
        ([[0, 0], [2, 2], [2, 0], [0, 1.0]], "cross"),
    ],
)
def test_polygons_that_are_none_are_refused(polygon, word):
    with pytest.raises(InputError, match=word):
        Obstacles([polygon])


@pytest.mark.parametrize("margin", [-1.0, math.inf, math.nan])
def test_margins_that_are_none_are_refused(margin):
    with pytest.raises(InputError, match="margin_m"):
        Obstacles([SQUARE], margin_m=margin)


@pytest.mark.speed
def test_a_way_among_twenty_polygons_takes_less_than_a_millisecond():
    rng = np.random.default_rng(0)
    obstacles = Obstacles([star(rng, rng.uniform(0, 20, 2), 1.5) for _ in range(20)], margin_m=0.2)
    places = rng.uniform(0, 20, (60, 2))
    places = places[obstacles.free(places)][:40]
    seconds = []
    for _ in range(3):
        start = time.process_time()
        for a, b in zip(places[::2], places[1::2], strict=True):
            obstacles.shortest_path(a, b)
        seconds.append((time.process_time() - start) / 20)
    assert min(seconds) < 1.5e-3
