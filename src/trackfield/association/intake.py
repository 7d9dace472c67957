"""What comes in: scans of reports that can be used, and counts of those that cannot."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield._core import _bernoulli as kernel
from trackfield.association.contract import ReportScan
from trackfield.errors import InputError
from trackfield.raster import Region
from trackfield.types import Matrix

_FAULTS = (
    "",
    "finite positions expected, found some that are not",
    "numbers of reports from 0 on expected, found negative ones",
    "positive definite covariances (or NaN) expected, found others",
)
_NONE_KNOWN = np.zeros((0, 2))


class Intake(NamedTuple):
    """A scan that can be used, and how many of its reports were left out, and why."""

    scan: ReportScan
    outside: int
    duplicate: int


def take_in(
    scan: ReportScan, region: Region, *, sigma_m: float, known: Matrix = _NONE_KNOWN
) -> Intake:
    """Leave out reports over 5 sigmas outside the region, and those at a place seen before.

    `sigma_m` holds for reports that bring no covariance; `known` (m, 2) are places of reports of
    the same scan that came earlier. `InputError` for numbers that no report can have.
    """
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
    fault, keep, outside, duplicate = kernel.take_in(
        position, covariance, number, region, sigma_m**2, known
    )
    if fault:
        raise InputError(f"at {scan.t_s} s: {_FAULTS[fault]}")
    if outside or duplicate:
        kept = keep[0] != 0
        position, covariance, number = position[kept], covariance[kept], number[kept]
    return Intake(ReportScan(float(scan.t_s), position, covariance, number), outside, duplicate)
