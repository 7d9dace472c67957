"""Whether covariances are honest: errors and innovations against what the tracker believed."""

from __future__ import annotations

import numpy as np

from trackfield.types import Matrix, Vector

INSIDE_95 = 5.991464547107979  # -2 ln 0.05, the 95 % point of chi-squared with two degrees
CLIP = 9.0  # three standard deviations: one gross error must not speak for a whole run


def distances2(error: Matrix, covariance: Matrix) -> Vector:
    """Squared Mahalanobis distance e' P^-1 e (m,), e (m, >= 2), P as xx, xy, yy (m, 3).

    Infinite where P is not positive definite: nobody may be that sure.
    """
    x, y = error[:, 0], error[:, 1]
    xx, xy, yy = covariance.T
    determinant = xx * yy - xy**2
    sound = (determinant > 0.0) & (xx > 0.0)
    scaled = yy * x**2 - 2.0 * xy * x * y + xx * y**2
    return np.where(sound, scaled / np.where(sound, determinant, 1.0), np.inf)


def nees(distances2: Vector) -> float:
    """Mean squared distance of position errors; 2 if covariances are right, more if too small."""
    return float(np.mean(distances2))


def share_inside(distances2: Vector) -> float:
    """Share of truth inside the 95 % ellipse; 0.95 if the covariances are right."""
    return float(np.mean(distances2 <= INSIDE_95))


def clipped_nis(nis: Vector) -> float | None:
    """Mean of min(NIS, 9) of scalar readings; about 1 if right; None where nothing was updated.

    `nis` (n,) is NaN for rows without an update.
    """
    known = nis[~np.isnan(nis)]
    return float(np.mean(np.minimum(known, CLIP))) if known.size else None
