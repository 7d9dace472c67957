"""Whether sensors stand so that a position follows from their ranges."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.network.site import Site
from trackfield.types import Matrix

FLAT = 1e-3  # a field thinner than this share of its length is a line


class Geometry(NamedTuple):
    """What the places of some sensors allow.

    `problems` make positions impossible or ambiguous everywhere; `remarks` only in some sites.
    `span_m` is the diagonal of the field.
    """

    problems: tuple[str, ...]
    remarks: tuple[str, ...]
    span_m: float


def geometry(site: Site, sensors: tuple[str, ...] | None = None) -> Geometry:
    """Judge the places of all sensors of a site, or of those named, as of ranges.

    Fewer than three sensors leave a target two places to be, and so does a line of them: the two
    are mirror images, and no filter can tell them apart.
    """
    ids = site.sensor_ids if sensors is None else sensors
    place = {sensor_id: i for i, sensor_id in enumerate(site.sensor_ids)}
    positions = site.positions[[place[sensor_id] for sensor_id in ids]]
    plane = positions[:, :2]
    some = ", ".join(ids[:8]) + (", ..." if len(ids) > 8 else "")
    problems: list[str] = []
    remarks: list[str] = []
    if len(ids) < 3:
        problems.append(f"found {len(ids)} sensors ({some or 'none'}), expected at least 3")
    elif thinness(plane) < FLAT:
        problems.append(
            f"found all {len(ids)} sensors ({some}) on a line, expected one beside it: "
            "a target and its mirror image look the same"
        )
    solid = site.target.dimensions == 3 and len(ids) > 0
    if solid and (len(ids) < 4 or thinness(positions) < FLAT):
        remarks.append(
            f"all {len(ids)} sensors stand in one plane: heights above and below it look the "
            "same, and heights near it are uncertain"
        )
    span = float(np.linalg.norm(np.ptp(plane, axis=0))) if len(ids) else 0.0
    return Geometry(tuple(problems), tuple(remarks), span)


def geometry_problems(site: Site) -> list[str]:
    """Say what makes positions impossible or ambiguous everywhere on a site."""
    return list(geometry(site).problems)


def thinness(points: Matrix) -> float:
    """Least over greatest extent of `points` (n, d): 0 if they lie on a line (2-D) or plane."""
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(values[-1] / values[0]) if values[0] > 0.0 else 0.0
