"""Rows of tracks by hand, and pursuers that follow their orders."""

import numpy as np

from trackfield.types import Status, Tracks


def rows(states, *, t_s, numbers=None, sigma_m=0.3, status=Status.CONFIRMED):
    """Tracks (m, 4) at one time."""
    states = np.asarray(states, float).reshape(-1, 4)
    m = len(states)
    nothing = np.full(m, np.nan)
    numbers = np.arange(1, m + 1) if numbers is None else np.asarray(numbers)
    return Tracks(
        t_s=np.full(m, float(t_s)),
        track=numbers.astype(np.int32),
        position=np.column_stack([states[:, :2], nothing]),
        velocity=np.column_stack([states[:, 2:], nothing]),
        covariance=np.tile([sigma_m**2, 0.0, sigma_m**2], (m, 1)),
        status=np.broadcast_to(np.int32(status), m).copy(),
        target=np.full(m, -1, np.int32),
        nis=nothing,
        target_ids=(),
    )


def carried(states, dt_s):
    states = np.asarray(states, float)
    return np.hstack([states[:, :2] + dt_s * states[:, 2:], states[:, 2:]])
