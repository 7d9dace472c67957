"""What a run says of its own region and step, for sites that leave them open."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from trackfield.errors import InputError
from trackfield.network.site import Site
from trackfield.pipeline.scene import watched
from trackfield.raster import Region
from trackfield.types import Matrix, Readings, Reports, Vector

_SAMPLE = 1 << 16  # reports of which the region is made, and rows for the step, at most
_WILD = 5e-4  # share of the reports, on each side of each axis, that may be anywhere
_MARGIN = 0.05  # of the region's sides, beyond the outermost reports
_LEAST_M = 1.0
_DIGITS = 9


def settled(site: Site, tables: Iterable[Reports | Readings]) -> Site:
    """Derive the site's region and step from a run where they are not told.

    The step is the usual time between the times that occur; the region holds all but one in two
    thousand reports on each side, or, of readings, the sensors. A site that tells both is handed
    back, and the run not looked at. `InputError` for a run without a row.
    """
    told = site.reports
    if told.step_s is not None and told.region is not None:
        return site
    times, places, every = np.empty(0), np.empty((0, 2)), 1
    for table in tables:
        times = np.concatenate([times, table.t_s[: _SAMPLE - times.size]])
        if isinstance(table, Reports):
            places = np.concatenate([places, table.position[::every, :2]])
        if len(places) > _SAMPLE:
            places, every = places[::2], 2 * every
    if not times.size:
        raise InputError("found no rows, expected at least one to derive region and step from")
    step_s = usual_step(times) if told.step_s is None else told.step_s
    if told.region is not None:
        region = told.region
    else:
        region = spanned(places) if len(places) else watched(site)
    return replace(site, reports=replace(told, region=region, step_s=step_s))


def usual_step(t_s: Vector) -> float:
    """Find the time between scans [s]: the median of the gaps between times, then their mean.

    A gap of several steps counts as so many. One second where there is one time only.
    """
    gaps = np.diff(np.unique(t_s[np.isfinite(t_s)]))
    if not gaps.size:
        return 1.0
    middle = float(np.median(gaps))
    steps = np.rint(gaps / middle)
    step = float(gaps[steps >= 1.0].sum() / steps[steps >= 1.0].sum())
    return float(f"{step:.{_DIGITS}g}")


def spanned(positions: Matrix) -> Region:
    """Span a region by reports (n, 2) [m], but for the outermost; with a margin."""
    low = np.quantile(positions, _WILD, axis=0, method="higher")
    high = np.quantile(positions, 1.0 - _WILD, axis=0, method="lower")
    low, high = np.minimum(low, high), np.maximum(low, high)  # of two reports
    margin = np.maximum(_MARGIN * (high - low), _LEAST_M)
    return Region(*(low - margin).tolist(), *(high + margin).tolist())
