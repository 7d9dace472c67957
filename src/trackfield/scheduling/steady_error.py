"""How well a field tracks in the long run, place by place: the steady state of its filters."""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.linalg import UNKNOWN_VARIANCE
from trackfield.raster import Raster, Region
from trackfield.scheduling.accuracy import AccuracyMap
from trackfield.types import Matrix, Vector


def steady_rms(information: Matrix, *, step_s: float, accel_sigma_m_s2: float) -> Vector:
    """Root (...) [m] of the trace of the position's covariance that tracking tends to.

    Each step of `step_s` brings `information` (..., d, d) [1/m^2] on the position of a target with
    accelerations N(0, accel_sigma^2) in each axis, constant in a step. In the axes of the
    information the filter falls apart in one of position and velocity each, with measurement
    variance v: its position's variance is v (1 - r^2), r = (4 + m - sqrt(8 m + m^2)) / 4,
    m = accel_sigma step^2 / sqrt(v) (Kalata's tracking index). Infinite where a direction has no
    information: errors there are not bounded.
    """
    if not np.isfinite(information).all():
        raise InputError("found information that is no number, expected finite matrices")
    told = np.linalg.eigvalsh(information)
    free = told[..., 0] <= np.maximum(1e-12 * told[..., -1], 1.0 / UNKNOWN_VARIANCE)
    variance = 1.0 / np.where(free[..., None], 1.0, told)
    settled = _settled(variance, step_s=step_s, accel_sigma_m_s2=accel_sigma_m_s2)
    return np.where(free, np.inf, np.sqrt(settled.sum(axis=-1)))


def steady_map(
    region: Region, information: Matrix, *, step_s: float, accel_sigma_m_s2: float
) -> Raster:
    """Map `steady_rms` of targets that stay about a place: `information` (rows, columns, d, d).

    Rows to the north, columns to the east, as `raster.cell_centres` has them.
    """
    if information.ndim != 4:
        raise InputError(
            f"information of shape {information.shape}, expected (rows, columns, d, d)"
        )
    rms = steady_rms(information, step_s=step_s, accel_sigma_m_s2=accel_sigma_m_s2)
    return Raster(region, rms)


def steady_of(found: AccuracyMap, *, step_s: float, accel_sigma_m_s2: float) -> Raster:
    """Map `steady_rms` over a site in the plane, of all readings of its map of accuracy."""
    axes = np.stack([found.minor_m.values, found.major_m.values], axis=-1) ** 2
    settled = _settled(axes, step_s=step_s, accel_sigma_m_s2=accel_sigma_m_s2)
    rms = np.where(found.determined.values > 0.0, np.sqrt(settled.sum(axis=-1)), np.inf)
    return Raster(found.rms_m.region, rms)


def _settled(variance: Matrix, *, step_s: float, accel_sigma_m_s2: float) -> Matrix:
    """Variance (...) that one axis settles at, of measurements of `variance` (...)."""
    if not (step_s > 0.0 and accel_sigma_m_s2 > 0.0):
        raise InputError(
            f"found step_s {step_s:g} and accel_sigma_m_s2 {accel_sigma_m_s2:g}, expected both "
            "above 0"
        )
    m = accel_sigma_m_s2 * step_s**2 / np.sqrt(variance)
    r = (4.0 + m - np.sqrt(8.0 * m + m**2)) / 4.0
    return variance * (1.0 - r**2)
