"""Ways into a disc among obstacles: no way to any place of the disc is shorter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from test_robot_obstacles import HOOK, SQUARE, scene
from trackfield.robot.obstacle_discs import way_into_disc
from trackfield.robot.obstacles import Obstacles
from trackfield.robot.rule import least_move


def test_in_a_free_plane_it_is_the_rule():
    rng = np.random.default_rng(0)
    for start, centre in rng.normal(size=(30, 2, 2)):
        way = way_into_disc(Obstacles(), start, centre, radius_m=0.7)
        assert_allclose(way.places[-1], least_move(start, centre, reach_m=0.7), atol=1e-11)
        assert way.length_m == pytest.approx(math.dist(start, way.places[-1]), abs=1e-11)


@pytest.mark.parametrize("seed", range(5))
def test_no_place_of_the_disc_is_nearer(seed):
    polygons, rng = scene(seed, count=5, field=6.0)
    obstacles = Obstacles(polygons, margin_m=0.1)
    places = rng.uniform(-1.0, 7.0, (200, 2))
    places = places[obstacles.free(places)]
    bent = 0
    for start, centre in zip(places[:16:2], rng.uniform(0.0, 6.0, (8, 2)), strict=False):
        radius = rng.uniform(0.3, 1.5)
        way = way_into_disc(obstacles, start, centre, radius_m=radius)
        angle = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
        circle = centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        if math.dist(start, centre) <= radius:
            assert way.length_m == 0.0
            continue
        lengths = [obstacles.shortest_path(start, place).length_m for place in circle]
        assert way.length_m <= min(lengths) + 1e-9
        assert way.length_m >= min(lengths) - 2 * np.pi * radius / 400
        assert math.dist(way.places[-1], centre) <= radius
        assert obstacles.free(way.places[-1])
        assert obstacles.clear(way.places[:-1], way.places[1:]).all()
        steps = np.linalg.norm(np.diff(way.places, axis=0), axis=1)
        assert steps.sum() == pytest.approx(way.length_m)
        bent += len(way.places) > 2
    assert bent


def test_a_disc_that_cannot_be_reached_is_said():
    inside = way_into_disc(Obstacles([SQUARE]), np.array([5.0, 1]), np.ones(2), radius_m=0.5)
    assert not inside.found
    assert inside.length_m == math.inf
    closed = Obstacles([HOOK, [[-1, -1], [0, -1], [0, 5], [-1, 5]]])
    assert not way_into_disc(closed, np.full(2, 8.0), np.array([2, 2.0]), radius_m=0.5).found
    assert not way_into_disc(closed, np.array([2, 2.0]), np.full(2, 8.0), radius_m=0.5).found
    assert not way_into_disc(closed, np.array([4.5, 2]), np.full(2, 8.0), radius_m=0.5).found


def test_a_disc_behind_a_wall_is_entered_beside_it():
    """The straight entry is covered by the wall: the circle is met where the wall ends."""
    wall = Obstacles([[[1.0, -3.0], [1.2, -3.0], [1.2, 0.5], [1.0, 0.5]]])
    way = way_into_disc(wall, np.zeros(2), np.array([1.9, 0.0]), radius_m=0.8)
    corner = np.array([1.2, 0.5])
    offset = corner - [1.9, 0.0]
    over = math.hypot(1.0, 0.5) + 0.2 + np.linalg.norm(offset) - 0.8
    assert way.length_m == pytest.approx(over)
