"""Which nodes are awake around targets: Pham's region R, and those that a target will come to."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.motion import Motion
from trackfield.network.node_index import NodeIndex, each_reach
from trackfield.scheduling.ellipsoids import (
    distance_to_ellipsoid,
    ellipsoid_gate,
    ellipsoid_reach,
)
from trackfield.types import Indices, Matrix, Vector

_SLACK = 1e-9  # of a radius or an angle [rad]: the region is closed, rounded or not


class Zone(NamedTuple):
    """Region R around a target: a ball, and a cone about its heading that reaches farther.

    Pham, figure 2.1: R_1, R_2 >= R_1, and alpha from 0 to pi; in the plane a disc and a sector.
    """

    near_m: float
    far_m: float
    half_angle_rad: float


class Activated(NamedTuple):
    """Pairs (m,) of a track and a node of its region, in order of tracks; `near` in the ball."""

    track: Indices
    node: Indices
    near: NDArray[np.bool_]


class Ahead(NamedTuple):
    """Pairs (m,) of a track and a node that it may come to, and the first `step` (m,) that does.

    In order of tracks, the nodes of a track in their own order; steps are counted from 1.
    """

    track: Indices
    node: Indices
    step: Indices


def activate(nodes: NodeIndex, positions: Matrix, *, headings: Matrix, zone: Zone) -> Activated:
    """Nodes p of R = {|p - o| <= near} or {|p - o| <= far, angle(p - o, heading) <= half angle}.

    Targets at `positions` (t, d) [m] move along `headings` (t, d) of any length, as velocities are.
    A target without a heading (zero) may leave any way: its cone is the whole ball. The borders
    belong to the region. Pham 2.2.2.
    """
    _check(zone)
    if headings.shape != positions.shape or not np.isfinite(headings).all():
        raise InputError(
            f"headings of shape {headings.shape} for positions of shape {positions.shape}, "
            "expected finite ones, one a position"
        )
    near = nodes.within(positions, zone.far_m)
    distance = np.linalg.norm(near.offset, axis=1)
    inner = distance <= zone.near_m * (1.0 + _SLACK)
    inside = inner | (_off_axis(near.offset, headings[near.place]) <= zone.half_angle_rad + _SLACK)
    return Activated(near.place[inside], near.node[inside], inner[inside])


def wake_ahead(
    nodes: NodeIndex,
    means: Matrix,
    *,
    covariances: Matrix,
    motion: Motion,
    steps_s: Vector,
    reach_m: float | Vector,
    probability: float = 0.95,
) -> Ahead:
    """Nodes that will be within reach of a target, with `probability`, in one of some steps.

    `reach_m` is one number or (n,), that of each node. States `means` (t, n) with `covariances`
    (t, n, n) begin with the position; each is predicted to the times `steps_s` (h,) [s] from now.
    A node is woken for the first step at which it is within reach of the ellipsoid that holds the
    target with `probability`: at each step the target is within reach of nodes that sleep with at
    most the rest.
    """
    d = nodes.dimensions
    centres, spreads = _predicted(means, covariances, motion, steps_s, d)
    limit = ellipsoid_gate(spreads, probability)
    reach = each_reach(nodes, reach_m)
    widest = float(reach.max()) + ellipsoid_reach(spreads, limit).reshape(-1)
    near = nodes.within(centres.reshape(-1, d), widest)
    apart = distance_to_ellipsoid(near.offset, spreads.reshape(-1, d, d), limit, which=near.place)
    found = apart <= reach[near.node] * (1.0 + _SLACK)
    step, track = np.divmod(near.place[found], len(means))
    return _first_steps(track, near.node[found], step, len(nodes))


def _first_steps(track: Indices, node: Indices, step: Indices, count: int) -> Ahead:
    """Each pair of a track and a node once, with the least of its steps, which come in order."""
    pair = track.astype(np.int64) * count + node
    _, first = np.unique(pair, return_index=True)
    return Ahead(track[first], node[first], step[first] + 1)


def _predicted(
    means: Matrix, covariances: Matrix, motion: Motion, steps_s: Vector, d: int
) -> tuple[Matrix, Matrix]:
    """Positions (h, t, d) and their covariances (h, t, d, d) at the times of steps."""
    n = motion.transition(0.0).shape[0]
    if means.ndim != 2 or means.shape[1] != n or covariances.shape != (len(means), n, n) or n < d:
        raise InputError(
            f"states of shape {means.shape} with covariances of shape {covariances.shape}, "
            f"expected (t, {n}) and (t, {n}, {n}) as the motion has, with at least {d} entries"
        )
    centres = np.empty((len(steps_s), len(means), d))
    spreads = np.empty((len(steps_s), len(means), d, d))
    for k, dt_s in enumerate(steps_s):
        F = motion.transition(float(dt_s))[:d]
        centres[k] = means @ F.T
        spreads[k] = F @ covariances @ F.T + motion.noise(float(dt_s))[:d, :d]
    return centres, spreads


def _off_axis(offsets: Matrix, headings: Matrix) -> Vector:
    """Angle (m,) [rad] between offsets (m, d) and headings (m, d); 0 where there is no heading."""
    speed = np.linalg.norm(headings, axis=1)
    axis = headings / np.where(speed > 0.0, speed, 1.0)[:, None]
    along = np.einsum("md,md->m", offsets, axis)
    across = np.linalg.norm(offsets - along[:, None] * axis, axis=1)
    return np.where(speed > 0.0, np.arctan2(across, along), 0.0)


def _check(zone: Zone) -> None:
    if not (0.0 <= zone.near_m <= zone.far_m < math.inf):
        raise InputError(
            f"zone: found near_m {zone.near_m:g} and far_m {zone.far_m:g}, "
            "expected 0 <= near_m <= far_m"
        )
    if not 0.0 <= zone.half_angle_rad <= math.pi:
        raise InputError(
            f"zone: found half_angle_rad {zone.half_angle_rad:g}, expected an angle from 0 to pi"
        )
