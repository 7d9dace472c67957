"""Oh, Schenato, Chen, Sastry (LochNess): the paper's figures again, and what its claims rest on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import (
    oh_fig4,
    oh_fig678,
    oh_findings,
    oh_network,
    oh_pursuit,
    oh_sweeps,
    oh_walkers,
)
from trackfield.experiments.oh_fig4 import Fig4
from trackfield.experiments.oh_network import CONTEST, OURS, USUAL, Outcome
from trackfield.experiments.oh_pursuit import Pursued
from trackfield.experiments.oh_sweeps import Sweeps
from trackfield.experiments.oh_walkers import Walkers
from trackfield.experiments.results import Table, mean_interval
from trackfield.metrics.many import ManyScore
from trackfield.types import Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAG_STEPS = 5


class Size(NamedTuple):
    """How much a reproduction runs: samples of Fig. 4, worlds and runs of the others."""

    samples: int
    fits: int
    worlds: int
    sweep_worlds: int
    thin: int  # of the settings of the sweeps, every so many
    steps: int  # of a world
    walks: int  # runs of each number of walkers


FULL = Size(6000, 300, 10, 3, 1, 100, 12)
QUICK = Size(100, 10, 1, 1, 4, 30, 1)
_FIRST_WORLD, _FIRST_WALK, _FIRST_PURSUIT = 20, 7000, 9000  # seeds


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """What was found: tables, sentences, and the runs behind them.

    `network` holds the outcomes of Fig. 10 by tracker, one a world.
    """

    tables: tuple[Table, ...]
    findings: tuple[str, ...]
    fig4: Fig4
    scans: oh_fig678.Reproduction
    network: Mapping[str, Sequence[Outcome]]
    sweeps: Sweeps
    walkers: Walkers
    pursued: Pursued

    def to_dict(self) -> dict[str, object]:
        """Give tables and findings as plain objects."""
        return {
            "paper": "oh",
            "tables": [table._asdict() for table in self.tables],
            "findings": list(self.findings),
        }

    def figures(self) -> dict[str, Figure]:
        """Draw the paper's figures with Matplotlib, by file name."""
        from trackfield.experiments.oh_figures import figures

        return figures(self)


def reproduce(
    rng: np.random.Generator,
    *,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Reproduction:
    """Run Figs. 4, 6-8, 10-12, 17-19 and the sweeps of loss, delay, misplaced sensors and moves.

    `quick` takes one short world where the full run takes ten. `progress` is called with shares
    from 0 to 1. Worlds have seeds of their own; `rng` draws the rest.
    """
    size = QUICK if quick else FULL
    tick = _Ticker(progress, 5 + size.worlds + oh_sweeps.settings(size.thin) + 3 * size.walks)
    fig4 = oh_fig4.fig4(size.samples, fits=size.fits)
    tick()
    scans = oh_fig678.reproduce(rng, quick=quick)
    tick()
    seeds = range(_FIRST_WORLD, _FIRST_WORLD + size.worlds)
    network = _network(seeds, size.steps, tick)
    worlds = oh_sweeps.Worlds(seeds[: size.sweep_worlds], size.steps)
    sweeps = oh_sweeps.sweeps(worlds, rng, thin=size.thin, tick=tick)
    walkers = oh_walkers.walkers(rng, runs=size.walks, first_seed=_FIRST_WALK, tick=tick)
    chased = oh_pursuit.pursued(quick=quick, first_seed=_FIRST_PURSUIT, tick=tick)
    tables = (
        _fig4_table(fig4),
        *scans.tables,
        _messages_table(network),
        _network_table(network, rng),
        *oh_sweeps.tables(sweeps),
        oh_walkers.table(walkers, size.walks),
        *oh_pursuit.tables(chased),
    )
    findings = (
        *scans.findings,
        *oh_findings.findings(fig4, network, sweeps, walkers),
        *oh_pursuit.findings(chased),
    )
    return Reproduction(tables, findings, fig4, scans, network, sweeps, walkers, chased)


def _network(
    seeds: Sequence[int], steps: int, tick: Callable[[], None]
) -> dict[str, list[Outcome]]:
    """Track every world of Fig. 10 in every way; ours with a lag too."""
    outcomes: dict[str, list[Outcome]] = {tracker.name: [] for tracker in CONTEST}
    for seed in seeds:
        fields = {
            fusion: oh_network.field(fusion, seed, steps=steps) for fusion in oh_network.FUSIONS
        }
        for tracker in CONTEST:
            lag = LAG_STEPS if tracker is OURS else 0
            made = fields[tracker.fusion]
            outcomes[tracker.name].append(oh_network.run(tracker, made, USUAL, lag_steps=lag))
        tick()
    return outcomes


def _fig4_table(found: Fig4) -> Table:
    rows = tuple(
        (
            f"{r:g}",
            f"{paper:.3f}",
            f"{rule:.4f} +- {error:.4f}",
            f"{100 * (rule / paper - 1):+.1f} %",
            f"{fit:.4f} +- {fit_error:.4f}",
            f"{100 * missed:.1f} %",
        )
        for r, paper, rule, error, fit, fit_error, missed in zip(*found, strict=True)
    )
    columns = ("R_s", "paper", "its rule, here", "against the paper", "source fit", "fit misses")
    return Table("Fig. 4: mean error of one target's report [sensor spacings]", columns, rows)


def _messages_table(network: Mapping[str, Sequence[Outcome]]) -> Table:
    """Count messages of the paper's fusion, beside the paper's own counts."""
    runs = network[CONTEST[0].name]
    sent = np.array([run.passed.sent for run in runs], float)
    lost = np.array([run.passed.lost for run in runs], float)
    delayed = np.array([run.passed.delayed for run in runs], float)
    false = np.array([run.false for run in runs], float)
    rows = (
        ("reports", "1174", _spread(sent)),
        ("lost", "319", _spread(lost)),
        ("received", "855", _spread(sent - lost)),
        ("delayed, of those received", "449", _spread(delayed)),
        ("false, of those received", "603 of all", _spread(false)),
    )
    return Table("Fig. 10: messages of a run, mean (least to most)", ("", "paper", "here"), rows)


def _network_table(network: Mapping[str, Sequence[Outcome]], rng: np.random.Generator) -> Table:
    rows: list[tuple[str, ...]] = []
    for name, runs in network.items():
        rows.append((name, *_cells([run.live for run in runs], rng)))
        lagged = [run.lagged for run in runs if run.lagged is not None]
        if lagged:
            rows.append((f"{name}, {LAG_STEPS} steps later", *_cells(lagged, rng)))
    columns = ("tracker", "GOSPA [m]", "missed", "false", "switches", "MOTA")
    worlds = len(next(iter(network.values())))
    return Table(f"Fig. 10: live tracks of {worlds} worlds (c 5, p 2)", columns, tuple(rows))


def _cells(scores: Sequence[ManyScore], rng: np.random.Generator) -> tuple[str, ...]:
    """Write GOSPA, missed, false, switches and MOTA, with intervals over the worlds."""
    columns = (
        ([score.sets.gospa_m for score in scores], 2),
        ([score.sets.missed for score in scores], 2),
        ([score.sets.false for score in scores], 2),
        ([score.clear_mot.switches for score in scores], 1),
        ([score.clear_mot.mota or 0.0 for score in scores], 2),
    )
    return tuple(
        mean_interval(np.array(values, float), rng).text(digits) for values, digits in columns
    )


def _spread(values: Vector) -> str:
    return f"{values.mean():.0f} ({values.min():.0f} to {values.max():.0f})"


class _Ticker:
    """Counts the parts that are done."""

    def __init__(self, progress: Callable[[float], None] | None, parts: int) -> None:
        self.progress = progress
        self.parts = parts
        self.done = 0

    def __call__(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(min(self.done / self.parts, 1.0))
