"""Where to look for a target that was missed: wider and wider, until it is found or must be gone.

A missed target is looked for step by step, each time where it can be by then. When that is the
whole field and nobody is found, it has left (or stands in a hole), and the border is watched again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.boxes import Box, box_of
from trackfield.network.node_index import Near, NodeIndex, each_reach
from trackfield.raster import Region
from trackfield.scheduling.ellipsoids import (
    distance_to_ellipsoid,
    ellipsoid_gate,
    ellipsoid_reach,
)
from trackfield.types import Indices, Matrix, Vector

_SLACK = 1e-9  # of a reach: what is just within it is, rounded or not


class Search(NamedTuple):
    """Pairs (m,) of a missed track and a node that looks for it, in order of tracks.

    `whole` (t,): it may be anywhere in the field, so that this look is the last one; `gone` (t,):
    it has left the field, for certain or with the probability asked for, and nobody looks.
    """

    track: Indices
    node: Indices
    whole: NDArray[np.bool_]
    gone: NDArray[np.bool_]


def search_reachable(
    nodes: NodeIndex,
    last_seen: Matrix,
    *,
    elapsed_s: Vector,
    max_speed_m_s: float,
    reach_m: float | Vector,
    field: Region | Box,
) -> Search:
    """Nodes within reach of the ball |x - last_seen| <= v_max elapsed, in the field.

    Targets were `last_seen` (t, d) [m], `elapsed_s` (t,) ago. However a target has moved since, it
    is in its ball if it is never faster than `max_speed_m_s`. Whoever does not know the place well
    adds the error's bound over v_max to the time.
    """
    elapsed = np.asarray(elapsed_s, np.float64)
    if max_speed_m_s < 0.0 or not (elapsed >= 0.0).all():
        raise InputError("found a negative speed or time since, expected 0 or more")
    box, radius = box_of(field), max_speed_m_s * elapsed
    reach = each_reach(nodes, reach_m)
    near = nodes.within(last_seen, radius + float(reach.max()))
    apart = np.linalg.norm(near.offset, axis=1) - radius[near.place]
    near = _close(near, apart, reach)
    corners = np.linalg.norm(box.corners() - last_seen[:, None], axis=-1)
    whole = np.asarray(corners.max(axis=1) <= radius)
    return _search(
        nodes,
        near,
        whole=whole,
        gone=np.asarray(box.outside(last_seen) > radius),
        seen=(box, reach),
    )


def search_believed(
    nodes: NodeIndex,
    means: Matrix,
    *,
    covariances: Matrix,
    probability: float,
    reach_m: float | Vector,
    field: Region | Box,
) -> Search:
    """Nodes within reach of the ellipsoid that holds a target with `probability`, in the field.

    `means` (t, d) [m] and `covariances` (t, d, d) [m^2] are of positions predicted to now, which
    widen while nobody updates them.
    """
    d, box = nodes.dimensions, box_of(field)
    if covariances.shape != (*means.shape, d):
        raise InputError(
            f"covariances of shape {covariances.shape} for positions of shape {means.shape}, "
            f"expected (t, {d}, {d})"
        )
    limit = ellipsoid_gate(covariances, probability)
    reach = each_reach(nodes, reach_m)
    around = nodes.within(means, float(reach.max()) + ellipsoid_reach(covariances, limit))
    apart = distance_to_ellipsoid(around.offset, covariances, limit, which=around.place)
    near = _close(around, apart, reach)
    corners = box.corners() - means[:, None]
    track = np.repeat(np.arange(len(means)), corners.shape[1])
    off = distance_to_ellipsoid(corners.reshape(-1, d), covariances, limit, which=track)
    half = np.sqrt(limit * np.diagonal(covariances, axis1=-2, axis2=-1))
    missed = (means + half < box.low) | (means - half > box.high)
    whole = np.asarray((off.reshape(len(means), -1) == 0.0).all(axis=1))
    return _search(nodes, near, whole=whole, gone=np.asarray(missed.any(axis=1)), seen=(box, reach))


def _close(near: Near, apart: Vector, reach: Vector) -> Near:
    """Keep the pairs whose node reaches what is `apart` (m,) [m] from it."""
    kept = apart <= reach[near.node] * (1.0 + _SLACK)
    return Near(near.place[kept], near.node[kept], near.offset[kept])


def _search(
    nodes: NodeIndex,
    near: Near,
    *,
    whole: NDArray[np.bool_],
    gone: NDArray[np.bool_],
    seen: tuple[Box, Vector],
) -> Search:
    """Keep the pairs whose node sees a part of the field, of tracks that can be in it."""
    box, reach = seen
    useful = box.outside(nodes.positions) <= reach
    kept = useful[near.node] & ~gone[near.place]
    return Search(near.place[kept], near.node[kept], whole, gone)
