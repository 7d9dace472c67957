"""Pham, Figs. 3.5 to 3.8: which sensors, by the paper's functions and by what is best."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import pham_surface
from trackfield.experiments.pham_surface import Flight, Tracked
from trackfield.experiments.results import Table
from trackfield.localization.bounds import range_bound
from trackfield.localization.information import reading_gains
from trackfield.scheduling.paper_selection import best_pair_and_next, function_2d
from trackfield.scheduling.selection import select
from trackfield.sensing.range import RangeModel, distance
from trackfield.types import Indices, Matrix, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REACH_M = 4.0
NODES = 20
TARGETS = np.array([[3.5, 4.0], [6.5, 6.0]])
"""Points A and B in a field of 10 x 10: ours, the paper gives neither them nor its nodes."""
RULES = ("as printed", "corrected", "best pair, best third", "best three")
COUNTS = (4, 5, 6, 8, 12, 24)
_LAYOUT = 35  # seed of the nodes of Fig. 3.5
_MODEL = RangeModel(sigma_m=1.0)  # traces over sigma^2


class Ratios(NamedTuple):
    """Trace over that of the best three in `fields` random fields, for each of `COUNTS` sensors.

    `mean` and `high` (95 % of fields are below) are (counts, rules) for the first three rules.
    """

    fields: int
    mean: Matrix
    high: Matrix


class PhamSelection(NamedTuple):
    """What was found.

    `nodes` (20, 2) [m] are those of Fig. 3.5; `chosen` the three that each rule takes for A and B,
    `traces` what they leave over sigma^2; `ratios` the same over many fields; `flight` and
    `tracked` Figs. 3.6 to 3.8, by way of selecting, over `runs` runs.
    """

    nodes: Matrix
    chosen: Mapping[str, tuple[Indices, Indices]]
    traces: Mapping[str, tuple[float, float]]
    ratios: Ratios
    flight: Flight
    tracked: Mapping[str, Tracked]
    runs: int


def run(rng: np.random.Generator, *, quick: bool = False) -> PhamSelection:
    """Choose for A and B, in many fields, and along a way in space."""
    fields, runs, cycles = (40, 1, 40) if quick else (1000, 8, None)
    nodes = np.random.default_rng(_LAYOUT).uniform(0.0, 10.0, (NODES, 2))
    near = [np.flatnonzero(distance(nodes, target) <= REACH_M) for target in TARGETS]
    chosen: dict[str, tuple[Indices, Indices]] = {}
    traces: dict[str, tuple[float, float]] = {}
    for rule in RULES:
        a, b = (
            inside[_chosen(rule, nodes[inside], target)].astype(np.int32)
            for inside, target in zip(near, TARGETS, strict=True)
        )
        chosen[rule] = a, b
        traces[rule] = _trace(nodes[a], TARGETS[0]), _trace(nodes[b], TARGETS[1])
    flown = pham_surface.flight(rng, cycles=cycles)
    tracked = {
        name: pham_surface.track(flown, way, runs=runs, rng=rng)
        for name, way in pham_surface.ways().items()
    }
    return PhamSelection(nodes, chosen, traces, _ratios(fields, rng), flown, tracked, runs)


def tables(found: PhamSelection) -> tuple[Table, ...]:
    """Tell Fig. 3.5, the contest of rules, and Figs. 3.6 to 3.8 as tables."""
    return (_fig35(found), _contest(found.ratios), _space(found))


def findings(found: PhamSelection) -> tuple[str, ...]:
    """Say what follows, and what could not be recovered."""
    ratios, tracked = found.ratios, found.tracked
    few, many = ratios.mean[0], ratios.mean[-1]
    paper, direct = tracked["Function-3D, trilateration"], tracked["Function-3D, ranges"]
    best, known = tracked["best four, ranges"], tracked["best four for the filter, ranges"]
    everybody, fixes = tracked["all in reach, ranges"], tracked["all in reach, trilateration"]
    saved = everybody.power_mw.mean() / known.power_mw.mean()
    return (
        "Fig. 3.5: the paper gives neither its 20 nodes nor A and B, so that its sets (#2, 11, 19 "
        "and #14, 18, 19) cannot be checked; the layout here is ours.",
        "Step 4 of Function-2D is printed the wrong way round: it takes the worst third sensor "
        f"for its pair. Of 4 sensors it leaves {few[0]:.2f} times the best trace, corrected "
        f"{few[1]:.2f}. Of 24 there mostly is a pair at a right angle, beside which all thirds are "
        f"alike, and both leave {many[0]:.3f} and {many[1]:.3f} times the best: the pair is what "
        "costs, for the best three stand at 60 degrees. Choosing the third by the trace itself is "
        "the corrected rule.",
        "Figs. 3.6-3.8: the paper gives no way, noise, reach or number of cycles; ours are in the "
        "table's title. Four nodes by Function-3D leave a bound "
        f"{direct.bound.mean() / best.bound.mean():.2f} times that of the best four.",
        "The Kalman filter on trilateration reduces its error as the paper says, from "
        f"{_rms(paper.fix_squared):.2f} to {_rms(paper.squared):.3f} m with four nodes and from "
        f"{_rms(fixes.fix_squared):.2f} to {_rms(fixes.squared):.3f} m with all "
        f"({paper.astray + fixes.astray} of {2 * found.runs} runs strayed). But the "
        "differences of squared ranges had lost most of what four nodes know: a filter on the "
        f"ranges of the same four has {_rms(direct.squared):.3f} m, on those of the best four "
        f"{_rms(best.squared):.3f}, and of the best four for what it knows already "
        f"{_rms(known.squared):.3f}. Runs that strayed by more than {pham_surface.ASTRAY_M} m are "
        f"not counted in these ({best.astray + known.astray + direct.astray} of "
        f"{3 * found.runs}): below the surface there is a second place with nearly those ranges.",
        f"All {everybody.reached.mean():.0f} nodes in reach have {_rms(everybody.squared):.3f} m "
        f"at {saved:.2f} times the power by the paper's formula, in which 441 sleeping nodes take "
        f"{441 * 0.13:.0f} W of all that is spent.",
    )


def figures(found: PhamSelection) -> dict[str, Figure]:
    """Draw Figs. 3.5 to 3.8 and the contest of rules with Matplotlib, by file name."""
    from trackfield.experiments.pham_selection_figures import figures

    return figures(found)


def _chosen(rule: str, sensors: Matrix, target: Vector) -> Indices:
    if rule == "best three":
        return select(reading_gains(_MODEL, sensors, target), 3).sensors
    if rule == "best pair, best third":
        return best_pair_and_next(sensors, target, 3)
    return function_2d(sensors, target, printed=rule == "as printed")


def _trace(sensors: Matrix, target: Vector) -> float:
    return float(np.trace(range_bound(sensors, target, models=_MODEL).covariance))


def _ratios(fields: int, rng: np.random.Generator) -> Ratios:
    """Compare the rules on fields of sensors anywhere in a square about the target."""
    target = np.zeros(2)
    found = np.empty((len(COUNTS), fields, len(RULES) - 1))
    for row, n in zip(found, COUNTS, strict=True):
        for cell in row:
            sensors = rng.uniform(-1.0, 1.0, (n, 2))
            best = _trace(sensors[_chosen(RULES[-1], sensors, target)], target)
            for k, rule in enumerate(RULES[:-1]):
                cell[k] = _trace(sensors[_chosen(rule, sensors, target)], target) / best
    return Ratios(fields, found.mean(axis=1), np.quantile(found, 0.95, axis=1))


def _fig35(found: PhamSelection) -> Table:
    rows = tuple(
        (rule, _names(a), f"{found.traces[rule][0]:.3f}", _names(b), f"{found.traces[rule][1]:.3f}")
        for rule, (a, b) in found.chosen.items()
    )
    columns = ("rule", "for A", "trace over sigma^2", "for B", "trace over sigma^2")
    return Table("Fig. 3.5: three of 20 nodes, reach 4 (a layout of ours)", columns, rows)


def _contest(ratios: Ratios) -> Table:
    rows = tuple(
        (str(n), *(f"{m:.3f} ({h:.2f})" for m, h in zip(mean, high, strict=True)))
        for n, mean, high in zip(COUNTS, ratios.mean, ratios.high, strict=True)
    )
    title = f"Trace of three over that of the best three, mean (95 %) of {ratios.fields} fields"
    return Table(title, ("sensors", "Function-2D as printed", "corrected", RULES[2]), rows)


def _space(found: PhamSelection) -> Table:
    rows = tuple(
        (
            name,
            f"{one.asked.mean():.1f} of {one.reached.mean():.1f}",
            f"{np.sqrt(one.bound.mean()):.3f}",
            f"{_rms(one.fix_squared):.3f}" if np.isfinite(one.fix_squared).all() else "",
            f"{_rms(one.squared):.3f}",
            str(one.astray),
            f"{one.power_mw.mean() / 1e3:.1f}",
            f"{one.power_mw.mean() / 1e3 * pham_surface.CYCLE_S * len(found.flight.t_s):.0f}",
        )
        for name, one in found.tracked.items()
    )
    columns = (
        "nodes, and what the filter gets",
        "asked",
        "bound of a cycle [m]",
        "trilateration [m]",
        "filter [m]",
        "runs astray",
        "power [W]",
        "energy [J]",
    )
    title = (
        f"Figs. 3.6-3.8: 441 nodes on a surface, reach {pham_surface.REACH_M} m, noise "
        f"{pham_surface.SIGMA_M} m, {1.0 / pham_surface.CYCLE_S:.0f} Hz; RMSE of {found.runs} runs"
    )
    return Table(title, columns, rows)


def _names(chosen: Indices) -> str:
    return ", ".join(f"#{i + 1}" for i in chosen)


def _rms(squared: Vector) -> float:
    return float(np.sqrt(squared.mean()))
