"""A target's state from a window of readings in which it keeps its velocity, without any prior."""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.localization.motion_modes import MotionFit, Verdict, enough, fit_of, nothing
from trackfield.localization.motion_readings import MotionReadings
from trackfield.localization.motion_search import MotionSearch, extent, maxima
from trackfield.types import Vector

DEFAULT = MotionSearch()


def window_fit(
    given: MotionReadings, *, t_s: float | None = None, search: MotionSearch = DEFAULT
) -> MotionFit:
    """Find all states at `t_s` (left out: at the last reading) that explain a window of readings.

    Bearings, angular rates and motion rates, mixed at will, of one or several times, of sensors
    that stand or move: least squares in standard deviations from many starts, see `motion_search`;
    mirror images and other states that are about as likely come back with their weights, and
    `verdict` says what to think of them. With angular rates of a window, or with sizes of motion
    from several sides of the path, the state is mostly unique.

    Readings of one moment are a window too: `motion_snapshot.locate` is this function.
    """
    if not given.value.size:
        raise InputError("found no readings, expected some")
    middle = float(0.5 * (given.t_s.min() + given.t_s.max()))
    end = float(given.t_s.max()) if t_s is None else t_s
    if not np.isfinite(end):
        raise InputError(f"found t_s = {end}, expected a finite time")
    if not enough(given):
        return nothing(end, Verdict.TOO_FEW)
    if not given.value.any():
        return nothing(end, Verdict.AT_REST)
    about = given.since(middle)
    where = extent(about, search)
    found = fit_of(about, maxima(about, search), where, search=search, t_s=end - middle)
    return found._replace(t_s=end)


def path(fit: MotionFit, t_s: Vector, *, mode: int = 0) -> Vector:
    """Positions (n, d) [m] at times `t_s` (n,) of a target in state `mode` of a fit."""
    state = fit.modes[mode].state
    d = state.size // 2
    return state[:d] + (np.asarray(t_s) - fit.t_s)[:, None] * state[d:]
