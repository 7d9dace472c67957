"""Pham, chapter 2: Table 2.1 and Figs. 2.4-2.11, the paper's rules and ours."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import pham_masters, pham_passage, pham_sweeps, pham_table21
from trackfield.experiments.pham_masters import Reign, Rule
from trackfield.experiments.pham_passage import Passage
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


class Tracking(NamedTuple):
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


def track(rng: np.random.Generator, *, quick: bool = False) -> Tracking:
    """Run all of chapter 2; `quick` with one draw of the noise where the full run takes eight."""
    runs, thin = (1, 6) if quick else (8, 1)
    way, nodes = pham_passage.passage(), pham_passage.square()
    fast = pham_passage.passage(3.0)
    speeds = [Setting(u, SIGMA_M, pham_passage.passage(u)) for u in SPEEDS_M_S[::thin]]
    noises = [Setting(sigma, sigma, fast) for sigma in NOISES_M[::thin]]

    def masters(margin: float, joules: float) -> Reign:
        rule = Rule(margin=margin, battery_j=joules)
        return pham_sweeps.first_row_reign(way, nodes, rule)

    return Tracking(
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
        hand_overs=pham_sweeps.hand_overs(way, nodes, margins=MARGINS, runs=runs, rng=rng),
        reigns=tuple(
            (joules, masters(MARGINS[0], joules), masters(MARGINS[1], joules))
            for joules in (BATTERIES_J[1:2] if quick else BATTERIES_J)
        ),
    )


def tables(found: Tracking) -> tuple[Table, ...]:
    """Table 2.1 with the paper's numbers beside ours, its radii, sweeps and hand-overs."""
    return (
        _table21(found),
        _radii(found),
        _sweep("Fig. 2.6: error against mean speed [m/s], 6.3 nodes", found.speeds),
        _sweep("Fig. 2.7: error against noise of ranges [m], 6.5 nodes", found.noises),
        _scattered(found.scattered),
        _masters(found),
        _sharing(found),
    )


def findings(found: Tracking) -> tuple[str, ...]:
    """Say what the tables come to, and what could not be recovered from the paper."""
    rows = found.rows
    power = max(
        abs(here.power_mw / paper.power_mw - 1.0) for here, paper in zip(rows, PRINTED, strict=True)
    )
    ratio = max(
        abs(here.same_ratio / paper.active - 1.0) for here, paper in zip(rows, PRINTED, strict=True)
    )
    gain = [row.plain_m2 / row.kalman_m2 for row in rows]
    better = [row.kalman_m2 / row.ranges_m2 for row in rows]
    wild, calm = found.hand_overs
    return (
        "Table 2.1, counts: x(t) = 5 - 5 cos(pi t / 10) and the radii below give every printed "
        "count of measuring and of active sensors to its last digit. The paper prints neither x(t) "
        "nor radii. One ratio R_2 = 1.8 R_a for all rows gives the measuring sensors as exactly, "
        f"the active ones within {100 * ratio:.1f} %; no common pair of ratios and angle was "
        "found that gives all five.",
        f"Table 2.1, power: (2.31) plus 56 W is within {100 * power:.2f} % of every printed value; "
        "what the 56 W are the text does not say.",
        "Table 2.1, errors without the filter: could not be recovered. With ranges of sigma .2 the "
        "variance of trilateration falls as one over the number of sensors "
        f"({_row_of(rows, 'plain_m2')} e-3); the printed column falls as one over its root, as a "
        "standard deviation would, and rises again in the last row; the text says 21.71 where the "
        "table says 24.71.",
        "Table 2.1, errors with the filter: the state noise .01 is read as printed in (2.32), on "
        f"position and velocity both, each cycle ({_row_of(rows, 'kalman_m2')} e-3; printed "
        f"{1e3 * PRINTED[0].kalman_m2:.2f} to {1e3 * PRINTED[-1].kalman_m2:.2f} e-3). The gain "
        f"over no filter is {min(gain):.0f} to {max(gain):.0f} times in variance (paper "
        f"{PRINTED[0].plain_m2 / PRINTED[0].kalman_m2:.0f} to "
        f"{PRINTED[-1].plain_m2 / PRINTED[-1].kalman_m2:.0f}).",
        "A filter on the ranges themselves, without trilateration, has "
        f"{min(better):.1f} to {max(better):.1f} times less variance than Pham's on the same "
        "readings.",
        "Figs. 2.6, 2.7: error grows with speed and with noise, as the paper says; its curves are "
        "pictures without numbers in the text. At 3 m/s, where the target turns within 4.4 m/s^2, "
        "Pham's filter lags so much that it errs by "
        f"{_worst(found.noises):.2f} times what trilateration alone does, at worst.",
        f"Hand-overs, alpha {pham_masters.ALPHA:g}, batteries of {pham_masters.BATTERY_J:g} J: "
        f"{wild.reign.hand_overs} in 2000 cycles by the paper's rule, {calm.reign.hand_overs} with "
        f"a margin of {calm.margin:g}, at the same error ({wild.shared_m:.3f} m) where the state "
        f"travels. Told nothing, masters err by {wild.alone_m:.3f} m and {calm.alone_m:.3f} m. The "
        "paper gives no battery; the count depends on it, because the role wanders only as "
        "masters spend.",
    )


def figures(found: Tracking) -> dict[str, Figure]:
    """Draw Figs. 2.4-2.11 with Matplotlib, by file name without its suffix."""
    from trackfield.experiments.pham_tracking_figures import figures as drawn

    return drawn(found)


def _table21(found: Tracking) -> Table:
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


def _radii(found: Tracking) -> Table:
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


def _masters(found: Tracking) -> Table:
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


def _sharing(found: Tracking) -> Table:
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


def _worst(found: Sweep) -> float:
    return float((found.kalman_m / found.plain_m).max())


def _row_of(rows: tuple[Found, ...], field: str) -> str:
    return ", ".join(f"{1e3 * getattr(row, field):.2f}" for row in rows)
