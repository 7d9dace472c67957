"""Pham's dissertation: its tables and figures again, chapter by chapter, and ours beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from trackfield.experiments import (
    pham_lifetime,
    pham_robot,
    pham_selection,
    pham_soft,
    pham_tracking,
    pham_uncertainty,
)
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Run(Protocol):
    def __call__(self, rng: np.random.Generator, *, quick: bool = False) -> Any:  # noqa: ANN401
        """Run a chapter's experiments."""
        ...


class _Chapter(NamedTuple):
    """A chapter's experiments, and how what they find is told and drawn."""

    run: _Run
    tables: Callable[[Any], tuple[Table, ...]]
    findings: Callable[[Any], tuple[str, ...]]
    figures: Callable[[Any], dict[str, Figure]]


_CHAPTERS = tuple(
    _Chapter(run, module.tables, module.findings, module.figures)
    for run, module in (
        (pham_tracking.track, pham_tracking),
        (pham_uncertainty.run, pham_uncertainty),
        (pham_selection.run, pham_selection),
        (pham_robot.robot, pham_robot),
        (pham_lifetime.run, pham_lifetime),
        (pham_soft.soft, pham_soft),
    )
)


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """What was found: tables and sentences in the order of the chapters; `drawn` makes figures."""

    tables: tuple[Table, ...]
    findings: tuple[str, ...]
    drawn: tuple[Callable[[], dict[str, Any]], ...]

    def to_dict(self) -> dict[str, object]:
        """Give tables and findings as plain objects."""
        return {
            "paper": "pham",
            "tables": [table._asdict() for table in self.tables],
            "findings": list(self.findings),
        }

    def figures(self) -> dict[str, Figure]:
        """Draw the paper's figures with Matplotlib, by file name."""
        return {name: figure for draw in self.drawn for name, figure in draw().items()}


def reproduce(
    rng: np.random.Generator,
    *,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Reproduction:
    """Run the experiments of all chapters; `quick` takes few runs where the full run takes many.

    `progress` is called with shares from 0 to 1. Every chapter draws from a generator of its own.
    """
    tables: list[Table] = []
    findings: list[str] = []
    drawn: list[Callable[[], dict[str, Figure]]] = []
    for number, (chapter, own) in enumerate(zip(_CHAPTERS, rng.spawn(len(_CHAPTERS)), strict=True)):
        found = chapter.run(own, quick=quick)
        tables += chapter.tables(found)
        findings += chapter.findings(found)
        drawn.append(lambda chapter=chapter, found=found: chapter.figures(found))
        if progress is not None:
            progress((number + 1) / len(_CHAPTERS))
    return Reproduction(tuple(tables), tuple(findings), tuple(drawn))
