"""Hand-over of a target to the group that it moves to: a message, and what waits for its track."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from scipy.optimize import (
    linear_sum_assignment,  # pyright: ignore[reportUnknownVariableType]  it has no types
)

from trackfield.association.contract import Estimates
from trackfield.association.model import Targets
from trackfield.hierarchy.estimates import carried
from trackfield.types import Indices, Matrix, Vector

GATE = 16.0
"""Squared distance in 4 dimensions within which two states may be one: missed once in 330 times."""


class Handover(NamedTuple):
    """What a group tells a neighbour of a target that is about to be the neighbour's, Oh IV.B.

    `target` is the target's identity in the whole field; with `t_s` it is the message's own
    identity: a repeated or older message of a target changes nothing.
    """

    target: int
    t_s: float
    existence: float
    mean: Vector  # (4,) x, y, vx, vy
    covariance: Matrix  # (4, 4)
    first_s: float


def estimates_of(messages: Sequence[Handover], t_s: float) -> Estimates:
    """Make estimates of messages that all speak of `t_s`, shown where likelier there than not."""
    n = len(messages)
    existence = np.array([m.existence for m in messages], float)
    return Estimates(
        t_s,
        np.array([m.target for m in messages], np.int32),
        existence,
        np.array([m.mean for m in messages], float).reshape(n, 4),
        np.array([m.covariance for m in messages], float).reshape(n, 4, 4),
        np.array([m.first_s for m in messages], float),
        np.zeros(n, bool),
        existence > 0.5,
    )


def messages_of(known: Estimates, rows: Sequence[int]) -> tuple[Handover, ...]:
    """Make messages of some rows of estimates."""
    return tuple(
        Handover(
            int(known.track[row]),
            known.t_s,
            float(known.existence[row]),
            known.mean[row],
            known.covariance[row],
            float(known.first_s[row]),
        )
        for row in rows
    )


def predicted(message: Handover, t_s: float, *, targets: Targets, step_s: float) -> Handover:
    """Carry a message on to `t_s`."""
    known = estimates_of([message], message.t_s)
    return messages_of(carried(known, t_s, targets=targets, step_s=step_s), [0])[0]


def newest(messages: Sequence[Handover]) -> tuple[Handover, ...]:
    """Keep one message a target, the newest; in the order of the targets."""
    kept: dict[int, Handover] = {}
    for message in messages:
        if message.target not in kept or message.t_s > kept[message.target].t_s:
            kept[message.target] = message
    return tuple(kept[target] for target in sorted(kept))


def claims(pending: Sequence[Handover], found: Estimates) -> list[tuple[int, int]]:
    """Match messages, predicted to the time of `found`, with a group's own tracks.

    Returns pairs of places in `pending` and in `found`. The sum of squared distances
    (x - y)' (P_x + P_y)^-1 (x - y) is least, and none is above the gate.
    """
    if not len(pending) or not found.track.size:
        return []
    told = np.array([message.mean for message in pending])
    doubts = np.array([message.covariance for message in pending])
    return matched(distances2(told, doubts, means=found.mean, covariances=found.covariance))


def matched(costs: Matrix) -> list[tuple[int, int]]:
    """Pair rows and columns of squared distances (n, m) at the least sum, none above the gate."""
    capped = np.minimum(costs, 2.0 * GATE)
    rows, columns = cast("tuple[Indices, Indices]", linear_sum_assignment(capped))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(i, j) for i, j in pairs if costs[i, j] <= GATE]


def distances2(
    means_a: Matrix, covariances_a: Matrix, *, means: Matrix, covariances: Matrix
) -> Matrix:
    """Squared distances (n, m) between states (n, 4) and (m, 4), in their summed covariances."""
    gaps = means_a[:, None] - means[None]
    sums = covariances_a[:, None] + covariances[None]
    solved = np.linalg.solve(sums, gaps[..., None])[..., 0]
    return np.einsum("nmi,nmi->nm", gaps, solved)
