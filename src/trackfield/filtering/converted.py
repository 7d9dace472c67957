"""The converted-measurement Kalman filter: ranges become a position first, Wang 3.

A scan of ranges is prelocalized by maximum likelihood, started at the prediction; its position
enters a linear Kalman filter. Leading axes: B runs with scans of the same sensors.

An extended update is the special case of ONE Gauss-Newton step from the prediction with R = GN^-1
(`gauss_newton_step`), so what prelocalization buys is its iterations: safety at bad starts.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.filtering import kalman
from trackfield.filtering.matrices import solve, symmetric
from trackfield.linalg import cholesky, covariance_of
from trackfield.localization.range_likelihood import Problem, RangeScan, problem, terms
from trackfield.localization.range_mle import mle_batch
from trackfield.motion import Motion
from trackfield.types import Gaussian, Matrix

NEWTON_STEPS = 20
NEWTON_TOLERANCE_M = 1e-9


class Mode(Enum):
    """How a scan becomes a position.

    PAPER: Newton from the prediction, R = H^-1, Wang (11), (15). FISHER: damped, R from the Fisher
    matrix of the fitted distances. SAFE: FISHER from two starts, the prediction and the middle of
    the sensors that hear the target; the likelier one is taken.
    """

    PAPER = "paper"
    FISHER = "fisher"
    SAFE = "safe"


class Prelocalized(NamedTuple):
    """Positions (B, d) [m] with covariances (B, d, d) [m^2]; `ok` (B,): found, and a minimum."""

    position: Matrix
    covariance: Matrix
    ok: NDArray[np.bool_]


class Info(NamedTuple):
    """What a step leaves: the prediction, the position it was given, the update."""

    prior: Gaussian
    prelocalized: Prelocalized
    update: kalman.Update


def prelocalize(scan: RangeScan, starts: Matrix, *, mode: Mode = Mode.SAFE) -> Prelocalized:
    """Find positions from ranges (B, n), NaN where not made, from starts (B, d); Wang (8)-(15).

    Fewer than three ranges do not fix a position: `ok` is false.
    """
    made = ~np.isnan(scan.ranges)
    full = scan._replace(ranges=np.where(made, scan.ranges, 0.0))
    enough = made.sum(axis=1) >= 3
    if mode is Mode.PAPER:
        found = _newton(problem(full, made), starts)
        return found._replace(ok=found.ok & enough)
    fixes = mle_batch(full, starts, used=made)
    if mode is Mode.SAFE:
        middle = (made @ scan.sensors) / np.maximum(made.sum(axis=1), 1)[:, None]
        others = mle_batch(full, middle[:, : starts.shape[1]], used=made)
        better = others.converged & ((others.cost < fixes.cost) | ~fixes.converged)
        fixes = fixes._replace(
            position=np.where(better[:, None], others.position, fixes.position),
            covariance=np.where(better[:, None, None], others.covariance, fixes.covariance),
            converged=fixes.converged | others.converged,
            determined=np.where(better, others.determined, fixes.determined),
        )
    ok = fixes.converged & fixes.determined & enough
    return Prelocalized(fixes.position, fixes.covariance, ok)


def gauss_newton_step(scan: RangeScan, starts: Matrix) -> Prelocalized:
    """Take one undamped Gauss-Newton step from `starts` (B, d) on Wang (9); R is GN^-1."""
    made = ~np.isnan(scan.ranges)
    given = problem(scan._replace(ranges=np.where(made, scan.ranges, 0.0)), made)
    at = terms(given, starts, exact=False)
    covariance, determined = covariance_of(at.fisher)
    return Prelocalized(starts - solve(at.fisher, at.gradient), covariance, determined)


def update(prior: Gaussian, prelocalized: Prelocalized) -> kalman.Update:
    """Condition states that begin with the position on prelocalized positions, Wang (18)-(21)."""
    d = prelocalized.position.shape[-1]
    C = np.eye(d, prior.mean.shape[-1])
    z = np.where(prelocalized.ok[..., None], prelocalized.position, np.nan)
    return kalman.update(prior, z, kalman.Linear(C, prelocalized.covariance))


def step(
    belief: Gaussian,
    scan: RangeScan,
    *,
    motion: Motion,
    dt_s: float,
    mode: Mode = Mode.SAFE,
) -> tuple[Gaussian, Info]:
    """Predict by `dt_s`, prelocalize from there, update; without a position only predict.

    Belief: mean (B, n), covariance (B, n, n); ranges (B, m).
    """
    prior = kalman.predict(belief, motion.transition(dt_s), motion.noise(dt_s))
    found = prelocalize(scan, prior.mean[:, : scan.dimensions], mode=mode)
    updated = update(prior, found)
    return updated.posterior, Info(prior, found, updated)


def _newton(given: Problem, starts: Matrix) -> Prelocalized:
    """Newton as printed, Wang (11), all scans at once; `ok` where it ended at a minimum."""
    position = starts.copy()
    eye = np.eye(starts.shape[1])
    moved = np.full(len(starts), np.inf)
    for _ in range(NEWTON_STEPS):
        at = terms(given, position, exact=False)
        flat = np.abs(np.linalg.det(at.hessian)) < 1e-300
        hessian = np.where(flat[:, None, None], eye, at.hessian)
        move = np.where(moved[:, None] < NEWTON_TOLERANCE_M, 0.0, -solve(hessian, at.gradient))
        far = ~(np.abs(move).max(axis=1) < 1e6)
        position = np.where(far[:, None], position, position + move)
        moved = np.where(far, np.inf, np.abs(move).max(axis=1))
        if (moved < NEWTON_TOLERANCE_M).all():
            break
    hessian = terms(given, position, exact=False).hessian
    minimum = cholesky(hessian).ok & (moved < NEWTON_TOLERANCE_M)
    covariance = np.linalg.inv(np.where(minimum[:, None, None], hessian, eye))
    return Prelocalized(position, symmetric(covariance), minimum)
