"""Maps of a robot and its target: everything that is told is drawn."""

from __future__ import annotations

import numpy as np
from matplotlib.patches import Circle, Polygon

from robot_tracks import sinusoid
from trackfield.plotting.robots import Chase, plot_chase


def test_ways_discs_nodes_obstacles_and_losses_are_drawn():
    track = sinusoid(40)
    robot, square = 0.5 * track, np.array([[1, 1], [2, 1], [2, 2], [1, 2.0]])
    chase = Chase(track, robot, 0.6, {"rule": 0.7 * track}, track + 1.0, [square], (3, 4))
    axes = plot_chase(chase, title="A chase").axes[0]
    drawn = {line.get_label(): line.get_xydata() for line in axes.lines}
    assert np.array_equal(drawn["target"], track)
    assert np.array_equal(drawn["robot"], robot)
    assert np.array_equal(drawn["rule"], 0.7 * track)
    assert np.array_equal(drawn["nodes"], track + 1.0)
    assert np.array_equal(drawn["hop lost"], robot[[3, 4]])
    circles = [patch for patch in axes.patches if isinstance(patch, Circle)]
    assert {circle.radius for circle in circles} == {0.6}
    assert circles[-1].center == tuple(track[-1])
    polygons = [patch for patch in axes.patches if isinstance(patch, Polygon)]
    assert np.array_equal(polygons[0].get_xy()[:4], square)
    assert axes.get_title() == "A chase"


def test_a_bare_chase_is_two_ways():
    axes = plot_chase(Chase(sinusoid(9), sinusoid(9))).axes[0]
    assert not axes.patches
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {"target", "robot"}
