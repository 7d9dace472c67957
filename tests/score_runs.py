"""Runs of many targets, small and random: truth and tracks by hand, or as a bad tracker would."""

import numpy as np

from trackfield.types import Status, Tracks, Truth


def make_truth(rows, names=None):
    """Truth of rows (t, target number, x, y)."""
    t, who, x, y = np.array(list(rows), float).reshape(-1, 4).T
    names = names or tuple(f"t{i}" for i in range(int(who.max(initial=-1)) + 1))
    position = np.column_stack([x, y, np.full(t.size, np.nan)])
    return Truth(t, who.astype(np.int32), position, names)


def make_tracks(rows, *, status=None):
    """Tracks without names of rows (t, track number, x, y)."""
    t, track, x, y = np.array(list(rows), float).reshape(-1, 4).T
    n = t.size
    return Tracks(
        t_s=t,
        track=track.astype(np.int32),
        position=np.column_stack([x, y, np.full(n, np.nan)]),
        velocity=np.zeros((n, 3)),
        covariance=np.tile([1.0, 0.0, 1.0], (n, 1)),
        status=np.full(n, Status.CONFIRMED, np.int32) if status is None else np.array(status),
        target=np.full(n, -1, np.int32),
        nis=np.full(n, np.nan),
        target_ids=(),
    )


def random_run(rng, *, targets=6, steps=25, side_m=12.0, lost=0.15, false=3, gaps=True, swap=0.12):
    """Draw targets that walk and cross, and tracks that lose, swap and invent them.

    Rows (t, who, x, y) of truth and of tracks. Without `gaps` a track is shown without a break.
    """
    truth, tracks = [], []
    new = 100
    for who in range(targets):
        start, end = np.sort(rng.choice(steps, 2, replace=False))
        place, velocity = rng.uniform(0, side_m, 2), rng.normal(0, 0.7, 2)
        number = who
        for t in range(start, end + 1):
            place = place + velocity
            if not gaps or rng.random() > 0.08:
                truth.append((t, who, *place))
            if rng.random() < swap:
                number, new = new, new + 1
            if not gaps or rng.random() > lost:
                tracks.append((t, number, *(place + rng.normal(0, 1.0, 2))))
    for i in range(false):
        start, length = int(rng.integers(steps)), int(rng.integers(1, 8))
        place = rng.uniform(0, side_m, 2)
        tracks += [
            (t, 1000 + i, *(place + rng.normal(0, 0.5, 2)))
            for t in range(start, min(start + length, steps))
        ]
    return truth, tracks
