"""What comes in: scans of reports that can be used, and counts of those that cannot."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import ReportScan
from trackfield.errors import InputError
from trackfield.raster import Region
from trackfield.types import Matrix

_FAR = 5.0  # sigmas outside the region: no error of a report brings one there


class Intake(NamedTuple):
    """A scan that can be used, and how many of its reports were left out, and why."""

    scan: ReportScan
    outside: int
    duplicate: int


def take_in(
    scan: ReportScan, region: Region, *, sigma_m: float, known: Matrix | None = None
) -> Intake:
    """Leave out reports far outside the region, and those at exactly a place seen before.

    `sigma_m` holds for reports that bring no covariance; `known` (m, 2) are places of reports of
    the same scan that came earlier. `InputError` for numbers that no report can have.
    """
    scan = _checked(scan)
    variance = np.where(np.isnan(scan.covariance), sigma_m**2, scan.covariance)
    far_x, far_y = _FAR * np.sqrt(variance[:, 0]), _FAR * np.sqrt(variance[:, 2])
    x, y = scan.position[:, 0], scan.position[:, 1]
    inside = (x >= region.x_min - far_x) & (x <= region.x_max + far_x)
    inside &= (y >= region.y_min - far_y) & (y <= region.y_max + far_y)
    fresh = _fresh(scan.position, known)
    keep = inside & fresh
    if not keep.all():
        scan = ReportScan(scan.t_s, scan.position[keep], scan.covariance[keep], scan.number[keep])
    outside = int((~inside).sum())
    return Intake(scan, outside, int((inside & ~fresh).sum()))


def _fresh(position: Matrix, known: Matrix | None) -> NDArray[np.bool_]:
    places = position if known is None else np.concatenate([known, position])
    first = np.unique(places, axis=0, return_index=True)[1]
    fresh = np.zeros(len(places), dtype=bool)
    fresh[first] = True
    return fresh[len(places) - len(position) :]


def _checked(scan: ReportScan) -> ReportScan:
    position = np.ascontiguousarray(scan.position, dtype=np.float64)
    covariance = np.ascontiguousarray(scan.covariance, dtype=np.float64)
    number = np.ascontiguousarray(scan.number, dtype=np.int32)
    n = len(number)
    if number.shape != (n,) or position.shape != (n, 2) or covariance.shape != (n, 3):
        raise InputError(
            "a scan of positions (n, 2), covariances (n, 3) and numbers (n,) expected, "
            f"found {position.shape}, {covariance.shape}, {number.shape}"
        )
    if not math.isfinite(scan.t_s):
        raise InputError(f"a finite time of a scan expected, found {scan.t_s}")
    if not np.isfinite(position).all():
        raise InputError(f"finite positions expected, found some that are not at {scan.t_s} s")
    if n and number.min() < 0:
        raise InputError(f"numbers of reports from 0 on expected, found {number.min()}")
    told = covariance[~np.isnan(covariance).all(axis=1)]
    xx, xy, yy = told[:, 0], told[:, 1], told[:, 2]
    if not (np.isfinite(told).all() and ((xx > 0) & (yy > 0) & (xx * yy > xy**2)).all()):
        raise InputError(f"positive definite covariances (or NaN) expected at {scan.t_s} s")
    return ReportScan(float(scan.t_s), position, covariance, number)
