"""Cheng, Ghosh, Hu: sensors of motion, the paper's example and what it leaves to be measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trackfield.experiments import cheng_example, cheng_tracking
from trackfield.experiments.cheng_example import Example
from trackfield.experiments.cheng_tracking import ChengTracking
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EXAMPLE = 2  # shares of progress that the example takes


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """What was found: tables, sentences, and the runs behind them."""

    tables: tuple[Table, ...]
    findings: tuple[str, ...]
    example: Example
    tracking: ChengTracking

    def to_dict(self) -> dict[str, object]:
        """Give tables and findings as plain objects."""
        return {
            "paper": "cheng",
            "tables": [table._asdict() for table in self.tables],
            "findings": list(self.findings),
        }

    def figures(self) -> dict[str, Figure]:
        """Draw Figs. 1 to 3 and those of tracking with Matplotlib, by file name."""
        return {**cheng_example.figures(self.example), **cheng_tracking.figures(self.tracking)}


def reproduce(
    rng: np.random.Generator,
    *,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Reproduction:
    """Run Example 5.1 with Figs. 1 to 3, then tracking, switching and silence.

    `quick` takes a tenth of the runs. `progress` is called with shares from 0 to 1.
    """
    parts, done = _EXAMPLE + cheng_tracking.TICKS, 0

    def tick(count: int = 1) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(min(done / parts, 1.0))

    example = cheng_example.run(rng, quick=quick)
    tick(_EXAMPLE)
    tracking = cheng_tracking.run(rng, quick=quick, tick=tick)
    return Reproduction(
        (*cheng_example.tables(example), *cheng_tracking.tables(tracking)),
        (*cheng_example.findings(example), *cheng_tracking.findings(tracking)),
        example,
        tracking,
    )
