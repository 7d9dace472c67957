"""The shortest way among obstacles into a disc: Pham's rule (4.11) where the plane is not free."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.robot.obstacles import Obstacles, Way
from trackfield.types import Matrix, Vector

_INWARDS = 1e-12  # of the radius: an entry is in the disc, rounded or not


def way_into_disc(obstacles: Obstacles, start: Vector, centre: Vector, *, radius_m: float) -> Way:
    """Find the shortest way from `start` (2,) to the nearest reachable place of a disc, [m].

    Its last leg leads from the start or a corner straight at the centre, or to a place where the
    circle meets an obstacle; `found` is false where no place of the disc can be reached. A start in
    the disc stays.
    """
    start, centre = np.asarray(start, np.float64), np.asarray(centre, np.float64)
    if not obstacles.free(start):
        return Way(start[None], math.inf, found=False)
    if math.dist(start, centre) <= radius_m:
        return Way(start[None], 0.0, found=True)
    to_corners, first = obstacles.ways_from(start)
    hubs = _Hubs(np.vstack([start, obstacles.corners]), np.append(0.0, to_corners))
    straight = _straight_in(obstacles, hubs, centre, radius_m)
    aside = _on_the_circle(obstacles, hubs, centre, radius_m, straight.length_m)
    best = min(straight, aside, key=lambda entry: entry.length_m)
    if not math.isfinite(best.length_m):
        return Way(start[None], math.inf, found=False)
    if best.hub == 0:
        return Way(np.stack([start, best.place]), best.length_m, found=True)
    corner = best.hub - 1
    turns = obstacles.between(int(first[corner]), corner)
    return Way(np.vstack([start, turns, best.place]), best.length_m, found=True)


class _Hubs(NamedTuple):
    """The start and all corners, `places` (n, 2), and the length (n,) of the way to each."""

    places: Matrix
    length_m: Vector


class _Entry(NamedTuple):
    """Where a way enters the disc, its length, and the hub that it comes from."""

    place: Vector
    length_m: float
    hub: int


def _straight_in(obstacles: Obstacles, hubs: _Hubs, centre: Vector, radius: float) -> _Entry:
    """Find the hub from which the straight way to the circle is clear and shortest in all.

    In the order of their lengths the first one that is clear is the best.
    """
    offset = hubs.places - centre
    away = np.linalg.norm(offset, axis=1)
    total = np.where(away > radius, hubs.length_m + away - radius, np.inf)
    order = np.argsort(total)
    order = order[np.isfinite(total[order])]
    entries = centre + offset[order] * (radius * (1.0 - _INWARDS) / away[order])[:, None]
    open_ = obstacles.clear(hubs.places[order], entries) & obstacles.free(entries)
    if not open_.any():
        return _Entry(centre, math.inf, 0)
    best = int(np.argmax(open_))
    return _Entry(entries[best], float(total[order[best]]), int(order[best]))


def _on_the_circle(
    obstacles: Obstacles, hubs: _Hubs, centre: Vector, radius: float, limit: float
) -> _Entry:
    """Find the nearest of the places where the circle meets a border, if nearer than `limit`."""
    places = _crossings(obstacles, centre, radius)
    places = places[obstacles.free(places)]
    if not len(places):
        return _Entry(centre, math.inf, 0)
    total = hubs.length_m[:, None] + np.linalg.norm(hubs.places[:, None] - places, axis=-1)
    hub, place = np.nonzero(total < limit)
    order = np.argsort(total[hub, place])
    hub, place = hub[order], place[order]
    open_ = obstacles.clear(hubs.places[hub], places[place])
    if not open_.any():
        return _Entry(centre, math.inf, 0)
    best = int(np.argmax(open_))
    nearest = float(total[hub[best], place[best]])
    return _Entry(places[place[best]], nearest, int(hub[best]))


def _crossings(obstacles: Obstacles, centre: Vector, radius: float) -> Matrix:
    """Where edges of obstacles meet the circle, (k, 2) [m]."""
    if not obstacles.parts:
        return np.empty((0, 2))
    starts, ends = obstacles.edges()
    along, offset = ends - starts, starts - centre
    a = np.square(along).sum(axis=1)
    b = (along * offset).sum(axis=1)
    inner = radius * (1.0 - _INWARDS)
    square = b**2 - a * (np.square(offset).sum(axis=1) - inner**2)
    met = square >= 0.0
    root = np.sqrt(np.where(met, square, 0.0))
    shares = np.stack([(-b - root) / a, (-b + root) / a])
    which, edge = np.nonzero(met & (shares >= 0.0) & (shares <= 1.0))
    return starts[edge] + shares[which, edge][:, None] * along[edge]
