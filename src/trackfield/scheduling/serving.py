"""Which sensors sense one target in the next interval, by the policy of the site."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.localization.information import MixedModels, mixed, reading_gains, taken
from trackfield.network.kinds import SensorModel
from trackfield.network.node_index import NodeIndex
from trackfield.network.site import PolicyName, SchedulingSettings
from trackfield.scheduling.cheapest import MOST, cheapest
from trackfield.scheduling.selection import select
from trackfield.scheduling.soft_bound import Care
from trackfield.sensing.detection import DetectionColumns, DetectionModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.range_outlook import Outlook, nearness, outlook
from trackfield.types import Gaussian, Indices, Matrix, Vector

CANDIDATES = 24
"""Nodes that are compared for a target: the nearest ones, of which all sets of three are tried."""

_CARE = Care()
_USUAL_BOUND = 3.0  # of the trace, in variances of a reading
_IN_LINE = 1e-6  # determinant over squared trace of the information of readings in one line
_EXACT = RangeModel(sigma_m=0.0)


class Sensors(NamedTuple):
    """All nodes of a field: where they stand, what they say, how far they reach (n,) [m].

    `binary` ones (n,) say yes or no; `farthest_m` is the longest reach; `own_m2` how much of the
    plane there is to a node.
    """

    nodes: NodeIndex
    models: MixedModels
    reach_m: Vector
    binary: NDArray[np.bool_]
    farthest_m: float
    own_m2: float


class Able(NamedTuple):
    """Who may be told to sense, (n,) each.

    Only who is `alive`; rather those that are `ready`, for they are awake; `taken` ones sense for
    another target anyway; `residual` is the share of its energy that each has left, in [0, 1]: who
    has little is spared, the more the greater the exponent `sparing`.
    """

    alive: NDArray[np.bool_]
    ready: NDArray[np.bool_]
    taken: NDArray[np.bool_]
    residual: Vector
    sparing: float = 1.0

    def weight(self, nodes: Indices) -> Vector:
        """Weights (m,) of nodes, above 0, less for those that are to be spared."""
        return np.maximum(self.residual[nodes] ** self.sparing, 1e-6)


class Choice(NamedTuple):
    """Who senses a target: `sensors` (k,), those of other targets that hear it included.

    `trace_m2` is the trace of its position's covariance when they have; `late` of them sleep until
    then; `radius_m` is how far the nodes stand that would do if they were awake. `trouble` says
    what is not as it was asked for, and what is the best that could be had.
    """

    sensors: Indices
    trace_m2: float
    late: int
    radius_m: float
    trouble: tuple[str, ...]


class _Near(NamedTuple):
    """Nodes in range of a target, in the order in which they are asked: columns (m,).

    `gains` (m, 2) of their readings, `distance` [m]; `clear` ones are not so near that they cannot
    tell on which side of them it is.
    """

    node: Indices
    distance: Vector
    gains: Matrix
    clear: NDArray[np.bool_]


class _Asked(NamedTuple):
    """How many sensors, or which trace, were asked for, and within which radius they would be."""

    sensors: int
    bound_m2: float | None
    radius_m: float


def sensors_of(positions: Matrix, models: Sequence[SensorModel], reach_m: Vector) -> Sensors:
    """Lay out nodes at `positions` (n, 2) [m]; who has no limit reaches twice across the field."""
    nodes, size = NodeIndex(positions), np.ptp(positions, axis=0)
    across = max(2.0 * float(np.hypot(*size)), 1.0)
    reach = np.where(np.isfinite(reach_m), reach_m, across)
    own_m2 = max(float(size.prod()), 1e-6 * across**2) / len(nodes)
    binary = np.array([isinstance(model, DetectionModel) for model in models], np.bool_)
    return Sensors(nodes, mixed(models), reach, binary, float(reach.max()), own_m2)


def choose(
    sensors: Sensors,
    target: Gaussian,
    *,
    settings: SchedulingSettings,
    able: Able,
    wanted: int,
) -> Choice:
    """Choose up to `wanted` sensors for a target believed at N(mean (2,), covariance (2, 2)).

    A node is in range if it reaches two standard deviations farther than the target is: at the edge
    of a reach the target may be out of it. Of binary sensors those count whose edge may be there,
    for only on its edge a yes or no tells the place. Nodes that sense another target anyway cost
    nothing and come first; others are taken of those that are awake, if they are enough.
    """
    prior = np.asarray(np.linalg.inv(target.covariance), np.float64)
    if settings.policy == "all":
        near = _in_range(sensors, target, able=able, enough=len(able.alive), sure=False)
        asked = _Asked(1, None, float(near.distance.max(initial=0.0)))
        return _judged(near.node, near.gains, prior=prior, able=able, asked=asked)
    near = _in_range(sensors, target, able=able, enough=max(CANDIDATES, 2 * wanted))
    given = able.taken[near.node]
    pool = _pool(near, able, max(wanted - int(given.sum()), 0))
    bound = _bound(settings, near.gains)
    rows = _picked(
        near.gains[pool],
        able.weight(near.node[pool]),
        max(wanted - int(given.sum()), 0),
        prior=prior + near.gains[given].T @ near.gains[given],
        policy=settings.policy,
        bound=bound,
    )
    chosen = np.concatenate([np.flatnonzero(given), pool[rows]])
    usable = near.distance[near.clear] if near.clear.any() else near.distance
    radius = float(np.sort(usable)[: wanted + 1].max(initial=0.0))
    return _judged(
        near.node[chosen],
        near.gains[chosen],
        prior=prior,
        able=able,
        asked=_Asked(wanted, bound, radius),
    )


def _in_range(
    sensors: Sensors, target: Gaussian, *, able: Able, enough: int, sure: bool = True
) -> _Near:
    """Nodes that live and reach a target, for `sure`; the nearest first, spared ones as if farther.

    Where a field is dense, they are looked up in a disc that should hold `enough` of them.
    """
    farthest = sensors.farthest_m
    spread = math.sqrt(float(np.trace(target.covariance)))
    first = math.sqrt(2.0 * enough * sensors.own_m2 / math.pi) + _CARE.near_sigmas * spread
    found = _Near(np.empty(0, np.int32), np.empty(0), np.empty((0, 2)), np.empty(0, np.bool_))
    for radius in (first, farthest) if first < farthest else (farthest,):
        node = sensors.nodes.within(target.mean[None], radius).node
        node = node[able.alive[node]]
        seen = outlook(_EXACT, sensors.nodes.positions[node], position=target)
        reach, doubt = sensors.reach_m[node], _CARE.edge_sigmas * seen.along
        margin = np.minimum(np.where(sensors.binary[node], -doubt, doubt), reach / 2.0)
        here = seen.distance <= reach - margin * sure
        gains = _gains(sensors, node, target, seen)
        clear = (nearness(seen) >= _CARE.near_sigmas) | sensors.binary[node]
        found = _Near(node[here], seen.distance[here], gains[here], clear[here])
        if np.count_nonzero(found.clear) >= enough:
            break
    order = np.argsort(found.distance / np.sqrt(able.weight(found.node)), kind="stable")
    node, distance, gains, clear = found
    return _Near(node[order], distance[order], gains[order], clear[order])


def _gains(sensors: Sensors, nodes: Indices, target: Gaussian, seen: Outlook) -> Matrix:
    """Gains (m, 2) of nodes, less where the doubt across the line of sight bends the readings.

    What bends a range is noise to a linear filter, `range_outlook`; other kinds are taken to bend
    alike. The edge of a binary sensor is as wide as the doubt about which side of it the target is.
    """
    models = taken(sensors.models, nodes)
    columns = list(models.columns)
    for number, own in enumerate(columns):
        if isinstance(own, DetectionColumns):
            here, edge = models.part == number, own.edge_m.copy()
            rows = models.row[here]
            edge[rows] = np.hypot(edge[rows], math.sqrt(12.0) * seen.along[here])
            columns[number] = own._replace(edge_m=edge)
    models = models._replace(columns=tuple(columns))
    gains = reading_gains(models, sensors.nodes.positions[nodes], target.mean)
    return gains / np.sqrt(1.0 + (gains**2).sum(axis=1) * seen.variance)[:, None]


def _pool(near: _Near, able: Able, missing: int) -> Indices:
    """Rows (m,) of nodes that are compared: awake and clear ones, if these are enough."""
    free = ~able.taken[near.node]
    for good in (able.ready[near.node] & near.clear, near.clear, np.ones_like(near.clear)):
        rows = np.flatnonzero(free & good)
        if rows.size >= missing:
            break
    return rows[: max(CANDIDATES, missing)].astype(np.int32)


def _bound(settings: SchedulingSettings, gains: Matrix) -> float | None:
    """Trace that "soft" keeps; three variances of the best reading if none is told."""
    if settings.policy != "soft":
        return None
    if settings.bound_m2 is not None:
        return settings.bound_m2
    best = float((gains**2).sum(axis=1).max(initial=0.0))
    return _USUAL_BOUND / best if best > 0.0 else math.inf


def _picked(
    gains: Matrix,
    weight: Vector,
    most: int,
    *,
    prior: Matrix,
    policy: PolicyName,
    bound: float | None,
) -> Indices:
    """Rows (k,) of gains, k <= `most`, that the policy takes; they stand in order of distance.

    Where no reading says anything by its slope, as in the middle of a detector's disc, the nearest.
    """
    count = min(most, len(gains))
    if count == 0:
        return np.empty(0, np.int32)
    if policy == "nearest" or not gains.any():
        return np.arange(count, dtype=np.int32)
    if bound is None:
        return select(gains * np.sqrt(weight)[:, None], count, prior=prior).sensors
    found = cheapest(
        prior,
        gains,
        weights=1.0 / weight,
        bound=_CARE.aim * bound,
        limits=(0, min(count, MOST)),
    )
    return found.sensors[found.sensors >= 0]


def _judged(nodes: Indices, gains: Matrix, *, prior: Matrix, able: Able, asked: _Asked) -> Choice:
    """Say what the chosen sensors leave, and how that is less than what was asked."""
    information = gains.T @ gains
    left = float(np.trace(np.linalg.inv(prior + information)))
    trouble: list[str] = []
    if asked.bound_m2 is not None:
        if left > asked.bound_m2:
            trouble.append(f"{left:.3g} m^2 is the best trace, {asked.bound_m2:.3g} were asked for")
    elif not nodes.size:
        trouble.append("no sensor is in range")
    elif nodes.size < asked.sensors:
        trouble.append(f"{nodes.size} sensors are in range, {asked.sensors} were asked for")
    whole, area = float(np.trace(information)), float(np.linalg.det(information))
    if nodes.size > 1 and whole > 0.0 and area <= _IN_LINE * whole**2:
        trouble.append("its sensors are in one line with it: across, only its motion is known")
    late = int((~able.ready[nodes]).sum())
    return Choice(nodes, left, late, asked.radius_m, tuple(trouble))
