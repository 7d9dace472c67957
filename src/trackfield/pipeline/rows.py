"""Rows of tracks from what a tracker of unknown targets believes, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.association.contract import Estimates
from trackfield.types import Status, Tracks, Vector


class Row(NamedTuple):
    """One row of a track: position and velocity [m], [m/s], xx, xy, yy [m^2], a `Status`."""

    t_s: float
    track: int
    x_m: float
    y_m: float
    vx_m_s: float
    vy_m_s: float
    cov_xx: float
    cov_xy: float
    cov_yy: float
    status: int


Shown = dict[int, Row]
"""Last row of each track that has been shown and is not over, by its number."""


class Told(NamedTuple):
    """Rows of one step, the tracks that are on now, and how many began and ended."""

    rows: list[Row]
    shown: Shown
    started: int
    ended: int


def tell(shown: Shown, believed: Estimates) -> Told:
    """Tell a step: what is shown, and once more what was.

    A shown track is confirmed with a report, coasting without. One that is no longer shown, but
    still possible, is tentative; one that is not possible any more has ended, where it was last.
    """
    rows: list[Row] = []
    on: Shown = {}
    for i, number in enumerate(believed.track.tolist()):
        if not believed.shown[i] and number not in shown:
            continue
        if not believed.shown[i]:
            status = Status.TENTATIVE
        elif believed.detected[i]:
            status = Status.CONFIRMED
        else:
            status = Status.COASTING
        P = believed.covariance[i]
        x, y, vx, vy = believed.mean[i].tolist()
        xx, xy, yy = float(P[0, 0]), float(P[0, 1]), float(P[1, 1])
        on[number] = Row(believed.t_s, number, x, y, vx, vy, xx, xy, yy, int(status))
        rows.append(on[number])
    over = [row for number, row in shown.items() if number not in on]
    rows += [row._replace(t_s=believed.t_s, status=int(Status.ENDED)) for row in over]
    return Told(rows, on, len(on) - (len(shown) - len(over)), len(over))


def tracks_of(rows: Sequence[Row]) -> Tracks:
    """Make a table of rows; targets have no names and no heights."""
    table = np.array(rows, np.float64).reshape(-1, len(Row._fields))
    unknown: Vector = np.full(len(rows), np.nan)
    return Tracks(
        t_s=table[:, 0].copy(),
        track=table[:, 1].astype(np.int32),
        position=np.column_stack([table[:, 2:4], unknown]),
        velocity=np.column_stack([table[:, 4:6], unknown]),
        covariance=table[:, 6:9].copy(),
        status=table[:, 9].astype(np.int32),
        target=np.full(len(rows), -1, np.int32),
        nis=unknown,
        target_ids=(),
    )
