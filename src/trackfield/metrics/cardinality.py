"""How many there are: the number of shown tracks against the number of targets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.metrics.steps import Steps


class Cardinality(NamedTuple):
    """Means over the steps: `cardinality_error` of |m - n|, `cardinality_bias` of m - n.

    n targets are there and m tracks shown; a positive bias is too many tracks.
    """

    cardinality_error: float
    cardinality_bias: float


def cardinality(steps: Steps) -> Cardinality:
    """Compare the number of tracks with the number of targets, step by step."""
    count = steps.t_s.size
    more = (steps.shown.counts(count) - steps.truth.counts(count)).astype(np.float64)
    return Cardinality(float(np.mean(np.abs(more))), float(np.mean(more)))
