"""Ways around obstacles for pursuers that meet evaders: whom to go for first, and how much later.

Each goes for the first corner of the shortest way to where it would meet its evader, at a speed
from which it can still turn.
"""

from __future__ import annotations

import math

import numpy as np

from trackfield.robot.obstacles import Obstacles
from trackfield.types import Matrix, Vector

_NEAR = 0.25  # of a way: how much nearer than the corner behind counts as being there


def delayed(times: Matrix, places: Matrix, evaders: Matrix, obstacles: Obstacles) -> Matrix:
    """Lengthen times to capture (p, e) [s] by the way around, from `places` (p, 2).

    As the way to the meeting place is longer than the straight line, so is the time; a place that
    cannot be reached is never. Places inside an obstacle stand for the nearest free ones.
    """
    if not obstacles.parts or not times.size:
        return times
    meeting = evaders[:, :2] + np.where(np.isfinite(times), times, 0.0)[..., None] * evaders[:, 2:]
    starts = np.broadcast_to(places[:, None], meeting.shape)
    blocked = np.isfinite(times) & ~(obstacles.clear(starts, meeting) & obstacles.free(meeting))
    found = times.copy()
    freed = [obstacles.nearest_free(place) for place in places]
    for i, j in np.argwhere(blocked).tolist():
        way = obstacles.shortest_path(freed[i], obstacles.nearest_free(meeting[i, j]))
        straight = math.dist(places[i], meeting[i, j])
        if not way.found:
            found[i, j] = math.inf
        elif straight > 0.0:
            found[i, j] *= max(1.0, way.length_m / straight)
    return found


def leg(place: Vector, evader: Vector, time_s: float, obstacles: Obstacles, pace: float) -> Vector:
    """State (4,) to go for: the evader (4,) itself where the way to the meeting is clear.

    Else the first corner of the way, with the velocity along the next leg from which thrust `pace`
    [m/s^2] can stop within that leg; where there is no way, the own place.
    """
    meeting = evader[:2] + time_s * evader[2:]
    if obstacles.clear(place, meeting) and obstacles.free(meeting):
        return evader
    start, end = obstacles.nearest_free(place), obstacles.nearest_free(meeting)
    way = obstacles.shortest_path(start, end)
    if not way.found:
        return np.array([*start, 0.0, 0.0])
    corners = list(way.places[1:])
    if not np.allclose(start, place):
        corners.insert(0, start)
    while len(corners) > 1 and math.dist(place, corners[0]) < _NEAR:
        corners.pop(0)
    if len(corners) == 1:
        return np.array([*corners[0], 0.0, 0.0])
    along = corners[1] - corners[0]
    length = math.hypot(*along)
    speed = math.sqrt(pace * length) if length > 0.0 else 0.0
    return np.array([*corners[0], *(along / max(length, 1e-12) * speed)])
