"""Where the likelihood of a target that keeps its velocity has its maxima, without any prior.

For a place p of the target, what sensors read of one moment is linear in the velocity (angular
rates) or, squared, in its products v_i v_j (sizes of motion), which have rank one. So velocities
are solved for, and only places are searched: from a grid of them, Levenberg-Marquardt leads down in
all entries of the state. First each reading counts by its relative error, on a thinned window:
that makes valleys wide and straight. The best ends are then refined on all readings as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _motion
from trackfield.localization.motion_readings import BEARING, MotionReadings
from trackfield.localization.motion_starts import start_states
from trackfield.types import Matrix, Vector

_RELATIVE = 0.2  # error of a reading in the first search, as a share of it
_REACH = 8.0  # in halves of the diagonal of the sensors' box, where it is not told
_GAIN = 12.0  # nats by which an end of the first search may be worse than the best
_FIRST, _THEN, _LAST = 40, 40, 120  # iterations of the first search, of all and of the best ends
_ENDS = 4  # so many times the finalists are let into the second search
_PARTED = 3e-3  # of extent and speed: ends of the first search nearer to each other are one
_MARGIN = 1.2  # by which an end of the first search may be farther out than targets are looked for
_THINNED = 64  # readings that the first search takes of a window, if not more for its sensors
_FEW = 8  # the same for each sensor


@dataclass(frozen=True, slots=True)
class MotionSearch:
    """Where targets are looked for, and how hard.

    `reach_m`: how far from the middle of the sensors, at the middle of the window; left out, 8
    times the sensors' own distance from it. `max_speed_m_s`: no target is faster. The grid of
    places has `cells` a side (in space half as many), each tried with 2 `headings` beside the
    velocities solved for; the `finalists` best ends are refined.
    """

    reach_m: float | None = None
    max_speed_m_s: float = math.inf
    cells: int = 14
    headings: int = 4
    finalists: int = 40


class Found(NamedTuple):
    """Ends of searches, best first: `state` (k, 2 d) at time 0, `cost` (k,), `converged` (k,)."""

    state: Matrix
    cost: Vector
    converged: NDArray[np.bool_]

    def rows(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Found:
        """Take some of the ends."""
        return Found(self.state[chosen], self.cost[chosen], self.converged[chosen])


class Extent(NamedTuple):
    """Middle (d,) of the sensors, half the diagonal of their box, how far is looked [m]."""

    centre: Vector
    half_m: float
    reach_m: float


def extent(given: MotionReadings, search: MotionSearch) -> Extent:
    """Where the sensors are, and how far from their middle targets are looked for."""
    low, high = given.sensors.min(axis=0), given.sensors.max(axis=0)
    half = 0.5 * float(np.linalg.norm(high - low))
    reach = _REACH * half if search.reach_m is None else search.reach_m
    return Extent(0.5 * (low + high), half, reach)


def maxima(given: MotionReadings, search: MotionSearch) -> Found:
    """Find local maxima of the likelihood of `given`, whose times are counted from the state's.

    `cost` is half the squared misfit. Some of the ends may be the same.
    """
    where = extent(given, search)
    thin = thinned(given)
    starts = start_states(thin, where.centre, where.half_m, reach_m=where.reach_m, search=search)
    soft = thin._replace(sigma=np.hypot(thin.sigma, _RELATIVE * _size(thin)))
    if np.ptp(given.t_s) > 0.0:
        # a window tells bad starts from good ones by their cost; a moment's readings hardly do
        order = np.argsort(_motion.costs(*arrays(soft), starts)[:, 0], kind="stable")
        starts = starts[order[: search.finalists]]
    first = _descend(soft, starts, where, iterations=_FIRST)
    ends = _apart(given, first, where, most=_ENDS * search.finalists)
    then = _descend(given, ends, where, iterations=_THEN)
    best = _apart(given, then, where, most=search.finalists)
    return _sorted(_descend(given, best, where, iterations=_LAST))


def refine(given: MotionReadings, starts: Matrix, *, search: MotionSearch) -> Found:
    """Lead states `starts` (k, 2 d) down to the maxima next to them."""
    where = extent(given, search)
    return _sorted(_descend(given, np.ascontiguousarray(starts), where, iterations=_LAST))


def forward(states: Matrix) -> Matrix:
    """Turn the velocities of states (k, 2 d) that go to the left, or straight down, about."""
    d = states.shape[1] // 2
    speed = np.linalg.norm(states[:, d:], axis=1)
    lead = np.where(np.abs(states[:, d]) > 1e-9 * speed, states[:, d], states[:, d + 1])
    return states * np.where((lead < 0.0)[:, None], np.repeat([1.0, -1.0], d), 1.0)


def thinned(given: MotionReadings) -> MotionReadings:
    """Average the readings of each sensor over blocks of a window, so that about 64 are left.

    A block's noise is that of its mean. A few of the readings where each has a place of its own.
    """
    m = given.value.size
    sources = int(given.source.max(initial=-1)) + 1
    kept = max(_THINNED, _FEW * sources)
    if m <= kept:
        return given
    if sources > m // 2:
        return given.rows(np.linspace(0, m - 1, kept).astype(np.intp))
    group = given.source.astype(np.intp) * 3 + given.kind
    order = np.lexsort((given.t_s, group))
    ranked = given.rows(order)
    _, first, inverse, count = np.unique(
        group[order], return_index=True, return_inverse=True, return_counts=True
    )
    blocks = max(kept // len(first), 2)
    within = (np.arange(m) - first[inverse]) * blocks // count[inverse]
    return _averaged(ranked, inverse.reshape(-1) * blocks + within)


def _averaged(given: MotionReadings, block: NDArray[np.intp]) -> MotionReadings:
    """Average readings by `block` (m,), which rises."""
    _, first, count = np.unique(block, return_index=True, return_counts=True)

    def mean(column: Matrix) -> Matrix:
        total = np.add.reduceat(column, first, axis=0)
        return total / count.reshape(-1, *[1] * (column.ndim - 1))

    angle = given.kind[first] == BEARING
    turned = np.arctan2(mean(np.sin(given.value)), mean(np.cos(given.value)))
    sigma = np.sqrt(mean(given.sigma**2) / count)
    return MotionReadings(
        mean(given.t_s),
        given.sensors[first],
        given.velocities[first],
        np.where(angle, turned, mean(given.value)),
        sigma,
        given.falloff[first],
        given.kind[first],
        given.source[first],
    )


def _size(given: MotionReadings) -> Vector:
    """Size of each reading, of a bearing half a radian."""
    return np.where(given.kind == BEARING, 0.5, np.abs(given.value))


def _descend(given: MotionReadings, starts: Matrix, where: Extent, *, iterations: int) -> Found:
    out = _motion.descend(*arrays(given), starts, where.centre, 10.0 * where.reach_m, iterations)
    size = 2 * given.dimensions
    return Found(out[:, :size], out[:, size], out[:, size + 2] > 0.0)


def _sorted(found: Found) -> Found:
    return found.rows(np.argsort(found.cost, kind="stable"))


def _apart(given: MotionReadings, found: Found, where: Extent, *, most: int) -> Matrix:
    """States (k, 2 d) that are not much worse than the best, by rising cost, near ones once."""
    d = given.dimensions
    if given.reversible:
        found = found._replace(state=forward(found.state))
    inside = np.linalg.norm(found.state[:, :d] - where.centre, axis=1) <= _MARGIN * where.reach_m
    state, cost, _ = _sorted(found.rows(inside))
    left = state[cost <= cost.min(initial=math.inf) + _GAIN]
    kept: list[Vector] = []
    while len(left) and len(kept) < most:
        first = left[0]
        kept.append(first)
        place = np.abs(left[:, :d] - first[:d]).max(axis=1) > _PARTED * where.half_m
        speed = np.abs(left[:, d:] - first[d:]).max(axis=1)
        left = left[place | (speed > _PARTED * np.linalg.norm(first[d:]))]
    return np.array(kept).reshape(-1, 2 * d)


def arrays(
    given: MotionReadings,
) -> tuple[Vector, Matrix, Matrix, Matrix, NDArray[np.int32]]:
    """Lay the readings out as the kernels take them."""
    return (
        np.ascontiguousarray(given.t_s),
        np.ascontiguousarray(given.sensors),
        np.ascontiguousarray(given.velocities),
        np.ascontiguousarray([given.value, given.sigma, given.falloff]),
        np.ascontiguousarray(given.kind),
    )
