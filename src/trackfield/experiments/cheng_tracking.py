"""Cheng, sections 3.2 and 4: tracking by angular rates, who senses, and what silence says."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import cheng_pass, cheng_switching
from trackfield.experiments.cheng_pass import FIELD, IEKF, METHODS, OBSERVER, TABLE, UNTOLD, Pass
from trackfield.experiments.cheng_switching import ACTIVE, RULES, Silent, Switched
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TICKS = 4
"""Parts of which `run` tells that they are done."""


class Size(NamedTuple):
    """How many runs: of passes, of those the trackers follow, of switching and of silence."""

    passes: int
    tracked: int
    switched: int
    silent: int


FULL, QUICK = Size(200, 60, 100, 40), Size(10, 2, 6, 2)


class ChengTracking(NamedTuple):
    """What was found: passes of two fields, sensors switched by rules, silence."""

    field: Pass
    table: Pass
    switched: Switched
    silent: Silent


def run(
    rng: np.random.Generator, *, quick: bool = False, tick: Callable[[], None] = lambda: None
) -> ChengTracking:
    """Run everything; `quick` takes a tenth of the runs. `tick` is called after each part."""
    size = QUICK if quick else FULL
    parts = rng.spawn(TICKS)
    field = cheng_pass.passes(FIELD, size.passes, tracked=size.tracked, rng=parts[0])
    tick()
    table = cheng_pass.passes(TABLE, size.passes, tracked=size.tracked, rng=parts[1])
    tick()
    switched = cheng_switching.switched(size.switched, parts[2])
    tick()
    silent = cheng_switching.silent(size.silent, parts[3])
    tick()
    return ChengTracking(field, table, switched, silent)


def tables(found: ChengTracking) -> tuple[Table, ...]:
    """Write what was found."""
    return (
        _passes(found.field),
        _passes(found.table),
        _switched(found.switched),
        _silent(found.silent),
    )


def findings(found: ChengTracking) -> tuple[str, ...]:
    """Say what the tables show."""
    field, table, switched, silent = found
    gain = 100.0 * (1.0 - silent.rmse(1) / silent.rmse(0))
    return (
        f"Section 3.2: the observer (33) starts {cheng_pass.START_ERROR_M:g} m off and ends "
        f"{field.rmse(OBSERVER):.3f} m off; the iterated EKF of the same start and readings ends "
        f"{1e3 * field.rmse(IEKF):.1f} mm off, {field.efficiency(IEKF):.2f} times the bound of "
        f"{1e3 * field.bound_m[-1]:.1f} mm. The paper gives no numbers: field, rate of the scans "
        "and motion are ours.",
        f"Between the four nodes of Example 5.1 the same start error is a third of the field: the "
        f"observer loses {100 * table.lost(OBSERVER):.0f} % of the passes, the iterated EKF "
        f"{100 * table.lost(IEKF):.1f} %, and the tracker, which is told no start, "
        f"{100 * table.lost(UNTOLD):.1f} %.",
        f"Section 4: with {ACTIVE} of 12 sensors the paper's rule ends at "
        f"{1e3 * switched.rmse('rule of the paper'):.1f} mm, the nearest ones at "
        f"{1e3 * switched.rmse('nearest'):.1f} mm, those with most information at "
        f"{1e3 * switched.rmse('information'):.1f} mm; all twelve reach "
        f"{1e3 * switched.rmse('all twelve'):.1f} mm. The rule looks for sensors that are like the "
        "last ones, not for good ones; the paper does not measure it.",
        f"Sensors that speak only above {cheng_switching.THRESHOLD_RAD_S:g} rad/s say "
        f"{100 * silent.spoken:.0f} % of their readings; believing their silence changes the "
        f"RMSE by {-gain:+.0f} % ({1e3 * silent.rmse(0):.1f} to {1e3 * silent.rmse(1):.1f} mm). "
        "Of four thresholds tried it is the one at which silence helped most; at 0.5 it did harm.",
    )


def figures(found: ChengTracking) -> dict[str, Figure]:
    """Draw all figures, by file name without its suffix."""
    from trackfield.experiments.cheng_tracking_figures import figures as draw

    return draw(found)


def _passes(found: Pass) -> Table:
    rows = tuple(
        (method, str(len(found.error_m[method])), *_cells(found, method)) for method in METHODS
    )
    bound = ("posterior Cramer-Rao bound", "", f"{1e3 * found.bound_m[-1]:.2f}", "1", "")
    return Table(
        f"Straight pass through {found.passing.name}, sigma 0.01 rad/s, start 0.1 m off: the end",
        ("method", "runs", "RMSE [mm]", "over the bound", "lost"),
        (*rows, bound),
    )


def _cells(found: Pass, method: str) -> tuple[str, str, str]:
    """Write RMSE, efficiency and lost runs; where most are lost, an RMSE says nothing."""
    lost = found.lost(method)
    share = f"{100 * lost:.1f} %"
    if lost > 0.5:
        return "-", "-", share
    return f"{1e3 * found.rmse(method):.2f}", f"{found.efficiency(method):.2f}", share


def _switched(found: Switched) -> Table:
    rows = tuple((rule, f"{1e3 * found.rmse(rule):.2f}") for rule in RULES)
    runs = found.error_m.shape[1]
    return Table(
        f"{ACTIVE} of 12 sensors sense, chosen four times a second, {runs} passes",
        ("rule", "RMSE [mm]"),
        rows,
    )


def _silent(found: Silent) -> Table:
    rows = tuple(
        (
            name,
            f"{1e3 * found.rmse(k):.1f}",
            f"{1e3 * found.median(k):.1f}",
            f"{100 * found.inside[k]:.0f} %",
        )
        for k, name in enumerate(("ignored", "believed"))
    )
    columns = ("silence is", "RMSE [mm]", "median [mm]", "truth in the 95 % ellipse")
    runs = found.error_m.shape[1]
    return Table(f"Twelve sensors with a threshold, {runs} passes", columns, rows)
