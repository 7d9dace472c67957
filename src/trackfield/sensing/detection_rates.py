"""p and q of a front end, measured where it is known when somebody was there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector


class MeasuredRates(NamedTuple):
    """Share of windows that detected, with standard errors: with somebody there, and without.

    `inside` and `outside` count the windows that told.
    """

    p_detection: float
    p_error: float
    p_false: float
    q_error: float
    inside: int
    outside: int


def measured_rates(
    end_s: Vector, detected: NDArray[np.bool_], *, window_s: float, intervals: Matrix
) -> MeasuredRates:
    """Measure p and q of windows that end at `end_s` (k,) and `detected` (k,).

    `intervals` (m, 2) [s] are the times in which a target was in the region, begin and end; windows
    that lie across a border tell nothing. Windows of one visit, or of one pause, hang together: the
    errors are those between visits and between pauses, at least those of independent windows.
    `InputError` where no window lies inside, or none outside.
    """
    if detected.shape != end_s.shape or intervals.ndim != 2 or intervals.shape[1:] != (2,):
        raise InputError(
            f"found detections of shape {detected.shape} at times of shape {end_s.shape}, "
            f"intervals of shape {intervals.shape}: expected (k,), (k,) and (m, 2)"
        )
    if not (intervals[:, 0] < intervals[:, 1]).all():
        raise InputError("intervals: found one that ends before it begins, or a NaN")
    begin, end = intervals[:, 0], intervals[:, 1]
    start_s = end_s - window_s
    within = (start_s[:, None] >= begin - 1e-9) & (end_s[:, None] <= end + 1e-9)
    touched = ((start_s[:, None] < end - 1e-9) & (end_s[:, None] > begin + 1e-9)).any(axis=1)
    inside = within.any(axis=1)
    if not inside.any() or touched.all():
        raise InputError(
            f"found {int(inside.sum())} windows inside the intervals and {int((~touched).sum())} "
            "outside of them, expected some of both"
        )
    visit = np.argmax(within, axis=1)
    pause = np.searchsorted(np.sort(begin), start_s, side="right")
    p, p_error = _share(detected[inside], visit[inside])
    q, q_error = _share(detected[~touched], pause[~touched])
    return MeasuredRates(p, p_error, q, q_error, int(inside.sum()), int((~touched).sum()))


def _share(detected: NDArray[np.bool_], cluster: NDArray[np.intp]) -> tuple[float, float]:
    """Share of ones and its standard error, between clusters or binomial (Jeffreys)."""
    n = detected.size
    share = float(detected.mean())
    smooth = (detected.sum() + 0.5) / (n + 1.0)
    binomial = np.sqrt(smooth * (1.0 - smooth) / (n + 1.0))
    excess = np.bincount(cluster, weights=detected - share)
    return share, float(max(binomial, np.sqrt((excess**2).sum()) / n))
