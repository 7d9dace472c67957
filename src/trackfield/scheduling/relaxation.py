"""What no selection can beat: shares of sensors instead of sensors, and a proof anyone can check.

Let sensors be taken by shares w, 0 <= w <= 1, sum w = k. The criterion is concave (A: minus the
trace) in the information M(w) = P + sum w_i g_i g_i', so that its tangent at ANY point bounds it
for all shares, and sets are shares. With the slope G of the tangent and `top`, the sum of the k
largest scores g_i' G g_i (the most that <scores, w> can be):

A   tr M^-1 >= (tr G^1/2)^2 / (tr G P + top);  without prior, (tr X)^2 / max_w <g, w> with X = G^1/2
D   log det M <= d log((tr G P + top) / d) - log det G
E   smallest eigenvalue <= (tr G P + top) / tr G

At the slope of the best shares (M^-2, M^-1, a weighting of the smallest eigenvectors) the bound is
the value of the relaxation itself. D: Joshi and Boyd, Sensor selection via convex optimization.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield._core import _selection
from trackfield.errors import InputError
from trackfield.scheduling.criteria import (
    COARSE,
    CRITERIA,
    FINE,
    Criterion,
    checked,
    checked_number,
    checked_prior,
    criterion_code,
    known,
    rescaled,
    scaled,
)
from trackfield.types import Matrix, Vector

TOLERANCE = 1e-6  # share of the value by which the bound may miss the best shares


class Relaxation(NamedTuple):
    """The best shares `shares` (n,), what they reach, and what no shares exceed.

    `value` is that of the criterion at the shares, `bound` that of the tangent with slope
    `certificate` (d, d): `dual_bound` computes it from nothing else.
    """

    shares: Vector
    value: float
    bound: float
    certificate: Matrix


def relax(
    gains: Matrix, k: int, *, prior: Matrix | None = None, criterion: Criterion = "A"
) -> Relaxation:
    """Find shares w of the sensors, 0 <= w <= 1, sum w = k, that are best for the criterion.

    `gains` (n, d), prior information (d, d). A primal-dual interior-point method: a step costs
    O(n d^4), ten to thirty are needed; of thousands of sensors only some hundred that could have a
    share take part. Raises `InputError` as `select` does.
    """
    g, p = checked(gains, prior)
    code = criterion_code(criterion)
    k = min(checked_number(k), len(g))
    if k in (0, len(g)):  # nothing to choose
        shares = np.ones(len(g))
        everything = known(g, prior=p, criterion=criterion)
        slope = _slope(everything.covariance, criterion)
        return Relaxation(shares, everything.value, everything.value, slope)
    unit = scaled(g, p)
    if not unit.length:  # nobody says anything: all shares are alike
        left = known(g[:0], prior=p, criterion=criterion)
        slope = _slope(left.covariance, criterion)
        return Relaxation(np.full(len(g), k / len(g)), left.value, left.value, slope)
    ridge = COARSE if len(known(g, prior=p).missing) else FINE
    fields = unit.gains[None], unit.prior[None], k, code, ridge, TOLERANCE
    shares, _, merit, certificate = _selection.relaxed(*fields)
    reached = known(g * np.sqrt(shares)[:, None], prior=p, criterion=criterion).value
    bound = rescaled(
        -merit if criterion == "A" else merit, unit.length, criterion=criterion, d=len(p)
    )
    if not math.isfinite(bound):  # numbers of no size: no shares are better than all sensors
        everything = known(g, prior=p, criterion=criterion)
        bound, certificate = everything.value, _slope(everything.covariance, criterion)
    return Relaxation(shares, reached, bound, certificate)


def dual_bound(
    gains: Matrix,
    k: int,
    *,
    certificate: Matrix,
    prior: Matrix | None = None,
    criterion: Criterion = "A",
) -> float:
    """Bound the value of every set of k sensors by a symmetric matrix G, whatever it is.

    The formulas stand at the top of the module. `certificate` (d, d) is positive definite (for E
    semidefinite and not zero); the better it is chosen, the nearer the bound. Raises `InputError`.
    """
    g, p = checked(gains, prior)
    criterion_code(criterion)
    slope = checked_prior(certificate, g.shape[1])
    roots = np.linalg.eigvalsh(slope)
    if roots[-1] <= 0.0 or (criterion == "D" and roots[0] <= 0.0):
        raise InputError(f"certificate: found eigenvalues {roots.tolist()}, expected positive ones")
    scores = np.sort(((g @ slope) * g).sum(axis=1))[::-1]
    reach = float((slope * p).sum() + scores[: checked_number(k)].sum())
    if reach <= 0.0:  # no sensor, no prior: nothing is known of what the matrix asks for
        return math.inf if criterion == "A" else (-math.inf if criterion == "D" else 0.0)
    d = len(slope)
    if criterion == "A":
        return float(np.sqrt(np.maximum(roots, 0.0)).sum()) ** 2 / reach
    if criterion == "D":
        return d * math.log(reach / d) - float(np.log(roots).sum())
    return reach / float(roots.sum())


def _slope(covariance: Matrix, criterion: Criterion) -> Matrix:
    """Slope of the criterion in the information where that leaves this covariance."""
    if criterion == CRITERIA[0]:
        return covariance @ covariance
    if criterion == CRITERIA[1]:
        return covariance
    axis = np.linalg.eigh(covariance)[1][:, -1]
    return np.outer(axis, axis)
