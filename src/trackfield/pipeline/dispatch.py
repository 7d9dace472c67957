"""Which operator serves which data."""

from __future__ import annotations

import numpy as np

from trackfield.errors import InputError
from trackfield.pipeline.fronts import Source, Table
from trackfield.pipeline.untagged import Feed
from trackfield.types import Readings, Reports


def feed_of(table: Table, *, seed: int = 0) -> Feed | None:
    """Tell by the first rows of a run how it is tracked; None for tagged ranges.

    Binary sensors that say 0 at all say it always.
    """
    source = source_of(table)
    if source is None:
        return None
    says_zero = (
        source == "detection" and isinstance(table, Readings) and bool(np.any(table.value == 0.0))
    )
    return Feed(source, seed, says_zero)


def source_of(table: Table) -> Source | None:
    """Tell what a table of a run is; None for tagged ranges, which `Tracker` takes.

    `InputError` where there are several kinds of readings: they are tracked one kind at a time.
    """
    if isinstance(table, Reports):
        return "reports"
    present = [table.kinds[int(kind)] for kind in np.unique(table.kind)]
    match present:
        case [] | ["range"]:
            return None
        case ["signal"]:
            return "signal"
        case ["detection"]:
            return "detection"
        case [kind]:
            raise InputError(f"found readings of kind {kind!r}, which no tracker takes yet")
        case _:
            raise InputError(
                f"found readings of kinds {', '.join(present)}, expected one kind: "
                "they are tracked one kind at a time"
            )
