"""What Berger's fusion center made of the messages, as tables and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments.results import Table
from trackfield.sensing.amplitude import Fading
from trackfield.types import Matrix, Vector

COUNTS = (3, 4, 5, 10, 20)  # sensors
QUANTITIES = ("P", "x0", "v")
METHODS = ("ours", "ours, nearest", "paper", "all samples", "all samples, paper's start")
OURS, NEAREST, PAPER, RAW, RAW_PAPER = range(len(METHODS))
OUTLIER = 5.0  # bounds of x0 from which on an estimate is a mirror image, or lost


class FusionPart(NamedTuple):
    """How samples are received in a part, and what the paper shows of it."""

    fading: Fading
    rate_hz: float
    snr_db: tuple[float, ...]
    title: str


_SLOW = (10.0, 20.0, 30.0, 40.0)
PARTS: Mapping[str, FusionPart] = {
    "white": FusionPart(
        "none", 1.0, (10.0, 15.0, 20.0, 25.0, 30.0, 40.0), "Figs. 7, 8: white noise, 1 Hz"
    ),
    "fading": FusionPart("rayleigh", 2.0, _SLOW, "Fig. 11: Rayleigh fading, 2 Hz"),
    "fading_10hz": FusionPart("rayleigh", 10.0, _SLOW, "Fig. 12: Rayleigh fading, 10 Hz"),
}


class FusionErrors(NamedTuple):
    """Errors of P, x0, v: `bound` (counts, snr, 3), `error` (methods, counts, snr, runs, 3).

    Infinite where a method found nothing. `truth_weight` (counts, snr, runs) is the weight that
    ours gives to trajectories near the truth.
    """

    bound: Matrix
    error: Matrix
    truth_weight: Matrix

    def lost(self, method: int) -> Matrix:
        """Share (counts, snr) of runs off by more than five bounds of x0: mirror images mostly."""
        return np.mean(self._far(method), axis=-1)

    def ratio(self, method: int, quantity: int, *, all_runs: bool = False) -> Matrix:
        """RMSE over bound (counts, snr), without the lost runs unless `all_runs`; NaN for none."""
        square = np.square(self.error[method, ..., quantity])
        far = np.zeros(square.shape, bool) if all_runs else self._far(method)
        total = np.sum(np.where(far, 0.0, square), axis=-1)
        count = np.sum(~far, axis=-1)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        return np.asarray(np.sqrt(mean) / self.bound[..., quantity], float)

    def _far(self, method: int) -> NDArray[np.bool_]:
        return np.asarray(self.error[method, ..., 1] > OUTLIER * self.bound[..., None, 1], bool)


class GroupingScore(NamedTuple):
    """Runs in which all of `targets` were told apart, out of `runs`."""

    snr_db: float
    targets: int
    right: int
    runs: int


class BergerFusion(NamedTuple):
    """Errors by part (see `PARTS`), scores of several targets, runs of each setting."""

    errors: Mapping[str, FusionErrors]
    grouping: tuple[GroupingScore, ...]
    runs: int


def tables(found: BergerFusion) -> tuple[Table, ...]:
    """Tell errors against the bound, and how often each way is lost."""
    return (
        _three(found),
        *(_counts(found, name) for name in PARTS),
        _rest(found, "white"),
        _several(found),
    )


def findings(found: BergerFusion) -> tuple[str, ...]:
    """Say what follows, and what could not be recovered."""
    white, slow, fast = (found.errors[name] for name in PARTS)
    lost, printed = white.lost(OURS), white.lost(PAPER)
    five, ten = COUNTS.index(5), COUNTS.index(10)
    raw = white.ratio(OURS, 1)[:, 3:] / white.ratio(RAW, 1)[:, 3:]
    gain_db = 20.0 * np.log10(slow.bound[:, -1, 1] / fast.bound[:, -1, 1])
    return (
        "Figs. 7, 8: the paper's way (the largest sample as start, Gaussian cost (18), the best "
        f"pair as start) is lost at 10 dB in {_shares(printed[:, 0])} of the runs with {_names()} "
        "sensors: more sensors do not cure it, for weak ones may say anything. Ours, which lays "
        f"each message over its record again: {_shares(lost[:, 0])}.",
        "The paper finds about five sensors sufficient. With five at 10 dB RMSE over bound of x0 "
        f"over all runs is {white.ratio(PAPER, 1, all_runs=True)[five, 0]:.2f} its way, "
        f"{white.ratio(OURS, 1, all_runs=True)[five, 0]:.2f} ours.",
        "Three sensors at 10 dB are ambiguous. What comes back then has weights: the likeliest is "
        f"off in {100 * lost[0, 0]:.0f} % of the runs, the nearest of all that come back in "
        f"{100 * white.lost(NEAREST)[0, 0]:.0f} %; trajectories near the truth have weight "
        f"{white.truth_weight[0, 0].mean():.2f} on average.",
        "Sending three numbers in place of all samples costs next to nothing, as the paper says: "
        f"from 25 dB on RMSE of x0 is {raw.min():.3f} to {raw.max():.3f} of that of maximum "
        "likelihood on all samples.",
        "Fig. 11: under fading at 2 Hz the paper's way is lost in "
        f"{_shares(slow.lost(PAPER)[:, 1])} of the runs at 20 dB, ours in "
        f"{_shares(slow.lost(OURS)[:, 1])}. With ten sensors ours is at "
        f"{_span(slow.ratio(OURS, 1, all_runs=True)[ten])} bounds of x0 over 10 to 40 dB, no run "
        "left out.",
        "Fig. 12: at 10 Hz, five sensors: "
        f"{_span(fast.ratio(OURS, 1, all_runs=True)[five])} bounds of x0 (the paper's way "
        f"{_span(fast.ratio(PAPER, 1, all_runs=True)[five])}). Five times the samples are worth "
        f"{gain_db.min():.1f} to {gain_db.max():.1f} dB in x0; the paper says a little more than "
        "6, and 7.0 is what five times the information is.",
        "No gate on weak messages is needed: laid over its record again, a message costs no more "
        "than what it says weighs against the noise.",
        "Not recoverable: the places of the paper's sensors, the values of its curves, and how it "
        "counts mirror images; here a run is lost if x0 is off by more than five bounds.",
    )


def _three(found: BergerFusion) -> Table:
    """Fig. 7: three sensors, with and without the mirror images."""
    errors = found.errors["white"]
    rows: list[tuple[str, ...]] = []
    for s, snr_db in enumerate(PARTS["white"].snr_db):
        for method in (PAPER, OURS, RAW_PAPER):
            ratios = [
                f"{errors.ratio(method, q, all_runs=every)[0, s]:.2f}"
                for every in (True, False)
                for q in range(3)
            ]
            lost = f"{100 * errors.lost(method)[0, s]:.1f} %"
            rows.append((f"{snr_db:g}", METHODS[method], *ratios, lost))
    wide = [f"{q}, {which}" for which in ("all", "rest") for q in QUANTITIES]
    title = f"Fig. 7: three sensors, RMSE over bound, {found.runs} runs"
    return Table(title, ("SNR [dB]", "way", *wide, "lost"), tuple(rows))


def _counts(found: BergerFusion, name: str) -> Table:
    """Figs. 8, 11, 12: RMSE of x0 over the bound and lost runs, by number of sensors."""
    errors, part = found.errors[name], PARTS[name]
    rows = tuple(
        (
            f"{count}",
            f"{snr_db:g}",
            f"{errors.bound[c, s, 1]:.4f}",
            *(f"{errors.ratio(m, 1, all_runs=True)[c, s]:.2f}" for m in (PAPER, OURS, RAW)),
            *(f"{100 * errors.lost(m)[c, s]:.1f} %" for m in (PAPER, OURS, NEAREST)),
        )
        for c, count in enumerate(COUNTS)
        for s, snr_db in enumerate(part.snr_db)
    )
    columns = (
        *("sensors", "SNR [dB]", "bound of x0 [km]", "paper", "ours", "all samples"),
        *("paper lost", "ours lost", "nearest lost"),
    )
    return Table(f"{part.title}, RMSE of x0 over bound, all runs", columns, rows)


def _rest(found: BergerFusion, name: str) -> Table:
    """RMSE over bound of all quantities without the lost runs."""
    errors, part = found.errors[name], PARTS[name]
    rows = tuple(
        (
            f"{count}",
            f"{snr_db:g}",
            *(f"{errors.ratio(m, q)[c, s]:.2f}" for m in (PAPER, OURS, RAW) for q in range(3)),
        )
        for c, count in enumerate(COUNTS)
        for s, snr_db in enumerate(part.snr_db)
    )
    wide = [f"{METHODS[m]}: {q}" for m in (PAPER, OURS, RAW) for q in QUANTITIES]
    title = f"{part.title}, RMSE over bound without lost runs"
    return Table(title, ("sensors", "SNR [dB]", *wide), rows)


def _several(found: BergerFusion) -> Table:
    rows = tuple(
        (f"{one.targets}", f"{one.snr_db:g}", f"{one.right} of {one.runs}")
        for one in found.grouping
    )
    title = "Several targets at once, 20 sensors: runs in which all are told apart"
    return Table(title, ("targets", "SNR [dB]", "right"), rows)


def _shares(values: Vector) -> str:
    return ", ".join(f"{100 * value:.0f} %" for value in values)


def _names() -> str:
    return ", ".join(str(count) for count in COUNTS)


def _span(values: Vector) -> str:
    return f"{values.min():.2f} to {values.max():.2f}"
