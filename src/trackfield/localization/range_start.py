"""Position of a target from ranges and nothing else: every candidate, best first."""

from __future__ import annotations

import math
from enum import Enum
from itertools import combinations, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import mahalanobis2
from trackfield.localization.range_likelihood import Problem, RangeScan, problem
from trackfield.localization.range_mle import RangeFix, RangeFixes, mle_batch
from trackfield.sensing.range import distance
from trackfield.types import Matrix, Vector

AMBIGUOUS_COST = math.log(
    100.0
)  # a second candidate counts down to 1 % of the best one's likelihood
FLAT = 1e-7  # sensors span a direction if they reach this part of their extent in it
SUBSETS = 500  # at most so many minimal subsets are solved in the search with outliers
FINALISTS = 12  # and so many of their points are refined
REFITS = 2  # how often readings are judged anew by the refined points
APART = 5.0  # standard deviations from which on two places count as two
OUTLIER_COST = 4.5  # an outlier costs as much as a reading three standard deviations off


class Degeneracy(Enum):
    """What the sensors cannot tell, however exact they are; the value is the sentence to show."""

    NONE = "The sensors fix the position."
    MIRROR = (
        "The sensors lie on one line (in space: in one plane): a position and its mirror image "
        "explain the ranges equally well."
    )
    CIRCLE = (
        "The sensors stand at one place (in space: on one line): the ranges only say on which "
        "circle the target is."
    )
    SPHERE = "The sensors stand at one place: the ranges only say on which sphere the target is."


class Locus(NamedTuple):
    """Circle or sphere of all positions that explain the ranges: centre (d,), radius [m].

    `axes` (d, k) spans the plane of the circle (k = 2) or the space of the sphere (k = 3).
    """

    centre: Vector
    radius_m: float
    axes: Matrix


class RangeStart(NamedTuple):
    """All positions that ranges allow, the most likely first.

    `candidates` holds the local maxima of the likelihood that were found; it is empty for a circle
    or a sphere, which `locus` then describes. `ambiguous`: a second candidate, or another choice of
    outliers, is at least 1 % as likely as the first, or no candidate exists. `used` (n,): readings
    not set aside as outliers.
    """

    candidates: tuple[RangeFix, ...]
    degenerate: Degeneracy
    ambiguous: bool
    locus: Locus | None
    used: NDArray[np.bool_]


class _Span(NamedTuple):
    """Centre (d,) and orthonormal axes (d, d), columns by falling extent; `rank` of them count."""

    centre: Vector
    axes: Matrix
    rank: int


def locate(scan: RangeScan, *, outliers: int = 0) -> RangeStart:
    """Find every position that explains one scan, without any prior.

    Starts are the lifted linear solution (|p|^2 as an unknown of its own: linear in the squared
    ranges) and its mirrored forms in the sensors' principal line or plane, each refined by `mle`.

    With `outliers` > 0, up to so many gross readings are found by consensus of minimal subsets and
    set aside; they are only looked for as far as n >= d + 2 + outliers readings leave proof.
    """
    given = problem(scan)
    if len(given.excess) != 1:
        raise InputError(f"{len(given.excess)} scans: expected one")
    planar, squares, weights = _squares(given, scan.dimensions)
    span = _span(planar)
    everything = np.ones(len(planar), bool)
    missing = scan.dimensions - span.rank
    if missing >= 2:
        kind = Degeneracy.SPHERE if missing == 3 else Degeneracy.CIRCLE
        locus = _locus(span, planar, squares, weights)
        return RangeStart((), kind, ambiguous=True, locus=locus, used=everything)

    kind = Degeneracy.MIRROR if missing == 1 else Degeneracy.NONE
    starts = _lifted_starts(span, planar, squares, weights)
    spare = min(outliers, len(planar) - scan.dimensions - 2)
    if spare > 0:
        fixes, used, rival = _consensus(scan, given, starts, spare=spare)
    else:
        fixes, used, rival = mle_batch(scan, starts), everything, False
    candidates = _distinct(fixes, distance_m=1e-6 * _extent(planar, given))
    close = [c for c in candidates if c.cost < candidates[0].cost + AMBIGUOUS_COST]
    ambiguous = rival or len(close) != 1
    return RangeStart(candidates, kind, ambiguous, None, used)


def _squares(given: Problem, dimensions: int) -> tuple[Matrix, Vector, Vector]:
    """Sensors (n, d) in the target's plane, squared distances to them there, and weights (n,).

    A squared reading (z - bias)^2/a^2 exceeds r^2 by v/a^2 in the mean and has the variance
    4 r^2 v/a^2 + 2 v^2/a^4.
    """
    rho = np.maximum(given.excess[0], 0.0) / given.slope
    v = given.variance[0] / given.slope**2
    squares = rho**2 - v
    if given.height_m is not None:
        squares = squares - (given.height_m - given.sensors[:, 2]) ** 2
    return given.sensors[:, :dimensions], squares, 1.0 / (4.0 * rho**2 * v + 2.0 * v**2)


def _span(points: Matrix) -> _Span:
    centre = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - centre, full_matrices=True)
    size = np.abs(points).max() * np.finfo(float).eps + FLAT * extents[0]
    return _Span(centre, axes.T, int(np.sum(extents > size)))


def _extent(points: Matrix, given: Problem) -> float:
    return float(np.ptp(points, axis=0).max() + np.abs(given.excess).max())


def _lifted(span: _Span, points: Matrix, squares: Vector, weights: Vector) -> tuple[Vector, float]:
    """Foot (d,) of the target in the plane of `span`'s axes, and its squared height over it.

    With coordinates x of a sensor in that plane, q_i = |p|^2 + h^2 - 2 x_i p + |x_i|^2 is linear in
    p and in the intercept |p|^2 + h^2, which takes up what the plane does not tell.
    """
    axes = span.axes[:, : span.rank]
    x = (points - span.centre) @ axes
    root = np.sqrt(weights)
    design = np.column_stack([-2.0 * x, np.ones(len(x))]) * root[:, None]
    right = (squares - np.sum(x**2, axis=1)) * root
    solution = np.asarray(np.linalg.lstsq(design, right, rcond=None)[0], np.float64)
    foot = solution[:-1]
    return span.centre + axes @ foot, float(solution[-1] - foot @ foot)


def _locus(span: _Span, points: Matrix, squares: Vector, weights: Vector) -> Locus:
    centre, height2 = _lifted(span, points, squares, weights)
    return Locus(centre, math.sqrt(max(height2, 0.0)), span.axes[:, span.rank :])


def _lifted_starts(span: _Span, points: Matrix, squares: Vector, weights: Vector) -> Matrix:
    """Return starts (k, d): the lifted solution, where there is one, and the mirrored pair.

    The pair is tried always: near a line, the lifted solution says little across it.
    """
    d = points.shape[1]
    flat = span._replace(rank=d - 1)
    foot, height2 = _lifted(flat, points, squares, weights)
    # never exactly in the mirror: by symmetry no search could leave it
    least = math.sqrt(1.0 / float(np.max(weights)))
    across = math.sqrt(max(height2, least)) * span.axes[:, -1]
    starts = [foot + across, foot - across]
    if span.rank == d:
        starts.insert(0, _lifted(span, points, squares, weights)[0])
    return np.array(starts)


def _consensus(
    scan: RangeScan, given: Problem, starts: Matrix, *, spare: int
) -> tuple[RangeFixes, NDArray[np.bool_], bool]:
    """Refine the points on which all but at most `spare` readings agree best.

    Every d sensors meet in up to two points; a reading counts at most `OUTLIER_COST` against one.
    The flag says that another place does nearly as well with other readings set aside.
    """
    points = np.concatenate([starts, _meeting_points(given, scan.dimensions)])
    order = np.argsort(_misfits(given, points)[0])
    chosen = points[order[:FINALISTS]]
    for _ in range(REFITS):
        _, used = _misfits(given, chosen, spare=spare)
        chosen = mle_batch(scan, chosen, used=used).position
    total, used = _misfits(given, chosen, spare=spare)
    first = int(np.argmin(total))
    agreed = np.asarray((used == used[first]).all(axis=1))
    fixes = mle_batch(scan, chosen[agreed], used=used[first])
    away, _ = mahalanobis2(chosen - chosen[first], fixes.covariance[np.sum(agreed[:first])])
    rival = ~agreed & (away > APART**2) & (total < total[first] + AMBIGUOUS_COST)
    return fixes, used[first], bool(rival.any())


def _misfits(
    given: Problem, points: Matrix, *, spare: int | None = None
) -> tuple[Vector, NDArray[np.bool_]]:
    """Cost (k,) of `points`, and which readings (k, n) agree, all but at most `spare` anyway."""
    full = points
    if given.height_m is not None:
        full = np.column_stack([points, np.full(len(points), given.height_m)])
    r = distance(given.sensors, full)
    v = given.constant[0] + given.growth * r**2
    cost = 0.5 * (given.slope * r - given.excess[0]) ** 2 / v
    good = cost < OUTLIER_COST
    if spare is not None:
        rank = np.argsort(np.argsort(cost, axis=1), axis=1)
        good = good | (rank < cost.shape[1] - spare)
    return np.minimum(cost, OUTLIER_COST).sum(axis=1), good


def _meeting_points(given: Problem, dimensions: int) -> Matrix:
    """Points (k, d) in which the circles or spheres of d sensors meet, or nearly do."""
    points, squares, weights = _squares(given, dimensions)
    every = combinations(range(len(points)), dimensions)
    total = math.comb(len(points), dimensions)
    found: list[Matrix] = []
    for chosen in islice(every, 0, None, -(-total // SUBSETS)):
        some = list(chosen)
        span = _span(points[some])
        if span.rank == dimensions - 1:
            found.append(_lifted_starts(span, points[some], squares[some], weights[some]))
    return np.concatenate(found) if found else np.empty((0, dimensions))


def _distinct(fixes: RangeFixes, *, distance_m: float) -> tuple[RangeFix, ...]:
    """List the fixes that converged, each place once, by rising cost."""
    kept: list[RangeFix] = []
    for i in np.argsort(fixes.cost, kind="stable"):
        fix = fixes.row(int(i))
        apart = all(np.linalg.norm(fix.position - k.position) > distance_m for k in kept)
        if fix.converged and apart:
            kept.append(fix)
    return tuple(kept)
