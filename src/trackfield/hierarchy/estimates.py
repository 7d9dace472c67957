"""Estimates as tables: some rows of one, several joined, one carried on in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import Estimates
from trackfield.association.model import Targets
from trackfield.motion import SteppedAcceleration


def selected(known: Estimates, rows: NDArray[np.intp]) -> Estimates:
    """Take some rows of estimates, in that order."""
    return Estimates(
        t_s=known.t_s,
        track=known.track[rows],
        existence=known.existence[rows],
        mean=known.mean[rows],
        covariance=known.covariance[rows],
        first_s=known.first_s[rows],
        detected=known.detected[rows],
        shown=known.shown[rows],
    )


def joined(parts: Sequence[Estimates], t_s: float) -> Estimates:
    """Put estimates of `t_s` one after the other."""
    return Estimates(
        t_s=t_s,
        track=np.concatenate([np.zeros(0, np.int32), *(part.track for part in parts)]),
        existence=np.concatenate([np.zeros(0), *(part.existence for part in parts)]),
        mean=np.concatenate([np.zeros((0, 4)), *(part.mean for part in parts)]),
        covariance=np.concatenate([np.zeros((0, 4, 4)), *(part.covariance for part in parts)]),
        first_s=np.concatenate([np.zeros(0), *(part.first_s for part in parts)]),
        detected=np.concatenate([np.zeros(0, bool), *(part.detected for part in parts)]),
        shown=np.concatenate([np.zeros(0, bool), *(part.shown for part in parts)]),
    )


def carried(known: Estimates, t_s: float, *, targets: Targets, step_s: float) -> Estimates:
    """Carry estimates on to `t_s`, step by step, without a report; unchanged if as new already."""
    steps = max(0, round((t_s - known.t_s) / step_s))
    if not steps:
        return known
    motion = SteppedAcceleration((targets.accel_sigma_m_s2**2,) * 2)
    turn, noise = motion.transition(step_s), motion.noise(step_s)
    mean, covariance = known.mean, known.covariance
    for _ in range(steps):
        mean, covariance = mean @ turn.T, turn @ covariance @ turn.T + noise
    survival = float(np.exp(-steps * step_s / targets.lifetime_s))
    return known._replace(
        t_s=t_s,
        existence=known.existence * survival,
        mean=mean,
        covariance=covariance,
        detected=np.zeros(len(known.track), bool),
    )
