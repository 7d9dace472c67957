"""`trackfield score`: tracks against truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfield.cli.output import Json, emit, naming, number, show_table

if TYPE_CHECKING:
    from trackfield.metrics.score import Score

COLUMNS = ("RMSE [m]", "median [m]", "p95 [m]", "in 95 %", "NIS", "shown")


def score(
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Where targets really were.")],
    tracks: Annotated[Path, typer.Argument(metavar="TRACKS", help="What the tracker showed.")],
    max_gap: Annotated[
        float,
        typer.Option(metavar="S", min=0.0, help="Bridge gaps of the truth up to this long [s]."),
    ] = 1.0,
    as_json: Json = False,
) -> None:
    """Compare TRACKS with TRUTH, target by target."""
    from trackfield.io.tracks import read_tracks
    from trackfield.io.truth import read_truth
    from trackfield.metrics.score import score as score_all
    from trackfield.metrics.score import scores_by_target

    known, found = read_truth(truth), read_tracks(tracks)
    with naming(truth, tracks):
        total = score_all(known, found, max_gap_s=max_gap)
        by_target = scores_by_target(known, found, max_gap_s=max_gap)
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
