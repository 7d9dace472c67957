"""Pham, Fig. 3.4 and the closed forms of chapters 2 to 4: what geometry does to a position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments.results import Table
from trackfield.localization.range_likelihood import RangeScan
from trackfield.localization.range_mle import mle_batch
from trackfield.localization.trilateration import blue, ordinary, traces
from trackfield.scheduling import uncertainty as forms
from trackfield.sensing import range as ranging
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NODES = np.array([[0.0, 0.0], [1.8, 0.0], [0.9, 2.5], [1.9, 0.3], [2.0, 0.4], [2.3, 0.6]])
"""Table 3.1."""
SETS = {"#1-3": (0, 1, 2), "all six": (0, 1, 2, 3, 4, 5), "#1, 2, 4-6": (0, 1, 3, 4, 5)}
"""Nodes of Fig. 3.4b and 3.4c; the last five stand nearly on a line."""
MIDDLE = (0.9, 0.83)  # of #1-3, where the paper's path comes nearest to it
_FIVE = "#1, 2, 4-6"
_ANGLES_DEG = (30.0, 60.0, 80.0, 100.0, 120.0, 150.0)
_SIGMA_M = 0.01  # of simulated ranges: small, as all formulas are of first order


class Grown(NamedTuple):
    """One more node in random fields: how often the trace rises, and by which factor at most."""

    fields: int
    rises: Vector  # (3,) share, for OLS, BLUE, CRLB
    worst: Vector  # (3,)


class PhamUncertainty(NamedTuple):
    """What was computed: traces over sigma^2 along the path, and measured ones in its middle.

    `traces` holds for each set of nodes OLS, BLUE and CRLB (points, 3) at `x` (points,), `y`;
    `measured` the mean squared errors over sigma^2 of OLS, BLUE and maximum likelihood at `MIDDLE`
    over `draws` draws.
    """

    x: Vector
    y: float
    traces: dict[str, Matrix]
    measured: dict[str, Vector]
    draws: int
    grown: Grown


def run(rng: np.random.Generator, *, quick: bool = False) -> PhamUncertainty:
    """Compute Fig. 3.4 along a path, measure it in its middle, and add nodes to random fields."""
    draws, fields = (300, 200) if quick else (4000, 5000)
    x = np.linspace(0.0, 2.4, 49)
    along = {
        name: np.array([traces(NODES[list(nodes)], np.array([at, MIDDLE[1]])) for at in x])
        for name, nodes in SETS.items()
    }
    measured = {name: _measured(NODES[list(nodes)], draws, rng) for name, nodes in SETS.items()}
    return PhamUncertainty(x, MIDDLE[1], along, measured, draws, _grown(fields, rng))


def tables(found: PhamUncertainty) -> tuple[Table, ...]:
    """Tell Fig. 3.4, the choice of the third sensor, and the cell of two rings as tables."""
    return (_fig34(found), _third(), _rings(), _space())


def findings(found: PhamUncertainty) -> tuple[str, ...]:
    """Say what follows, and what could not be recovered."""
    three, six, five = found.traces.values()
    there = int(np.argmin(np.abs(found.x - MIDDLE[0])))
    least, better = found.x[np.argmin(three[:, 0])], np.mean(six[:, 0] < three[:, 0])
    ols, weighted, bound = five[there]
    alpha = math.radians(30.0)
    best, printed = forms.best_third(alpha).trace, forms.printed_third(alpha).trace
    rises, worst = 100.0 * found.grown.rises, found.grown.worst[0]
    return (
        f"Fig. 3.4b: the trace of #1-3 by least squares is least at x = {least:.2f} (paper: about "
        f"0.9), {three[:, 0].min():.2f} sigma^2; all six are better over {100 * better:.0f} % of "
        "the path (paper: generally). The paper gives neither the path nor the values: ours is "
        f"y = {found.y}, through the middle of #1-3.",
        "Fig. 3.4c: five nodes nearly on a line are worse than three only because differences of "
        f"squared ranges are used: at x = 0.9 OLS {ols:.1f} against {three[there, 0]:.2f}, but the "
        f"bound of the same ranges {bound:.2f} against {three[there, 2]:.2f}. Weights do not help "
        f"there (BLUE {weighted:.1f}): differencing itself loses the distance; maximum likelihood "
        f"of the ranges measures {found.measured[_FIVE][2]:.2f}, searched from the right side of "
        "the line, whose other side holds a mirror image.",
        "More nodes can be worse for unweighted differences only: one more node in "
        f"{found.grown.fields} random fields of 4 to 8 raised the trace of OLS in {rises[0]:.1f} % "
        f"(by up to {worst:.2f} times), of BLUE in {rises[1]:.1f} %, of the bound in "
        f"{rises[2]:.1f} %.",
        f"The rule (3.11) for the third sensor is reversed: at 30 degrees it leaves {printed:.2f} "
        f"sigma^2, the best third sensor {best:.2f}. As printed, (3.10) makes every third sensor "
        "useless: it is above the trace of the first two alone.",
        "The cell of two rings is longer than (2.25) and (2.26) say where they cross at more than "
        "about 110 and 90 degrees: 2u / sin(a/2) is its other diagonal there.",
    )


def figures(found: PhamUncertainty) -> dict[str, Figure]:
    """Draw Fig. 3.4 and the choice of the third sensor with Matplotlib, by file name."""
    from trackfield.experiments.pham_uncertainty_figures import figures

    return figures(found, NODES)


def _fig34(found: PhamUncertainty) -> Table:
    there = int(np.argmin(np.abs(found.x - MIDDLE[0])))
    rows: list[tuple[str, ...]] = []
    for name, along in found.traces.items():
        for k, method in enumerate(("OLS", "BLUE", "bound, maximum likelihood")):
            values = along[:, k]
            least = found.x[int(np.argmin(values))]
            rows.append(
                (
                    name,
                    method,
                    f"{values.min():.2f} at {least:.2f}",
                    f"{values.mean():.2f}",
                    f"{values.max():.2f}",
                    f"{values[there]:.2f}",
                    f"{found.measured[name][k]:.2f}",
                )
            )
    columns = ("nodes", "method", "least, at x", "mean", "most", "at x = 0.9", "measured there")
    title = f"Fig. 3.4: trace over sigma^2 along y = {MIDDLE[1]}; measured in {found.draws} draws"
    return Table(title, columns, tuple(rows))


def _third() -> Table:
    rows: list[tuple[str, ...]] = []
    for degrees in _ANGLES_DEG:
        alpha = math.radians(degrees)
        best, printed = forms.best_third(alpha), forms.printed_third(alpha)
        rows.append(
            (
                f"{degrees:g}",
                f"{2.0 / math.sin(alpha) ** 2:.2f}",
                f"{forms.printed_trace(alpha, printed.beta):.2f}",
                f"{math.degrees(printed.beta):.0f}: {printed.trace:.2f}",
                f"{math.degrees(best.beta):.0f}: {best.trace:.2f}",
            )
        )
    columns = ("alpha [deg]", "two alone", "(3.10) as printed", "(3.11): beta, trace", "best")
    return Table(
        "Theorems 3.1 and 3.2: trace over sigma^2 of two and three sensors", columns, tuple(rows)
    )


def _rings() -> Table:
    rows: list[tuple[str, ...]] = []
    for degrees in (30.0, 60.0, 90.0, 120.0, 150.0):
        half = math.radians(degrees) / 2.0
        told = forms.long_diagonal(1.0, 2.0 * half)
        values = (2.0 * math.sqrt(2.0) / math.sin(half), 2.0 / math.sin(half), float(told))
        rows.append((f"{degrees:g}", *(f"{value:.2f}" for value in values)))
    columns = ("alpha [deg]", "(2.25) as printed", "(2.26) as printed", "the cell is this long")
    return Table(
        "Where two rings of half width u cross: longest extent over u", columns, tuple(rows)
    )


def _space() -> Table:
    alpha, rows = math.radians(60.0), list[tuple[str, ...]]()
    beta = np.radians([30.0, 120.0])
    for degrees in (30.0, 60.0, 90.0):
        along, across = forms.three_sensor_trace_3d(alpha, beta, gamma=math.radians(degrees))
        rows.append((f"{degrees:g}", f"{along:.2f}", f"{across:.2f}"))
    columns = ("gamma [deg]", "beta = 30 deg", "beta = 120 deg")
    return Table(
        "Theorem 3.4, alpha = 60 deg: the trace over sigma^2 does depend on beta",
        columns,
        tuple(rows),
    )


def _measured(sensors: Matrix, draws: int, rng: np.random.Generator) -> Vector:
    """Mean squared errors (3,) over sigma^2 of OLS, BLUE and maximum likelihood at `MIDDLE`."""
    target, model = np.array(MIDDLE), RangeModel(sigma_m=_SIGMA_M)
    path = np.tile(target, (draws, 1))
    z = ranging.simulate(model, sensors, path=path, rng=rng).value
    places: tuple[Matrix, ...] = (
        np.array([ordinary(sensors, one, sigma_m=_SIGMA_M).position for one in z]),
        np.array([blue(sensors, one, sigma_m=_SIGMA_M).position for one in z]),
        mle_batch(RangeScan(sensors, z, model), path).position,
    )
    errors = np.stack(places) - target
    return np.mean(np.sum(errors**2, axis=2), axis=1) / _SIGMA_M**2


def _grown(fields: int, rng: np.random.Generator) -> Grown:
    """Add a node to random fields of 4 to 8 about a target, all within a unit of it."""
    ratios = np.empty((fields, 3))
    for row in ratios:
        nodes = rng.uniform(-1.0, 1.0, (int(rng.integers(4, 9)) + 1, 2))
        before, after = (traces(part, np.zeros(2)) for part in (nodes[:-1], nodes))
        row[:] = np.array(after) / np.array(before)
    return Grown(fields, np.mean(ratios > 1.0 + 1e-9, axis=0), ratios.max(axis=0))
