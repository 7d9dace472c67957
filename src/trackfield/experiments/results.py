"""What experiments find, as it is told: tables, and means with intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.types import Vector

RESAMPLES = 2000  # of a bootstrap
Row = tuple[str, ...]


class Table(NamedTuple):
    """A table as it is shown."""

    title: str
    columns: Row
    rows: tuple[Row, ...]


class Interval(NamedTuple):
    """A measured value and its 95 % bootstrap interval."""

    value: float
    low: float
    high: float

    def text(self, digits: int = 2) -> str:
        """Write the value with its interval."""
        return f"{self.value:.{digits}f} ({self.low:.{digits}f} to {self.high:.{digits}f})"


def mean_interval(values: Vector, rng: np.random.Generator) -> Interval:
    """Mean of independent runs (n,), with a bootstrap interval over the runs."""
    picks = rng.integers(0, values.size, (RESAMPLES, values.size))
    low, high = np.quantile(values[picks].mean(axis=1), (0.025, 0.975))
    return Interval(float(values.mean()), float(low), float(high))
