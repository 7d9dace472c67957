"""Pham, chapter 2: Table 2.1 and Figs. 2.4-2.11, the paper's rules and ours."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import (
    pham_masters,
    pham_passage,
    pham_sink,
    pham_sweeps,
    pham_table21,
    pham_tracking_findings,
)
from trackfield.experiments.pham_masters import Reign, Rule
from trackfield.experiments.pham_passage import Passage
from trackfield.experiments.pham_sink import Service
from trackfield.experiments.pham_sweeps import HandOvers, Setting, Sweep, Traces
from trackfield.experiments.pham_table21 import PRINTED, RATIO, SIGMA_M, Found, Scattered
from trackfield.experiments.results import Table
from trackfield.types import Matrix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BATTERIES_J = (5.0, 10.0, 20.0, 50.0)
MARGINS = (0.0, pham_masters.MARGIN)
SPEEDS_M_S = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
NOISES_M = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)


class PhamTracking(NamedTuple):
    """Everything of chapter 2; `tables`, `findings` and `figures` tell it.

    `reigns` holds a battery [J] and who was master without a margin and with it.
    """

    way: Passage
    nodes: Matrix
    rows: tuple[Found, ...]
    scattered: Scattered
    speeds: Sweep
    noises: Sweep
    noisy: tuple[Traces, Traces]
    smooth: Traces
    alone: Traces
    hand_overs: tuple[HandOvers, ...]
    reigns: tuple[tuple[float, Reign, Reign], ...]
    services: tuple[Service, ...]


def track(rng: np.random.Generator, *, quick: bool = False) -> PhamTracking:
    """Run all of chapter 2; `quick` with one draw of the noise where the full run takes eight."""
    runs, thin = (1, 6) if quick else (8, 1)
    way, nodes = pham_passage.passage(), pham_passage.square()
    fast = pham_passage.passage(3.0)
    speeds = [Setting(u, SIGMA_M, pham_passage.passage(u)) for u in SPEEDS_M_S[::thin]]
    noises = [Setting(sigma, sigma, fast) for sigma in NOISES_M[::thin]]

    def masters(margin: float, joules: float) -> Reign:
        rule = Rule(margin=margin, battery_j=joules)
        return pham_sweeps.first_row_reign(way, nodes, rule)

    reigns = tuple(
        (joules, masters(MARGINS[0], joules), masters(MARGINS[1], joules))
        for joules in ((pham_masters.BATTERY_J,) if quick else BATTERIES_J)
    )
    usual = next(row for row in reigns if row[0] == pham_masters.BATTERY_J)
    return PhamTracking(
        way=way,
        nodes=nodes,
        rows=pham_table21.rows(way, nodes, runs=runs, rng=rng),
        scattered=pham_table21.scattered(way, rng),
        speeds=pham_sweeps.sweep(speeds, 6.3, runs=runs, rng=rng),
        noises=pham_sweeps.sweep(noises, 6.5, runs=runs, rng=rng),
        noisy=(
            pham_sweeps.traces(fast, 6.5, sigma_m=0.5, rng=rng),
            pham_sweeps.traces(fast, 6.5, sigma_m=0.04, rng=rng),
        ),
        smooth=pham_sweeps.traces(way, 4.5, rng=rng),
        alone=pham_sweeps.traces(way, 7.6, alone=True, rng=rng),
        hand_overs=pham_sweeps.hand_overs(
            way, nodes, reigns=list(zip(MARGINS, usual[1:], strict=True)), runs=runs, rng=rng
        ),
        reigns=reigns,
        services=tuple(
            pham_sink.serve(pham_passage.beginning(way, 150 if quick else 2000), nodes, policy)
            for policy in pham_sink.POLICIES
        ),
    )


def findings(found: PhamTracking) -> tuple[str, ...]:
    """Say what the tables come to, and what could not be recovered from the paper."""
    return pham_tracking_findings.findings(found)


def tables(found: PhamTracking) -> tuple[Table, ...]:
    """Table 2.1 with the paper's numbers beside ours, its radii, sweeps and hand-overs."""
    return (
        _table21(found),
        _radii(found),
        _sweep("Fig. 2.6: error against mean speed [m/s], 6.3 nodes", found.speeds),
        _sweep("Fig. 2.7: error against noise of ranges [m], 6.5 nodes", found.noises),
        _scattered(found.scattered),
        _masters(found),
        _sharing(found),
        _services(found.services),
    )


def figures(found: PhamTracking) -> dict[str, Figure]:
    """Draw Figs. 2.4-2.11 with Matplotlib, by file name without its suffix."""
    from trackfield.experiments.pham_tracking_figures import figures as drawn

    return drawn(found)


def _table21(found: PhamTracking) -> Table:
    lines = tuple(
        (
            f"{paper.measured:.1f} / {here.measured:.1f}",
            f"{paper.active:.1f} / {here.active:.1f}",
            f"{1e3 * paper.plain_m2:.2f} / {1e3 * here.plain_m2:.2f}",
            f"{1e3 * paper.kalman_m2:.2f} / {1e3 * here.kalman_m2:.2f}",
            f"{1e3 * here.ranges_m2:.3f}",
            f"{1e-5 * paper.power_mw:.2f} / {1e-5 * here.power_mw:.2f}",
            f"{100.0 * (here.power_mw / paper.power_mw - 1.0):+.2f} %",
        )
        for paper, here in zip(PRINTED, found.rows, strict=True)
    )
    columns = (
        "measuring, paper / here",
        "active",
        "variance without filter [1e-3 m^2]",
        "with Pham's filter",
        "with ours, on ranges",
        "power with 56 W [1e5 mW]",
        "against the paper",
    )
    return Table("Table 2.1: one passage of 2000 cycles", columns, lines)


def _radii(found: PhamTracking) -> Table:
    lines = tuple(
        (
            f"{paper.measuring_m:.3f}",
            f"{paper.zone.near_m:.3f}",
            f"{paper.far_m:.3f}",
            f"{paper.far_m / paper.measuring_m:.3f}",
            f"{paper.active:.1f}",
            f"{here.same_ratio:.1f}",
        )
        for paper, here in zip(PRINTED, found.rows, strict=True)
    )
    columns = ("R_a [m]", "R_1", "R_2", "R_2 / R_a", "active, paper", f"if R_2 = {RATIO} R_a")
    return Table("Table 2.1: the radii that its counts ask for", columns, lines)


def _sweep(title: str, found: Sweep) -> Table:
    lines = tuple(
        (f"{setting:g}", *(f"{value:.4f}" for value in values))
        for setting, *values in zip(*found, strict=True)
    )
    columns = ("setting", "trilateration [m]", "Pham's filter [m]", "ours, on ranges [m]")
    return Table(title, columns, lines)


def _scattered(found: Scattered) -> Table:
    lines = tuple(
        (
            f"{count:g}",
            f"{1e-5 * power.mean():.2f}",
            f"{1e-5 * power.std():.3f}",
            f"{100.0 * blind:.0f} %",
        )
        for count, power, blind in zip(
            pham_table21.SCATTERED, found.cycle_mw, found.blind, strict=True
        )
    )
    columns = ("measuring", "power [1e5 mW]", "its deviation", "cycles with fewer than three")
    return Table("Fig. 2.11: nodes anywhere", columns, lines)


def _masters(found: PhamTracking) -> Table:
    lines = tuple(
        (
            f"{joules:g}",
            f"{wild.hand_overs} / {calm.hand_overs}",
            f"{wild.forced} / {calm.forced}",
            f"{wild.residual.min():.3f} / {calm.residual.min():.3f}",
            f"{wild.messages_j:.2f} / {calm.messages_j:.2f}",
        )
        for joules, wild, calm in found.reigns
    )
    columns = (
        "battery [J]",
        f"hand-overs, margin {MARGINS[0]:g} / {MARGINS[1]:g}",
        "of them forced",
        "least residual",
        "messages [J]",
    )
    return Table(f"Masters over 2000 cycles, alpha {pham_masters.ALPHA:g}", columns, lines)


def _sharing(found: PhamTracking) -> Table:
    lines = tuple(
        (
            f"{one.margin:g}",
            f"{one.reign.hand_overs}",
            f"{one.shared_m:.4f}",
            f"{one.alone_m:.4f}",
        )
        for one in found.hand_overs
    )
    columns = ("margin", "hand-overs", "RMSE, state shared [m]", "RMSE, not shared [m]")
    return Table("Scenario 5: whether the filter's state travels", columns, lines)


def _services(found: tuple[Service, ...]) -> Table:
    lines = tuple(
        (
            one.policy.name,
            f"{one.hand_overs}",
            f"{one.arrived} / {one.lost}",
            f"{one.mean_hops:.1f}",
            f"{one.messages_j:.1f}",
            f"{sum(one.found.totals_j.values()):.0f}",
            f"{(one.found.residual_j / one.found.battery_j).min():.2f}",
        )
        for one in found
    )
    columns = (
        "master by",
        "hand-overs",
        "reports arrived / lost",
        "hops of a report",
        "messages [J]",
        "all [J]",
        "least residual",
    )
    title = f"What a sink at the corner gets, batteries of {pham_sink.BATTERY_J:g} J"
    return Table(title, columns, lines)
