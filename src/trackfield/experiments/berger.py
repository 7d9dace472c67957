"""Berger, Choi, Zhou, Willett: trajectories from energy profiles, the paper's figures and ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trackfield.experiments import berger_fusion, berger_local
from trackfield.experiments.berger_fusion_tables import BergerFusion
from trackfield.experiments.berger_local_tables import BergerLocal
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOCAL = 3  # shares of progress that the sensors' side takes


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """What was found: tables, sentences, and the runs behind them."""

    tables: tuple[Table, ...]
    findings: tuple[str, ...]
    local: BergerLocal
    fusion: BergerFusion

    def to_dict(self) -> dict[str, object]:
        """Give tables and findings as plain objects."""
        return {
            "paper": "berger",
            "tables": [table._asdict() for table in self.tables],
            "findings": list(self.findings),
        }

    def figures(self) -> dict[str, Figure]:
        """Draw the paper's figures with Matplotlib, by file name."""
        return {**berger_local.figures(self.local), **berger_fusion.figures(self.fusion)}


def reproduce(
    rng: np.random.Generator,
    *,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Reproduction:
    """Run Figs. 5 to 12: what sensors make of their samples, and the fusion center of theirs.

    `quick` takes a tenth of the runs. `progress` is called with shares from 0 to 1.
    """
    parts, done = _LOCAL + berger_fusion.ticks(), 0

    def tick(count: int = 1) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(min(done / parts, 1.0))

    local = berger_local.run(rng, quick=quick)
    tick(_LOCAL)
    fusion = berger_fusion.run(rng, quick=quick, tick=tick)
    return Reproduction(
        (*berger_local.tables(local), *berger_fusion.tables(fusion)),
        (*berger_local.findings(local), *berger_fusion.findings(fusion)),
        local,
        fusion,
    )
