"""Targets that stand still: angular rates and motion are nothing then, wherever the target is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trackfield.filtering.angle_readings import AngleSensors, Says, chosen
from trackfield.filtering.scans import Scan

_SCANS = 8  # by which rest is judged
_DEVIATIONS = 2.0  # of chi-square above its mean that rest may leave


def rests(recent: Sequence[Scan], sensors: AngleSensors) -> bool:
    """Whether the last scans are as at rest, and some are of motion, none of bearings.

    Motion has no sign: which way a target goes on after a rest is not known.
    """
    rows, value, sigma = (np.concatenate([scan[k] for scan in recent[-_SCANS:]]) for k in (1, 2, 3))
    heard = chosen(sensors, rows, sigma)
    if np.any(heard.says == Says.BEARING) or not np.any(heard.says == Says.MOTION):
        return False
    square = float(((value / heard.sigma) ** 2).sum())
    return square < value.size + _DEVIATIONS * math.sqrt(2.0 * value.size)
