"""Identities over the whole run: each target has one track at most, and each track one target."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.matching import cheapest
from trackfield.metrics.steps import Pairs, Steps


class Identity(NamedTuple):
    """IDF1 = 2 IDTP / (rows of the truth + rows shown), IDP = IDTP / shown, IDR = IDTP / truth.

    IDTP is the most steps at which targets and tracks can be near each other when identities are
    assigned one to one for the whole run. A share of nothing is None.
    """

    idf1: float | None
    idp: float | None
    idr: float | None


def identity(steps: Steps, near: Pairs) -> Identity:
    """Score identities; `near` are pairs close enough to be the same. Ristani et al. (2016)."""
    who = steps.truth.who[near.truth].astype(np.int64), steps.shown.who[near.shown]
    pairs, together = np.unique(who[0] * steps.tracks + who[1], return_counts=True)
    target, track = np.divmod(pairs, max(steps.tracks, 1))
    true = int(together[cheapest(target, track, -together.astype(np.float64), alone=0.0)].sum())
    rows, shown = steps.truth.who.size, steps.shown.who.size
    return Identity(
        idf1=2.0 * true / (rows + shown) if rows + shown else None,
        idp=true / shown if shown else None,
        idr=true / rows if rows else None,
    )
