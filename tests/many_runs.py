"""Small made-up runs of many targets, as tables, for tests of what is drawn, scored and written."""

from __future__ import annotations

import numpy as np

from trackfield.types import Reports, Status, Tracks, Truth


def crossing(steps: int = 20) -> tuple[Tracks, Truth, Reports]:
    """Two targets that cross; the second one's track changes its identity half-way.

    Tracks begin at step 2 and are a decimetre off; every fifth row of the second is coasting, and
    one tentative row of a third track stands far away.
    """
    t = np.repeat(np.arange(steps, dtype=float), 2)
    target = np.tile(np.array([0, 1], np.int32), steps)
    x = 5.0 + t
    y = np.where(target == 0, 10.0 + t, 30.0 - t)
    truth = Truth(t, target, np.column_stack([x, y, np.full(t.size, np.nan)]), ("a", "b"))
    kept = t >= 2.0
    late = (target == 1) & (t >= steps / 2)
    status = np.where((target == 1) & (t % 5 == 0), Status.COASTING, Status.CONFIRMED)
    tracks = tracks_of(
        np.append(t[kept], 3.0),
        np.append((target + 1 + late)[kept], 9),
        np.vstack([np.column_stack([x, y])[kept] + 0.1, [[90.0, 90.0]]]),
        status=np.append(status[kept], Status.TENTATIVE),
    )
    nothing = np.full(t.size, np.nan)
    reports = Reports(
        t, nothing, np.column_stack([x, y, nothing]), np.full((t.size, 3), np.nan), nothing
    )
    return tracks, truth, reports


def tracks_of(t_s: object, track: object, position: object, *, status: object = None) -> Tracks:
    """Tracks of times, identities and places (n, 2), confirmed if no `status` says else."""
    times = np.asarray(t_s, float)
    n = times.size
    places = np.asarray(position, float).reshape(n, 2)
    shown = np.full(n, Status.CONFIRMED) if status is None else np.asarray(status)
    return Tracks(
        t_s=times,
        track=np.asarray(track, np.int32),
        position=np.column_stack([places, np.full(n, np.nan)]),
        velocity=np.column_stack([np.ones((n, 2)), np.full(n, np.nan)]),
        covariance=np.tile([0.04, 0.01, 0.09], (n, 1)),
        status=shown.astype(np.int32),
        target=np.full(n, -1, np.int32),
        nis=np.full(n, np.nan),
        target_ids=(),
    )
