"""Whether a filter's errors stay bounded: steady states, detectability, Lyapunov's terms.

With process noise the covariance of a Kalman filter tends to a steady state, not to zero, if every
direction that does not die out by itself is seen: that is the diagnosis. Pham's conditions (2.21),
(2.22) are evaluated too: the first always holds, the second is sufficient and not necessary.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from scipy import linalg

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_linalg = cast("Any", linalg)  # which has no types

_SEEN = 1e-9  # of the largest: singular values below it are rounding
_MARGIN = 1e-6  # of modes on the unit circle, whose computed values are off by a root of rounding
_DOUBLINGS = 60  # of steps, which are then more than any filter takes
_SETTLED = 1e-15
_NAMES = {4: ("x", "y", "vx", "vy"), 6: ("x", "y", "z", "vx", "vy", "vz")}


class Filtered(NamedTuple):
    """What a Kalman filter believes: x' = F x + w, y = H x + v, w ~ N(0, Q), v ~ N(0, Theta).

    `transition` F and `process_noise` Q (n, n); `measurement` H (m, n) and its noise Theta (m, m).
    """

    transition: Matrix
    process_noise: Matrix
    measurement: Matrix
    measurement_noise: Matrix


class SteadyState(NamedTuple):
    """Where the covariance of a filter tends to: `predicted` and, after an update, `updated`.

    Both (n, n). Errors along `free` (n, k), orthonormal, are not bounded: nothing tells of them,
    and they do not die out. The covariances are then those of the rest. `decay` is the factor by
    which what the filter believed at first counts less with each step, of the rest, at last.
    """

    predicted: Matrix
    updated: Matrix
    free: Matrix
    decay: float

    @property
    def bounded(self) -> bool:
        """Whether all errors are."""
        return self.free.shape[1] == 0


class LyapunovTest(NamedTuple):
    """Conditions under which V = e' P^-1 e does not grow in a step without noise, Pham (2.20).

    `update`, the largest eigenvalue of H P+ H' - Theta in units of Theta, (2.21): never above 0.
    `nonlinearity` |a|^2 is at most `limit` where (2.22) holds, which is `sufficient`. `growth` is
    the largest factor by which V really can grow in the prediction: not at all up to 1.
    """

    update: float
    nonlinearity: float
    limit: float
    growth: float

    @property
    def sufficient(self) -> bool:
        """Whether (2.22) holds; where it does not, errors may be bounded all the same."""
        return self.nonlinearity <= self.limit


def undetectable(model: Filtered) -> Matrix:
    """Directions (n, k), orthonormal, in which errors stay or grow and no measurement ever tells.

    The largest subspace that F keeps and H does not see, less what dies out in it.
    """
    F, H = model.transition, model.measurement
    unseen = _unseen(F, H)
    return unseen @ _modes(unseen.T @ F @ unseen, above=1.0 - _MARGIN)


def in_words(direction: Vector) -> str:
    """Write a direction of a state (n,) as a sum: "0.71 x - 0.71 y"."""
    names = _NAMES.get(direction.size, tuple(f"x{i}" for i in range(direction.size)))
    largest = int(np.argmax(np.abs(direction)))
    turned = direction * (1.0 if direction[largest] > 0.0 else -1.0)
    terms = [
        f"{'-' if value < 0.0 else '+'} {abs(value):.2f} {name}"
        for name, value in zip(names, turned, strict=True)
        if abs(value) >= 0.005
    ]
    return " ".join(terms).removeprefix("+ ")


def steady_state(model: Filtered) -> SteadyState:
    """Solve P = F (P - P H' (H P H' + Theta)^-1 H P) F' + Q for the limit of a filter.

    From any start above zero; of what is detectable. Modes on the unit circle that no noise drives
    are known ever better: their variance tends to 0. `InputError` for shapes that do not fit, or a
    Theta that is not positive definite.
    """
    _check(model)
    F, Q, H, theta = model
    free = undetectable(model)
    seen = _complement(free)
    known = _undriven(seen.T @ F @ seen, seen.T @ Q @ seen)
    basis = seen @ _complement(known)
    part = Filtered(basis.T @ F @ basis, basis.T @ Q @ basis, H @ basis, theta)
    P = basis @ _riccati(part) @ basis.T
    gain = np.linalg.solve(H @ P @ H.T + theta, H @ P).T
    keep = np.eye(len(F)) - gain @ H
    updated = _symmetric(keep @ P @ keep.T + gain @ theta @ gain.T)
    loop = basis.T @ F @ keep @ basis
    decay = float(np.abs(np.linalg.eigvals(loop)).max(initial=1.0 if known.size else 0.0))
    return SteadyState(P, updated, free, decay)


def lyapunov_test(
    model: Filtered, covariance: Matrix, *, nonlinearity: Vector | None = None
) -> LyapunovTest:
    """Evaluate Pham's (2.21) and (2.22), corrected, for a step from `covariance` P (n, n).

    `nonlinearity` (n,) is the diagonal of a, x' = a F x + w; without it, the motion is linear.
    `InputError` where P or F is singular.
    """
    before, predicted, updated = _step(model, covariance)
    a = _diagonal(model, nonlinearity)
    H, theta = model.measurement, model.measurement_noise
    update = _linalg.eigh(H @ updated @ H.T - theta, theta, eigvals_only=True)
    growth = _linalg.eigh(
        a[:, None] * np.linalg.inv(predicted) * a, np.linalg.inv(before), eigvals_only=True
    )
    limit = float(np.linalg.eigvalsh(predicted)[0] / np.linalg.eigvalsh(before)[-1])
    return LyapunovTest(float(update[-1]), float(np.abs(a).max()) ** 2, limit, float(growth[-1]))


def lyapunov_change(
    model: Filtered, covariance: Matrix, errors: Matrix, *, nonlinearity: Vector | None = None
) -> tuple[Vector, Vector]:
    """Change of V = e' P^-1 e in a step without noise: by prediction and by update, (...) each.

    Of `errors` e (..., n): (F e)' [a P-^-1 a - (F P F')^-1] F e, and, with r the residual,
    r' Theta^-1 (H P+ H' - Theta) Theta^-1 r, never above 0. Pham (2.19), corrected.
    """
    before, predicted, updated = _step(model, covariance)
    a = _diagonal(model, nonlinearity)
    F, _, H, theta = model
    moved = errors @ F.T
    kernel = a[:, None] * np.linalg.inv(predicted) * a - np.linalg.inv(before)
    residual = np.linalg.solve(theta, (H @ (a * moved)[..., None]))[..., 0]
    gained = H @ updated @ H.T - theta
    return (
        np.einsum("...i,ij,...j->...", moved, kernel, moved),
        np.einsum("...i,ij,...j->...", residual, gained, residual),
    )


def _riccati(model: Filtered) -> Matrix:
    """Limit of the predicted covariance of a filter that knew all at first, by doubling.

    Each round doubles the number of steps that the covariance has behind it. Where noise drives all
    that does not die out, the limit is the same from any start; what grows without noise would stay
    known from this one, and has SciPy solve the equation.
    """
    F, Q, H, theta = model
    n = len(F)
    if _lasting(F, Q).shape[1]:
        return np.asarray(_linalg.solve_discrete_are(F.T, H.T, Q, theta), np.float64)
    # Of as many steps: closed loop, information gathered, covariance.
    loop, told, covariance = F.T, H.T @ np.linalg.solve(theta, H), Q
    for _ in range(_DOUBLINGS):
        both = np.linalg.solve(np.eye(n) + told @ covariance, np.hstack([loop, told]))
        gained = loop.T @ covariance @ both[:, :n]
        told = _symmetric(told + loop @ both[:, n:] @ loop.T)
        loop = loop @ both[:, :n]
        covariance = _symmetric(covariance + gained)
        if np.abs(gained).max(initial=0.0) <= _SETTLED * np.abs(covariance).max(initial=0.0):
            break
    return covariance


def _symmetric(matrix: Matrix) -> Matrix:
    return 0.5 * (matrix + matrix.T)


def _undriven(F: Matrix, Q: Matrix) -> Matrix:
    """Directions (n, k), orthonormal, on which nothing acts and that neither die out nor grow."""
    kept = _lasting(F, Q)
    return kept @ _complement(_modes(kept.T @ F.T @ kept, above=1.0 + _MARGIN))


def _lasting(F: Matrix, Q: Matrix) -> Matrix:
    """Directions (n, k), orthonormal, on which nothing acts and that do not die out."""
    still = _unseen(F.T, Q)
    return still @ _modes(still.T @ F.T @ still, above=1.0 - _MARGIN)


def _unseen(F: Matrix, H: Matrix) -> Matrix:
    """Largest subspace (n, k), as an orthonormal basis, that F keeps and H maps to zero."""
    basis = _kernel(H)
    while basis.shape[1]:
        image = F @ basis
        stays = _kernel(image - basis @ (basis.T @ image), scale=float(np.abs(F).max(initial=1.0)))
        if stays.shape[1] == basis.shape[1]:
            break
        basis = basis @ stays
    return basis


def _kernel(matrix: Matrix, *, scale: float | None = None) -> Matrix:
    """Orthonormal basis (n, k) of what a matrix (m, n) maps to zero, against its own size."""
    _, values, rows = np.linalg.svd(matrix)
    size = float(values.max(initial=0.0)) if scale is None else scale
    return rows[int((values > _SEEN * size).sum()) :].T


def _complement(basis: Matrix) -> Matrix:
    """Orthonormal basis (n, n - k) of what is orthogonal to all of a basis (n, k)."""
    return _kernel(basis.T, scale=1.0)


def _modes(F: Matrix, *, above: float) -> Matrix:
    """Orthonormal basis of the modes of F whose eigenvalues have a modulus of more than `above`."""
    if not F.size:
        return F
    _, vectors, count = _linalg.schur(F / above, output="real", sort="ouc")
    return np.asarray(vectors, np.float64)[:, : int(count)]


def _step(model: Filtered, covariance: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """F P F', that and Q, and the covariance after the update."""
    _check(model)
    F, Q, H, theta = model
    before = F @ covariance @ F.T
    if np.linalg.eigvalsh(before)[0] <= 1e-14 * np.linalg.eigvalsh(before)[-1]:
        raise InputError("found F P F' singular, expected a positive definite P and a regular F")
    predicted = before + Q
    gain = np.linalg.solve(H @ predicted @ H.T + theta, H @ predicted).T
    return before, predicted, predicted - gain @ H @ predicted


def _diagonal(model: Filtered, nonlinearity: Vector | None) -> Vector:
    return np.ones(len(model.transition)) if nonlinearity is None else nonlinearity


def _check(model: Filtered) -> None:
    n, m = len(model.transition), len(model.measurement)
    shapes = tuple(part.shape for part in model)
    if shapes != ((n, n), (n, n), (m, n), (m, m)):
        raise InputError(f"found shapes {shapes}, expected (n, n), (n, n), (m, n), (m, m)")
    if not all(np.isfinite(part).all() for part in model):
        raise InputError("found a model with entries that are no numbers, expected finite ones")
    if m and np.linalg.eigvalsh(model.measurement_noise)[0] <= 0.0:
        raise InputError("found measurement noise that is not positive definite")
