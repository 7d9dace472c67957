"""`trackfield track`: readings in, tracks out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trackfield.cli.output import (
    Json,
    RunError,
    check_figure,
    check_output,
    emit,
    naming,
    progress,
    say,
    warn,
)
from trackfield.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.types import Tracks, Truth


# What is told of the tracker's counts, in which words.
COUNTS = {
    "readings": {
        "accepted": "accepted",
        "duplicate": "repeated",
        "late": "too late",
        "out_of_range": "out of range",
    },
    "tracks": {"started": "started", "restarted": "started again", "ended": "ended"},
}


class Lag(NamedTuple):
    """How late positions are told, in seconds or in updates."""

    seconds: float = 0.0
    steps: int = 0


class Wanted(NamedTuple):
    """What rows are wanted: how late, how far apart, and whether they are kept for a picture."""

    lag: Lag = Lag()
    every_s: float = 0.0
    keep: bool = False


class Run(NamedTuple):
    """What came out of a run: numbers for `--json`, warnings, and the chunks of tracks if kept."""

    numbers: dict[str, Any]
    warnings: list[str]
    kept: list[Tracks]


def track(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Readings: CSV, NDJSON, Parquet.")],
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
        typer.Option(metavar="M", help="Motion of targets in place of the site's: imm or cv."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the tracks into this file.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="TRUTH", help="Draw this truth and the errors too.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Track the tagged targets of SITE by the readings of DATA."""
    from trackfield.io.truth import read_truth
    from trackfield.network.geometry import geometry_problems
    from trackfield.network.site_file import load_site

    loaded = with_method(load_site(site), method)
    problems = [f"{site}: {problem}" for problem in geometry_problems(loaded)]
    if truth is not None and plot is None:
        problems.append("--truth: found no --plot, expected a picture to draw it into")
    if problems:
        raise ConfigurationError(problems)
    inputs = (site, data, truth, loaded.sensors_file)
    check_output(output, inputs)
    if plot is not None:
        check_figure(plot)
        check_output(plot, inputs)
    known = read_truth(truth) if truth is not None else None
    wanted = Wanted(parse_lag(lag), every, keep=plot is not None)
    with progress("tracking") as moved:
        run = run_tracker(loaded, data, output, wanted=wanted, moved=moved)
    result = {"tracks": str(output), **run.numbers, "warnings": run.warnings}
    if plot is not None:
        draw(loaded, run.kept, known, plot)
        result["plot"] = str(plot)
    if as_json:
        emit(result)
    else:
        say(f"{output}: {run.numbers['rows']} rows, {run.numbers['shown']} of them shown")
        for what, names in COUNTS.items():
            counts = (f"{run.numbers['readings'][key]} {name}" for key, name in names.items())
            say(f"{what}: {', '.join(counts)}")
        if plot is not None:
            say(f"{plot}: drawn")


def parse_lag(text: str) -> Lag:
    """Read `2` or `2s` (seconds), or `10steps` (updates)."""
    steps = text.endswith("steps")
    digits = text.removesuffix("steps").removesuffix("s").strip()
    try:
        lag = Lag(steps=int(digits)) if steps else Lag(seconds=float(digits))
    except ValueError:
        lag = Lag(seconds=-1.0)
    if not (0.0 <= lag.seconds < float("inf") and lag.steps >= 0):
        expected = "seconds (2 or 2s) or updates (10steps), 0 or more"
        raise ConfigurationError([f"--lag: found {text!r}, expected {expected}"])
    return lag


def with_method(site: Site, method: str | None) -> Site:
    """Put motion `method`, if one is given, in place of the site's own."""
    match method:
        case None:
            return site
        case "imm" | "cv":
            return replace(site, target=replace(site.target, motion=method))
        case _:
            raise ConfigurationError([f"--method: found {method!r}, expected 'imm' or 'cv'"])


def run_tracker(
    site: Site, data: Path, output: Path, *, wanted: Wanted, moved: Callable[[float], None]
) -> Run:
    """Stream `data` through the tracker into `output`; the file appears only if the run is good."""
    from trackfield.io.measurements import stream_readings
    from trackfield.io.tracks import open_tracks
    from trackfield.metrics.error import shown
    from trackfield.network.survey import data_problems, empty_survey, surveyed, unit_suspicion
    from trackfield.pipeline.tagged import Tracker, require_tracks

    survey, rows, visible, kept = empty_survey(site), 0, 0, list["Tracks"]()
    tracker = Tracker(
        site, lag_s=wanted.lag.seconds, lag_steps=wanted.lag.steps, every_s=wanted.every_s
    )
    with open_tracks(output, origin=site.origin) as write:

        def put(tracks: Tracks) -> None:
            nonlocal rows, visible
            rows, visible = rows + len(tracks), visible + int(shown(tracks).sum())
            write(tracks)
            kept.extend([tracks] if wanted.keep else [])

        for chunk in stream_readings(data, sensor_ids=site.sensor_ids, progress=moved):
            survey = surveyed(survey, chunk)
            put(tracker.process(chunk))
        put(tracker.finish())
        suspicion = unit_suspicion(survey)
        warnings = [f"{data}: {odd}" for odd in (suspicion, *_dropped(site, tracker.counts)) if odd]
        for warning in warnings:
            warn(warning)
        fatal = [problem for problem in data_problems(survey) if problem != suspicion]
        if fatal:
            raise InputError(f"{data}: {'; '.join(fatal)}")
        with naming(data):
            require_tracks(tracker)
        if visible == 0:
            raise RunError(f"{data}: found {survey.readings} readings, and no track was confirmed")
    numbers = {
        "rows": rows,
        "shown": visible,
        "targets": list(survey.targets),
        "first_s": survey.first_s,
        "last_s": survey.last_s,
        "readings": dict(tracker.counts),
    }
    return Run(numbers, warnings, kept)


def _dropped(site: Site, counts: Mapping[str, int]) -> list[str]:
    """Say which readings the tracker had to leave out."""
    said: list[str] = []
    if counts["duplicate"]:
        said.append(f"{counts['duplicate']} readings came again and were dropped")
    if counts["late"]:
        window = f"tracker.window_s = {site.tracker.window_s:g}"
        said.append(f"{counts['late']} readings came later than {window} allows and were dropped")
    if counts["out_of_range"]:
        said.append(f"{counts['out_of_range']} readings were beyond max_range_m and were dropped")
    return said


def draw(site: Site, chunks: list[Tracks], truth: Truth | None, path: Path) -> None:
    """Draw tracks, with truth and errors if truth is known."""
    from trackfield.metrics.error import match
    from trackfield.plotting.style import save
    from trackfield.plotting.tagged import Errors, plot_tracks
    from trackfield.types import concatenate_tracks

    tracks = concatenate_tracks(chunks)
    matched = match(truth, tracks) if truth is not None else None
    errors = Errors(matched.row, matched.error) if matched is not None else None
    save(plot_tracks(site, tracks, truth=truth, errors=errors), path)
