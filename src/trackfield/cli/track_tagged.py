"""Tagged targets on the command line: ranges in, tracks out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from trackfield.cli.output import RunError, naming, warn
from trackfield.cli.runs import Outcome, Wanted
from trackfield.cli.track_commands import orders_into
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


def prepared(site: Site, path: Path, *, method: str | None) -> Site:
    """Take motion `method` for the site of file `path`; refuse one on which nothing is tracked."""
    from trackfield.network.geometry import geometry_problems

    site = with_motion(site, method)
    problems = [f"{path}: {problem}" for problem in geometry_problems(site)]
    if problems:
        raise ConfigurationError(problems)
    return site


def with_motion(site: Site, method: str | None) -> Site:
    """Put motion `method`, if one is given, in place of the site's own."""
    match method:
        case None:
            return site
        case "imm" | "cv":
            return replace(site, target=replace(site.target, motion=method))
        case _:
            raise ConfigurationError(
                [f"--method: found {method!r}, expected 'imm' or 'cv' for tagged targets"]
            )


def run_tracker(
    site: Site, data: Path, output: Path, *, wanted: Wanted, moved: Callable[[float], None]
) -> Outcome:
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
    with (
        open_tracks(output, origin=site.origin) as write,
        orders_into(wanted.commands, site) as orders,
    ):

        def put(tracks: Tracks) -> None:
            nonlocal rows, visible
            rows, visible = rows + len(tracks), visible + int(shown(tracks).sum())
            write(tracks)
            orders.take(tracks)
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
            raise RunError(
                f"{data}: found {survey.timing.rows} readings, and no track was confirmed"
            )
    numbers = {
        "rows": rows,
        "shown": visible,
        "targets": list(survey.targets),
        "first_s": survey.timing.first_s,
        "last_s": survey.timing.last_s,
        "readings": dict(tracker.counts),
    }
    told = [
        f"{what}: " + ", ".join(f"{tracker.counts[key]} {name}" for key, name in names.items())
        for what, names in COUNTS.items()
    ]
    told += orders.told
    return Outcome({**numbers, **orders.numbers}, told, warnings, kept)


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
    from trackfield.types import join_rows

    tracks = join_rows(chunks)
    matched = match(truth, tracks) if truth is not None else None
    errors = Errors(matched.row, matched.error) if matched is not None else None
    save(plot_tracks(site, tracks, truth=truth, errors=errors), path)
