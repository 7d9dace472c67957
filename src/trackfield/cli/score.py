"""`trackfield score`: tracks against truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfield.cli.output import (
    Json,
    check_figure,
    check_output,
    emit,
    naming,
    number,
    say,
    show_table,
    warn,
)
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.metrics.many import ManyScore
    from trackfield.metrics.score import Score
    from trackfield.types import Tracks, Truth

_PRESENT = 0.6  # share of its steps at which a target is usually there

COLUMNS = ("RMSE [m]", "median [m]", "p95 [m]", "in 95 %", "NIS", "shown")


def score(
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Where targets really were.")],
    tracks: Annotated[Path, typer.Argument(metavar="TRACKS", help="What the tracker showed.")],
    many: Annotated[
        bool,
        typer.Option("--many", help="Score as many targets without names, as untagged tracks are."),
    ] = False,
    cutoff: Annotated[
        float | None, typer.Option(metavar="M", help="Of many: cut-off c of OSPA and GOSPA [m], 5.")
    ] = None,
    order: Annotated[
        float | None, typer.Option(metavar="P", help="Of many: order p of OSPA and GOSPA, 2.")
    ] = None,
    match: Annotated[
        float | None,
        typer.Option(
            metavar="M", help="Of many: a track this near may be a target's [m], the cut-off."
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Of many: rows this near to a step are of it [s], half a step."
        ),
    ] = None,
    max_gap: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.0,
            help="Bridge gaps of the truth up to this long [s]: 1, of many 0.",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Of many: draw who was followed by which track."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare TRACKS with TRUTH, target by target.

    Tracks that name no target are scored as sets of many: GOSPA, MOTA, IDF1, SIAP.
    """
    from trackfield.io.tracks import read_tracks
    from trackfield.io.truth import read_truth
    from trackfield.metrics.many import USUAL, asks_for_many, score_many

    if plot is not None:
        check_figure(plot)
        check_output(plot, (truth, tracks))
    known, found = read_truth(truth), read_tracks(tracks)
    if not (many or asks_for_many(known, found)):
        told = {"cutoff": cutoff, "order": order, "match": match, "tolerance": tolerance}
        _refuse({**told, "plot": plot})
        with naming(truth, tracks):
            _show_by_target(known, found, 1.0 if max_gap is None else max_gap, as_json=as_json)
        return
    measure = USUAL._replace(
        cutoff_m=USUAL.cutoff_m if cutoff is None else cutoff,
        order=USUAL.order if order is None else order,
        match_m=match,
    )
    with naming(truth, tracks):
        total = score_many(
            known, found, measure=measure, tolerance_s=tolerance, max_gap_s=max_gap or 0.0
        )
        if plot is not None:
            _draw(known, found, total, plot)
    _show_many(total, as_json=as_json)


def _refuse(options: dict[str, object]) -> None:
    """Refuse options of many targets where targets have names."""
    told = [f"--{name}" for name, value in options.items() if value is not None]
    if told:
        problem = f"found {', '.join(told)} and tracks that name their targets, expected --many"
        raise ConfigurationError([problem])


def _show_by_target(truth: Truth, tracks: Tracks, max_gap_s: float, *, as_json: bool) -> None:
    from trackfield.metrics.score import score as score_all
    from trackfield.metrics.score import scores_by_target

    total = score_all(truth, tracks, max_gap_s=max_gap_s)
    by_target = scores_by_target(truth, tracks, max_gap_s=max_gap_s)
    if as_json:
        targets = {name: one.to_dict() for name, one in by_target.items()}
        emit({**total.to_dict(), "targets": targets})
        return
    named = {**by_target, "all": total} if len(by_target) > 1 else by_target
    rows = [(name, str(one.rows), *cells(one)) for name, one in named.items()]
    show_table(("target", "rows", *COLUMNS), rows)


def cells(one: Score) -> tuple[str, ...]:
    """Numbers of a score as cells under `COLUMNS`."""
    return (
        number(one.rmse_m),
        number(one.median_m),
        number(one.p95_m),
        f"{100 * one.inside_95:.0f} %",
        number(one.nis, 2),
        f"{100 * one.availability:.0f} %",
    )


def _show_many(one: ManyScore, *, as_json: bool) -> None:
    extent, measure = one.extent, one.measure
    if extent.off_steps:
        warn(f"{extent.off_steps} shown rows are at no step of the truth: not scored")
    if extent.presence is not None and extent.presence < _PRESENT:
        warn(
            f"targets have a row at {100 * extent.presence:.0f} % of the steps of their lives: if "
            "they have other times, --max-gap bridges them"
        )
    if as_json:
        emit(one.to_dict())
        return
    say(
        f"{extent.targets} targets, {extent.tracks} tracks, {extent.steps} steps; "
        f"c {measure.cutoff_m:g} m, p {measure.order:g}, match {measure.match_m:g} m"
    )
    show_table(("score", "value", "best"), _many_rows(one))


def _draw(truth: Truth, tracks: Tracks, one: ManyScore, path: Path) -> None:
    from trackfield.metrics.many import followed
    from trackfield.plotting.many import Scenery, plot_many
    from trackfield.plotting.style import save

    match_m = one.measure.match_m or one.measure.cutoff_m
    scenery = Scenery(truth=truth, followed=followed(truth, tracks, match_m=match_m))
    save(plot_many(tracks, scenery, title=f"GOSPA {one.sets.gospa_m:.3f} m"), path)


def _many_rows(one: ManyScore) -> list[tuple[str, str, str]]:
    clear, identity, siap = one.clear_mot, one.identity, one.siap
    return [
        ("GOSPA [m]", number(one.sets.gospa_m), "0"),
        ("OSPA [m]", number(one.sets.ospa_m), "0"),
        ("targets missed, a step", number(one.sets.missed), "0"),
        ("tracks false, a step", number(one.sets.false), "0"),
        ("error of the number", number(one.cardinality.cardinality_error), "0"),
        ("MOTA", number(clear.mota), "1"),
        ("MOTP [m]", number(clear.motp_m), "0"),
        ("recall", number(clear.recall), "1"),
        ("precision", number(clear.precision), "1"),
        ("identity switches", str(clear.switches), "0"),
        ("fragments", str(clear.fragments), "0"),
        ("targets mostly tracked", str(clear.mostly_tracked), str(one.extent.targets)),
        ("targets mostly lost", str(clear.mostly_lost), "0"),
        ("IDF1", number(identity.idf1), "1"),
        ("IDP", number(identity.idp), "1"),
        ("IDR", number(identity.idr), "1"),
        ("completeness", number(siap.completeness), "1"),
        ("ambiguity", number(siap.ambiguity), "1"),
        ("spuriousness", number(siap.spuriousness), "0"),
        ("position error [m]", number(siap.position_error_m), "0"),
        ("breaks of tracks [1/s]", number(siap.breaks_per_s, 4), "0"),
        ("longest segment", number(siap.longest_segment), "1"),
    ]
