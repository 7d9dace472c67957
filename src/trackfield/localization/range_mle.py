"""Position of a target from the ranges of one moment: maximum likelihood, Wang 3.2."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import cholesky, covariance_of, solve
from trackfield.localization.range_likelihood import Problem, RangeScan, Terms, problem, terms
from trackfield.types import Matrix, Vector

ITERATIONS = 200
DONE = 1e-18  # promised gain of cost at which a search ends: 1e-9 standard deviations are left
NEAR = 1e-4  # the same where the exact likelihood takes over


class RangeFix(NamedTuple):
    """A position from ranges, (d,) [m], with covariance (d, d) [m^2].

    `cost` is half the squared misfit in standard deviations, with the change of log variance
    against the start (`terms`). `determined` is false where some direction is not fixed by the
    ranges; its variance is then huge, not infinite. `converged`: the search ended at a minimum.
    """

    position: Vector
    covariance: Matrix
    cost: float
    iterations: int
    converged: bool
    determined: bool


class RangeFixes(NamedTuple):
    """Columns of `RangeFix` over B scans or starts."""

    position: Matrix
    covariance: Matrix
    cost: Vector
    iterations: NDArray[np.intp]
    converged: NDArray[np.bool_]
    determined: NDArray[np.bool_]

    def row(self, i: int) -> RangeFix:
        """Return fix `i`."""
        return RangeFix(
            self.position[i],
            self.covariance[i],
            float(self.cost[i]),
            int(self.iterations[i]),
            bool(self.converged[i]),
            bool(self.determined[i]),
        )


class CostTerms(NamedTuple):
    """Wang's cost (9) with gradient (d,) and Hessian (d, d), Wang (14), corrected."""

    cost: float
    gradient: Vector
    hessian: Matrix


def cost_gradient_hessian(scan: RangeScan, position: Vector) -> CostTerms:
    """Wang's cost f (9) at `position` (d,), with variances from the readings, and its slopes."""
    at = terms(problem(scan), _starts(scan, position, 1), exact=False)
    return CostTerms(float(at.cost[0]), at.gradient[0], at.hessian[0])


def mle(scan: RangeScan, start: Vector) -> RangeFix:
    """Find the maximum of the likelihood, Wang (6), downhill from `start` (d,).

    Levenberg-Marquardt on Wang (9), whose variances come from the readings; once that has
    converged, on the exact likelihood, whose variances belong to the fitted distances. The
    covariance is the inverse of the Fisher matrix there.
    """
    return mle_batch(scan, start).row(0)


def mle_batch(
    scan: RangeScan, starts: Matrix, *, used: NDArray[np.bool_] | None = None
) -> RangeFixes:
    """Run `mle` from `starts` (B, d), on ranges (B, n) of B scans or (n,) of one for all starts.

    `used` (B, n) tells which readings count in each.
    """
    given = problem(scan, used)
    count = max(len(np.atleast_2d(starts)), len(given.excess), len(given.used))
    given = given.stacked(count)
    fixed = not given.growth.any()  # then both costs are one
    found, at, iterations, converged = _descend(
        given, _starts(scan, starts, count), done=DONE if fixed else NEAR, exact=False
    )
    if converged.any() and not fixed:
        rows = np.flatnonzero(converged)
        better, now, more, ended = _descend(given.rows(rows), found[rows], done=DONE, exact=True)
        found[rows], iterations[rows], converged[rows] = better, iterations[rows] + more, ended
        for whole, part in zip(at, now, strict=True):
            whole[rows] = part
    covariance, determined = covariance_of(at.fisher)
    return RangeFixes(found, covariance, at.cost, iterations, converged, determined)


def newton(
    scan: RangeScan, start: Vector, *, step: float = 1.0, tolerance_m: float = 1e-9
) -> RangeFix:
    """Paper mode: Newton's iteration as printed, Wang (11), with covariance R = H^-1, Wang (15).

    Nothing keeps it from a saddle, a maximum or from running away; `mle` has no such trouble.
    `converged` says that the last step was short, `determined` that H is positive definite.
    """
    given = problem(scan)
    position = _starts(scan, start, 1)
    count, converged = 0, False
    at = terms(given, position, exact=False)
    while count < ITERATIONS and not converged:
        try:
            move = -step * np.linalg.solve(at.hessian, at.gradient[..., None])[..., 0]
        except np.linalg.LinAlgError:
            break
        if not np.abs(move).max() < 1e9:
            break
        position = position + move
        at = terms(given, position, exact=False)
        count, converged = count + 1, bool(np.abs(move).max() < tolerance_m)
    determined = bool(cholesky(at.hessian).ok[0])
    covariance = np.linalg.inv(at.hessian) if converged else covariance_of(at.fisher).value
    return RangeFix(
        position[0], covariance[0], float(at.cost[0]), count, converged, converged and determined
    )


def _starts(scan: RangeScan, starts: Matrix, count: int) -> Matrix:
    given = np.atleast_2d(np.asarray(starts, float))
    if given.shape[-1] != scan.dimensions or len(given) not in (1, count):
        raise InputError(f"starts of shape {given.shape}: expected ({count}, {scan.dimensions})")
    if not np.isfinite(given).all():
        raise InputError("a start must be finite")
    return np.array(np.broadcast_to(given, (count, scan.dimensions)))


class _Descent(NamedTuple):
    """Where each search ended: positions, terms there, iterations, whether at a minimum."""

    positions: Matrix
    at: Terms
    iterations: NDArray[np.intp]
    converged: NDArray[np.bool_]


def _descend(given: Problem, starts: Matrix, *, done: float, exact: bool) -> _Descent:
    """Levenberg-Marquardt from each start at once; only searches still under way are computed."""
    position = starts.copy()
    at = terms(given, position, exact=exact)
    damping = np.zeros(len(position))
    iterations = np.zeros(len(position), np.intp)
    converged = np.zeros(len(position), bool)
    live = np.arange(len(position))
    for _ in range(ITERATIONS):
        step, gain = _step(Terms(*(part[live] for part in at)), damping[live])
        ended = (gain <= done * (1.0 + np.abs(at.cost[live]))) & (damping[live] < 1.0)
        converged[live[ended]] = True
        live, step, gain = live[~ended], step[~ended], gain[~ended]
        if not live.size:
            break

        trial, cost = position[live] + step, at.cost[live]
        then = terms(given.rows(live), trial, exact=exact)
        slack = 1e-14 * (1.0 + np.abs(cost))  # rounding of the cost itself
        better = then.cost <= cost - 1e-4 * gain + slack
        taken = live[better]
        position[taken] = trial[better]
        for whole, part in zip(at, then, strict=True):
            whole[taken] = part[better]
        relaxed = np.where(damping[live] > 1e-4, 0.3 * damping[live], 0.0)
        damping[live] = np.where(better, relaxed, np.maximum(4.0 * damping[live], 1e-2))
        iterations[live] += 1
    return _Descent(position, at, iterations, converged)


def _step(now: Terms, damping: Vector) -> tuple[Matrix, Vector]:
    """Damped step (B, d) and the gain of cost (B,) it promises.

    The Hessian is used where it is positive definite, for its quadratic convergence, else the
    Fisher matrix, which never is indefinite: either way the step leads downhill.
    """
    eye = np.eye(now.gradient.shape[1])
    size = np.trace(now.fisher, axis1=1, axis2=2) / len(eye)
    _, convex = cholesky(now.hessian - (1e-9 * size)[:, None, None] * eye)
    curvature = np.where(convex[:, None, None], now.hessian, now.fisher)
    ridge = np.maximum(damping, np.where(convex, 0.0, 1e-9)) * size + np.finfo(float).tiny
    step, _ = solve(curvature + ridge[:, None, None] * eye, -now.gradient[..., None])
    move = step[..., 0]
    return move, -0.5 * np.sum(now.gradient * move, axis=1)
