"""Hand-over of a target to the group that it moves to: a message, and what waits for its track."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

    `target` is the target's name in the whole field; with `sender` (a group) and `t_s` it is the
    message's own identity: a repeated or older message changes nothing. `first_s` is when whoever
    gave the name had first seen the target.
    """

    sender: int
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


def messages_of(sender: int, known: Estimates, rows: Sequence[int]) -> tuple[Handover, ...]:
    """Make messages of some rows of estimates."""
    return tuple(
        Handover(
            sender,
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
    moved = carried(known, t_s, targets=targets, step_s=step_s)
    return messages_of(message.sender, moved, [0])[0]


def newest(messages: Sequence[Handover]) -> tuple[Handover, ...]:
    """Keep one message a sender and target, the newest; in the order of senders and targets."""
    kept: dict[tuple[int, int], Handover] = {}
    for message in messages:
        known = kept.get((message.sender, message.target))
        if known is None or message.t_s > known.t_s:
            kept[message.sender, message.target] = message
    return tuple(kept[key] for key in sorted(kept))


def claims(
    messages: Sequence[Handover], found: Estimates, *, bearers: Mapping[int, int]
) -> list[tuple[int, int]]:
    """Match one sender's messages, predicted to the time of `found`, with a group's own tracks.

    Returns pairs of places in `messages` and in `found`. `bearers` (names to places in `found`)
    keep their names while they are within the gate; of the others the sum of squared distances
    (x - y)' (P_x + P_y)^-1 (x - y) is least, and none is above the gate.
    """
    if not len(messages) or not found.track.size:
        return []
    told = np.array([message.mean for message in messages])
    doubts = np.array([message.covariance for message in messages])
    costs = distances2(told, doubts, means=found.mean, covariances=found.covariance)
    for i, message in enumerate(messages):
        place = bearers.get(message.target)
        if place is not None and costs[i, place] <= GATE:
            costs[i, place] = -1e6  # better than any other pairing of all the others
    return matched(costs)


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
