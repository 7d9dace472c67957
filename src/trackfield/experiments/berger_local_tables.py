"""What Berger's sensors made of their samples, as tables and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from trackfield.experiments.results import Table
from trackfield.sensing.amplitude import Fading
from trackfield.sensing.profile import Profile
from trackfield.types import Matrix, Vector

SNR_DB = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
BITS = (6, 8, 10, 12, 16)
NUMBERS = ("a_max", "t_max", "width")
SMOOTHING_S = 1.0  # width of the filter before the coarse estimate under fading
ASTRAY = 5.0  # bounds from which on an estimate counts as astray


class Setup(NamedTuple):
    """How samples are received in a part, and what the paper shows of it."""

    fading: Fading
    rate_hz: float
    title: str


SETUPS: Mapping[str, Setup] = {
    "fig6": Setup("none", 1.0, "Fig. 6: white noise, 1 Hz"),
    "fig10": Setup("rayleigh", 2.0, "Fig. 10: Rayleigh fading, 2 Hz"),
    "fig10_10hz": Setup("rayleigh", 10.0, "As Fig. 10, 10 Hz"),
}


class LocalErrors(NamedTuple):
    """Errors of the three numbers of three sensors: all (snr, sensor, number).

    `bound` and `rmse` in their units; `median` is the median error over that of a Gaussian at the
    bound; `coarse` the RMSE of the paper's coarse estimate. `good`, `astray`, `missed` (snr,
    sensor): shares of fits of good quality, of those with a number off by more than five bounds,
    and of those that end half a nat below the best if they start where the paper does only.
    """

    bound: Matrix
    rmse: Matrix
    median: Matrix
    coarse: Matrix
    good: Matrix
    astray: Matrix
    missed: Matrix


class ExampleProfile(NamedTuple):
    """One record of each sensor at 10 dB: times (m,), samples (3, m), and three profiles (3,)."""

    t_s: Vector
    values: Matrix
    truth: Profile
    coarse: Profile
    fitted: Profile


class EncodingCost(NamedTuple):
    """Growth of errors by encoding, (bits, snr): worst of the nine numbers of three sensors.

    Of passes that are each a little different, so that roundings differ: `told` is the median by
    the formula for the bound, `measured` the ratio of RMS errors without fits astray.
    """

    snr_db: Vector
    told: Matrix
    measured: Matrix


class BergerLocal(NamedTuple):
    """What was found: examples (Figs. 5, 9), errors (Figs. 6, 10, and at 10 Hz), encoding."""

    examples: Mapping[str, ExampleProfile]
    errors: Mapping[str, LocalErrors]
    encoding: EncodingCost
    runs: int


def tables(found: BergerLocal) -> tuple[Table, ...]:
    """Tell the errors of each part against the bound, and what encoding costs."""
    parts = (_table(SETUPS[name], errors, found.runs) for name, errors in found.errors.items())
    return (*parts, _encoding_table(found.encoding))


def findings(found: BergerLocal) -> tuple[str, ...]:
    """Say what follows, and what could not be recovered."""
    white, slow, fast = (found.errors[name] for name in ("fig6", "fig10", "fig10_10hz"))
    return (
        "Fig. 6: the local fits reach the bound, as the paper says: RMSE over bound at 20 dB and "
        f"above is {_span(white, 2)}. At 10 dB it is {_span(white, 0, 1)}: the two far sensors go "
        f"astray (a number off by {ASTRAY:g} bounds) in {100 * white.astray[0, :2].mean():.1f} % "
        "of the records, in which noise hides when the target passed; the median error still is "
        f"{white.median[0].min():.2f} to {white.median[0].max():.2f} of that at the bound.",
        "Fig. 10: under fading at 2 Hz RMSE over bound at 20 dB and above is "
        f"{_span(slow, 2)}, at 10 Hz {_span(fast, 2)}. More SNR hardly helps, as the paper says: "
        f"the bound of a_max of sensor 3 falls from {slow.bound[0, 2, 0]:.3f} at 10 dB to "
        f"{slow.bound[-1, 2, 0]:.3f} at 40 dB; more samples do ({fast.bound[-1, 2, 0]:.3f} at 10 "
        "Hz).",
        "The coarse estimates alone are far from the bound: their RMSE is up to "
        f"{_worst(white, 2, 3):.0f} bounds at 20 dB and {_worst(white, 6, 7):.0f} at 40 dB "
        "(Fig. 6). As starts they suffice here: from them alone, damped, at most "
        f"{100 * max(part.missed.max() for part in (white, slow, fast)):.1f} % of the fits of a "
        "sensor end more than half a nat below the best.",
        f"Three numbers of 12 bits cost a factor of {_worst_cost(found, 12, 2):.3f} in the worst "
        f"of them up to 30 dB and {_worst_cost(found, 12, 3):.3f} at 40 dB; of 8 bits "
        f"{_worst_cost(found, 8, 1):.2f} at 20 dB. The paper does not round its numbers.",
        "Not recoverable: the places of the paper's sensors, the values of its curves, the filter "
        "it smooths with under fading. Ours are the first three sensors of the layout, and a "
        f"Gaussian of {SMOOTHING_S:g} s.",
    )


def _span(errors: LocalErrors, first: int, last: int | None = None) -> str:
    ratio = (errors.rmse / errors.bound)[first:last]
    return f"{ratio.min():.2f} to {ratio.max():.2f}"


def _worst(errors: LocalErrors, first: int, last: int) -> float:
    return float((errors.coarse / errors.bound)[first:last].max())


def _worst_cost(found: BergerLocal, bits: int, last: int) -> float:
    return float(found.encoding.measured[BITS.index(bits), : last + 1].max())


def _table(setup: Setup, errors: LocalErrors, runs: int) -> Table:
    rows: list[tuple[str, ...]] = []
    for i, snr in enumerate(SNR_DB):
        for k in range(3):
            bound, ratio = errors.bound[i, k], errors.rmse[i, k] / errors.bound[i, k]
            rows.append(
                (
                    f"{snr:g}",
                    f"{k + 1}",
                    " ".join(f"{value:.3f}" for value in bound),
                    " ".join(f"{value:.2f}" for value in ratio),
                    " ".join(f"{value:.2f}" for value in errors.median[i, k]),
                    f"{errors.good[i, k]:.2f}",
                    f"{errors.astray[i, k]:.3f}",
                )
            )
    columns = (
        "SNR [dB]",
        "sensor",
        "bound of a_max, t_max [s], width [s]",
        "RMSE / bound",
        "median / bound's",
        "good",
        "astray",
    )
    return Table(
        f"{setup.title}: errors of the local fits, {runs} records each", columns, tuple(rows)
    )


def _encoding_table(cost: EncodingCost) -> Table:
    rows = tuple(
        (
            f"{bits}",
            *(
                f"{told:.3f}, {measured:.3f}"
                for told, measured in zip(cost.told[i], cost.measured[i], strict=True)
            ),
        )
        for i, bits in enumerate(BITS)
    )
    columns = ("bits of a number", *(f"{snr:g} dB" for snr in cost.snr_db))
    return Table("Growth of the worst error by encoding: of the bound, measured", columns, rows)
