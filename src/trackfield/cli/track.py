"""`trackfield track`: readings or reports in, tracks out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfield.cli.output import (
    Json,
    check_animation,
    check_figure,
    check_output,
    emit,
    naming,
    progress,
    say,
)
from trackfield.cli.runs import Lag, Wanted, parse_lag
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.network.kinds import Family
    from trackfield.network.site import Site
    from trackfield.pipeline.untagged import Feed
    from trackfield.types import Tracks, Truth

_NO_LAG = "--commands: found with --lag, expected without: nodes are told what is known in time"
_NO_PLOT = "--truth: found no --plot or --animate, expected something to draw it into"


def track(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[
        Path, typer.Argument(metavar="DATA", help="Readings or reports: CSV, NDJSON, Parquet.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="TRACKS", help="Where tracks are written.")
    ],
    lag: Annotated[
        str,
        typer.Option(metavar="S", help="Tell positions late and better: seconds, or 10steps."),
    ] = "0",
    every: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="Write rows at least so far apart [s].")
    ] = 0.0,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="In place of the site's: motion of tagged targets (imm, cv), or how unknown ones "
            "are told apart (bernoulli, jipda, mcmcda, gnn, nearest).",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the tracks into this file.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="TRUTH", help="Draw or play this truth too.")
    ] = None,
    animate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Play the tracks: .html or .gif.")
    ] = None,
    commands: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write what the site's scheduler tells sensor nodes: CSV, NDJSON, Parquet.",
        ),
    ] = None,
    rooms: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write which of the site's rooms targets are in: CSV, NDJSON, Parquet.",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Of methods in which there is chance.")
    ] = 0,
    as_json: Json = False,
) -> None:
    """Track the targets of SITE by DATA: readings that sensors made of them, or reports."""
    from trackfield.cli import track_readings as readings
    from trackfield.cli import track_unknown as unknown
    from trackfield.io.truth import read_truth
    from trackfield.network.site_file import load_site

    loaded = load_site(site)
    if truth is not None and plot is None and animate is None:
        raise ConfigurationError([_NO_PLOT])
    known = read_truth(truth) if truth is not None else None
    keep = plot is not None or animate is not None
    wanted = Wanted(parse_lag(lag), every, keep=keep, commands=commands, rooms=rooms)
    check_outputs(output, wanted, plot, animate, inputs=(site, data, truth, loaded.sensors_file))
    way = way_of_file(loaded, data, seed)
    with progress("tracking") as moved:
        if isinstance(way, str):
            loaded = readings.prepared(loaded, site, way, method=method)
            run = readings.run_tracker(loaded, data, output, family=way, wanted=wanted, moved=moved)
        else:
            loaded = unknown.prepared(loaded, data, source=way.source, method=method)
            run = unknown.run_tracker(loaded, data, output, feed=way, wanted=wanted, moved=moved)
    result = {"tracks": str(output), **run.numbers, "warnings": run.warnings}
    if plot is not None:
        if isinstance(way, str):
            readings.draw(loaded, run.kept, known, plot, courses=run.courses)
        else:
            unknown.draw(loaded, run.kept, known, plot)
        result["plot"] = str(plot)
    if animate is not None:
        play(loaded, run.kept, known, animate)
        result["animation"] = str(animate)
    if as_json:
        emit(result)
        return
    say(f"{output}: {run.numbers['rows']} rows, {run.numbers['shown']} of them shown")
    for line in run.told:
        say(line)
    if plot is not None:
        say(f"{plot}: drawn")
    if animate is not None:
        say(f"{animate}: drawn")


def check_outputs(
    output: Path,
    wanted: Wanted,
    plot: Path | None,
    animate: Path | None,
    *,
    inputs: tuple[Path | None, ...],
) -> None:
    """Refuse, before the work, files that could not be written after it."""
    commands, rooms = wanted.commands, wanted.rooms
    for path in (output, plot, animate, commands, rooms):
        if path is not None:
            check_output(path, inputs)
    if plot is not None:
        check_figure(plot)
    if animate is not None:
        check_animation(animate)
    if commands is not None and wanted.lag != Lag():
        raise ConfigurationError([_NO_LAG])
    for name, path in (("--commands", commands), ("--rooms", rooms)):
        if path is not None and path.resolve() == output.resolve():
            raise ConfigurationError([f"{name}: found {path}, where tracks are written"])


def play(site: Site, chunks: list[Tracks], truth: Truth | None, path: Path) -> None:
    """Write the tracks as an animation, with truth if it is known."""
    from trackfield.plotting.animation import save_animation
    from trackfield.plotting.many import Scenery
    from trackfield.types import join_rows

    sensors = site.positions[:, :2] if site.sensor_ids else None
    scenery = Scenery(site.reports.region, sensors, truth=truth)
    save_animation(join_rows(chunks), path, scenery=scenery, title=site.name)


def way_of_file(site: Site, data: Path, seed: int) -> Family | Feed:
    """Tell how a file is tracked by its columns and first rows: a family of readings, or a feed.

    What a pipe holds is told by the site.
    """
    from trackfield.io.data import holds_reports
    from trackfield.io.measurements import stream_readings
    from trackfield.network.kinds import families
    from trackfield.pipeline.dispatch import family_of, feed_of
    from trackfield.pipeline.untagged import Feed

    if holds_reports(data):
        return Feed("reports", seed)
    present = families(site.models)
    if present == ("range",):
        return "range"  # nothing else can be tracked on such a site
    if data.is_fifo():
        match present:
            case []:
                return Feed("reports", seed)
            case ["signal" | "detection" as source]:
                return Feed(source, seed)
            case [family]:
                return family
            case _:
                expected = "a file, as its sensors are of several kinds"
                raise ConfigurationError([f"{data}: found a pipe, expected {expected}"])
    with naming(data):
        first = next(stream_readings(data, sensor_ids=site.sensor_ids))
        return feed_of(first, seed=seed) or family_of(first)
