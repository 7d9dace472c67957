"""What chapter 2 of Pham comes to, and what could not be recovered from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trackfield.experiments import pham_masters, pham_sink, pham_table21
from trackfield.experiments.pham_sink import Service
from trackfield.experiments.pham_sweeps import Sweep
from trackfield.experiments.pham_table21 import PRINTED, Found

if TYPE_CHECKING:
    from trackfield.experiments.pham_tracking import PhamTracking


def findings(found: PhamTracking) -> tuple[str, ...]:
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
    roots = pham_table21.deviations(found.way, found.nodes, 0.029)
    as_deviations = ", ".join(f"{1e3 * root:.1f}" for root in roots)
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
        "standard deviation would, and rises again in the last row. Read so, its first two rows "
        f"are those of ranges with sigma .029 ({as_deviations} e-3), of which the text says "
        "nothing, and the others are not. The text says 21.71 where the table says 24.71.",
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
        _said_of_the_sink(found.services),
    )


def _said_of_the_sink(found: tuple[Service, ...]) -> str:
    calm = found[1]
    share = calm.messages_j / sum(calm.found.totals_j.values())
    busiest = float(calm.found.spent_j[:, 4:].sum(axis=1).max())
    return (
        f"A report of 256 bits a cycle to a sink at the corner takes {calm.mean_hops:.1f} hops of "
        f"{pham_sink.HOP_M:g} m and, with the hand-overs, {100 * share:.0f} % of what all nodes "
        f"spend. The busiest relay, next to the sink, spends {busiest:.1f} J on it, of "
        f"{pham_sink.BATTERY_J:g}. By rule (5.6) masters stand ahead of the target; hops and "
        "joules are those of (2.4) within a few of a hundred."
    )


def _row_of(rows: tuple[Found, ...], field: str) -> str:
    return ", ".join(f"{1e3 * getattr(row, field):.2f}" for row in rows)


def _worst(found: Sweep) -> float:
    return float((found.kalman_m / found.plain_m).max())
