"""Pham 2.5.2: a target crosses a field of 441 nodes; who measures, who is awake, what they find."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.filtering import extended, kalman
from trackfield.filtering.extended import Ranges
from trackfield.filtering.kalman import Linear
from trackfield.localization.trilateration import FLAT
from trackfield.motion import ConstantVelocity
from trackfield.network.node_index import NodeIndex
from trackfield.scheduling.activation import Zone, activate
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian, Matrix, Vector

SIDE_M = 10.0
NODES = 441
CYCLE_S = 1.0 / 200.0
DURATION_S = 10.0
NEEDED = 3  # readings for a position
STATE_SIGMA = 0.01  # of Pham's filter, a cycle

Heard = NDArray[np.bool_]


class Passage(NamedTuple):
    """A target's way: `t_s` (k,), `position` and `heading` (k, 2); one row a sampling cycle.

    `accel_density` [m^2/s^3] is how hard it turns, for filters that are told.
    """

    t_s: Vector
    position: Matrix
    heading: Matrix
    accel_density: float


class Hearing(NamedTuple):
    """Who measures in each cycle, the nearest first, padded to the most there are.

    `place` (k, m, 2) and `distance` (k, m) [m]; `heard` (k, m) is false for the padding.
    """

    place: Matrix
    distance: Matrix
    heard: Heard


class Fixes(NamedTuple):
    """Positions that trilateration makes of runs: `position` (r, k, 2), NaN where there is none.

    `covariance` (k, 2, 2) is the exact one of the true distances, Pham's Theta.
    """

    position: Matrix
    covariance: Matrix


def square() -> Matrix:
    """Nodes (441, 2) [m] on a square grid of .5 m over the field."""
    ticks = np.linspace(0.0, SIDE_M, 21)
    return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


def scattered(rng: np.random.Generator) -> Matrix:
    """Nodes (441, 2) [m] anywhere in the field."""
    return rng.uniform(0.0, SIDE_M, (NODES, 2))


def passage(mean_speed_m_s: float = 1.0) -> Passage:
    """x(t) = 5 - 5 cos(pi u t / 10), y = 5 at 200 Hz for 10 s; u is the mean speed [m/s].

    The text gives no x(t); with u = 1 this one has its ends and gives the counts of Table 2.1.
    """
    t_s = CYCLE_S * np.arange(round(DURATION_S / CYCLE_S), dtype=np.float64)
    phase = math.pi * mean_speed_m_s * t_s / SIDE_M
    half = SIDE_M / 2.0
    position = np.column_stack([half - half * np.cos(phase), np.full_like(t_s, half)])
    heading = np.column_stack([np.where(np.sin(phase) >= 0.0, 1.0, -1.0), np.zeros_like(t_s)])
    # Accelerations grow as u^2 and last as 1/u; .1 was chosen at u = 1 on noise not used here.
    return Passage(t_s, position, heading, 0.1 * mean_speed_m_s**3)


def beginning(way: Passage, cycles: int) -> Passage:
    """Take the first cycles of a passage."""
    return Passage(way.t_s[:cycles], way.position[:cycles], way.heading[:cycles], way.accel_density)


def distances(way: Passage, nodes: Matrix) -> Matrix:
    """Distance (k, n) [m] of every node (n, 2) in every cycle."""
    return np.hypot(*np.moveaxis(way.position[:, None] - nodes, -1, 0))


def awake(way: Passage, nodes: Matrix, zone: Zone) -> Heard:
    """Tell which nodes (k, n) are in Pham's region R of each cycle."""
    found = activate(NodeIndex(nodes), way.position, headings=way.heading, zone=zone)
    inside = np.zeros((len(way.t_s), len(nodes)), np.bool_)
    inside[found.track, found.node] = True
    return inside


def radius_for(distance: Matrix, mean_count: float) -> float:
    """Radius [m] within which `mean_count` nodes stand on average of distances (k, n)."""
    wanted = round(mean_count * len(distance))
    return float(np.partition(distance.ravel(), wanted - 1)[wanted - 1])


def hearing(way: Passage, nodes: Matrix, radius_m: float) -> Hearing:
    """Find the nodes (n, 2) within `radius_m` of the target in each cycle: they measure."""
    apart = distances(way, nodes)
    most = int((apart <= radius_m).sum(axis=1).max())
    order = np.argsort(apart, axis=1, kind="stable")[:, : max(most, 1)]
    distance = np.take_along_axis(apart, order, axis=1)
    return Hearing(nodes[order], distance, distance <= radius_m)


def measure(who: Hearing, *, sigma_m: float, runs: int, rng: np.random.Generator) -> Matrix:
    """Draw ranges (r, k, m) with errors N(0, sigma_m^2); NaN where nobody measures."""
    errors = sigma_m * rng.standard_normal((runs, *who.distance.shape))
    return np.where(who.heard, who.distance + errors, np.nan)


def trilaterate(who: Hearing, ranges: Matrix, *, sigma_m: float) -> Fixes:
    """Least squares over all pairs, Pham (2.5), of ranges (r, k, m), every cycle at once.

    Equals `localization.trilateration.ordinary` cycle by cycle; there is no position where fewer
    than three measure, or all stand on one line.
    """
    count = who.heard.sum(axis=1)
    weights = who.heard / np.maximum(count, 1)[:, None]
    middle = np.einsum("km,kmd->kd", weights, who.place)
    offset = np.where(who.heard[..., None], who.place - middle[:, None], 0.0)
    spread = np.einsum("kmd,kme->kde", offset, offset)
    roots = np.linalg.eigvalsh(spread)
    ok = ((count >= NEEDED) & (roots[:, 0] > FLAT * roots[:, 1]))[:, None]
    inverse = np.linalg.inv(np.where(ok[..., None], spread, np.eye(2)))
    slope = offset @ inverse  # (k, m, 2); it sums to nothing over who is heard
    half = 0.5 * (np.sum(offset**2, axis=-1) - np.where(who.heard, ranges, 0.0) ** 2)
    position = np.where(ok, middle + np.einsum("kmd,rkm->rkd", slope, half), np.nan)
    variance = who.distance**2 * sigma_m**2 + 0.5 * sigma_m**4
    covariance = np.einsum("kmd,km,kme->kde", slope, variance, slope)
    return Fixes(position, np.where(ok[..., None], covariance, np.eye(2)))


def along_x(
    fixes: Matrix,
    variance: Matrix,
    *,
    start: Gaussian,
    begins: Heard | None = None,
    state_sigma: float = STATE_SIGMA,
) -> Matrix:
    """Pham's filter (2.32): coordinates (..., k) [m] of a state [x, v] that fixes correct.

    `fixes` (..., k) [m], NaN where there is none, with `variance` (..., k) [m^2]. As printed,
    x_{k+1} = F x_k + w with w ~ N(0, s^2 I), s = `state_sigma`: an error a cycle in position [m]
    and velocity [m/s] both. In cycles of `begins` (k,) the filter begins anew from `start`, as a
    master does that is told nothing.
    """
    F = np.array([[1.0, CYCLE_S], [0.0, 1.0]])
    Q = state_sigma**2 * np.eye(2)
    H = np.array([[1.0, 0.0]])
    first = _of_runs(start, fixes.shape[:-1])
    belief, x = first, np.empty_like(fixes)
    for k in range(fixes.shape[-1]):
        fresh = k == 0 or (begins is not None and begins[k])
        prior = first if fresh else kalman.predict(belief, F, Q)
        sensor = Linear(H, variance[..., k, None, None])
        belief = kalman.update(prior, fixes[..., k, None], sensor).posterior
        x[..., k] = belief.mean[..., 0]
    return x


def on_ranges(
    way: Passage, who: Hearing, ranges: Matrix, *, sigma_m: float, start: Gaussian
) -> Matrix:
    """Ours: positions (r, k, 2) [m] of a filter on the ranges (r, k, m) themselves.

    A state [x, y, vx, vy] of constant velocity; what is measured in a cycle conditions it at once,
    be it three ranges or one.
    """
    motion = ConstantVelocity(way.accel_density)
    model = RangeModel(sigma_m=sigma_m)
    F, Q = motion.transition(CYCLE_S), motion.noise(CYCLE_S)
    belief = _of_runs(start, ranges.shape[:1])
    found = np.empty((*ranges.shape[:2], 2))
    for k, hears in enumerate(who.heard):
        prior = kalman.predict(belief, F, Q) if k else belief
        sensor = Ranges(who.place[k, hears], model)
        belief = extended.update(prior, ranges[:, k, hears], sensor).posterior
        found[:, k] = belief.mean[:, :2]
    return found


def _of_runs(start: Gaussian, runs: tuple[int, ...]) -> Gaussian:
    """Begin all runs alike."""
    mean, covariance = start
    return Gaussian(
        np.broadcast_to(mean, (*runs, *mean.shape)),
        np.broadcast_to(covariance, (*runs, *covariance.shape)),
    )
