"""Readings on the command line: what sensors say of tags and sources in, tracks out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackfield.cli.output import RunError, naming, warn
from trackfield.cli.runs import Outcome, Wanted
from trackfield.cli.track_rows import rows_into
from trackfield.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from trackfield.network.kinds import Family
    from trackfield.network.site import Site
    from trackfield.pipeline.runs import ReadingsTracker
    from trackfield.plotting.tagged import Course
    from trackfield.types import Tracks, Truth

# What is told of the tracker's counts, in which words.
COUNTS = {
    "readings": {
        "accepted": "accepted",
        "duplicate": "repeated",
        "late": "too late",
        "nothing": "of nothing heard",
        "unexplained": "of no trajectory",
        "out_of_range": "out of range",
    },
    "tracks": {"started": "started", "restarted": "started again", "ended": "ended"},
}
_ODD_SHARE = 0.05  # of readings that come again, above which they may be of another target
# Why readings were dropped, in which words.
DROPPED = {
    "duplicate": "came again and were dropped",
    "late": "came later than tracker.window_s = {window:g} allows and were dropped",
    "out_of_range": "were beyond max_range_m and were dropped",
}


def prepared(site: Site, path: Path, family: Family, *, method: str | None) -> Site:
    """Take motion `method` for the site of file `path`; refuse one on which nothing is tracked."""
    from trackfield.network.needs import needs

    site = with_motion(site, family, method)
    problems = [f"{path}: {problem}" for problem in needs(site).problems]
    if problems:
        raise ConfigurationError(problems)
    return site


def with_motion(site: Site, family: Family, method: str | None) -> Site:
    """Put motion `method`, if one is given, in place of the site's own."""
    if method is None:
        return site
    if family in ("amplitude", "energy_message"):
        expected = "expected none for amplitudes and their messages: targets pass straight"
        raise ConfigurationError([f"--method: found {method!r}, {expected}"])
    match method:
        case "imm" | "cv":
            return replace(site, target=replace(site.target, motion=method))
        case _:
            raise ConfigurationError(
                [f"--method: found {method!r}, expected 'imm' or 'cv' for tagged targets"]
            )


def run_tracker(
    site: Site,
    data: Path,
    output: Path,
    *,
    family: Family = "range",
    wanted: Wanted,
    moved: Callable[[float], None],
) -> Outcome:
    """Stream `data` through the tracker into `output`; the file appears only if the run is good."""
    from trackfield.cli import track_trajectories as trajectories
    from trackfield.io.measurements import stream_readings
    from trackfield.network.survey import data_problems, empty_survey, surveyed, unit_suspicion
    from trackfield.pipeline.dispatch import tracker_of
    from trackfield.pipeline.runs import require_tracks
    from trackfield.pipeline.trajectories import TrajectoryTracker

    survey, lag = empty_survey(site), wanted.lag
    if family in ("amplitude", "energy_message"):
        trajectories.require_seconds(lag)
    tracker = tracker_of(
        site, family, lag_s=lag.seconds, lag_steps=lag.steps, every_s=wanted.every_s
    )
    passes = tracker if isinstance(tracker, TrajectoryTracker) else None
    with rows_into(output, site, wanted) as sink:
        for chunk in stream_readings(data, sensor_ids=site.sensor_ids, progress=moved):
            survey = surveyed(survey, chunk)
            with naming(data):
                sink.put(tracker.process(chunk))
        sink.put(tracker.finish())
        suspicion = unit_suspicion(survey)
        odd = [*([suspicion] if suspicion else []), *_dropped(site, tracker.counts)]
        if not survey.targets and tracker.counts["duplicate"] > _ODD_SHARE * survey.timing.rows:
            odd.append("that many come again where several targets are not named by target_id")
        if passes is not None:
            odd += trajectories.doubts(passes)
            silent = tracker.counts["started"] > 0 and not sink.shown
            odd += ["no track was confirmed"] if silent else []
        warnings = [f"{data}: {one}" for one in odd]
        for warning in warnings:
            warn(warning)
        fatal = [problem for problem in data_problems(survey) if problem != suspicion]
        if fatal:
            raise InputError(f"{data}: {'; '.join(fatal)}")
        with naming(data):
            require_tracks(tracker)
        if sink.shown == 0 and passes is None:
            raise RunError(
                f"{data}: found {survey.timing.rows} readings, and no track was confirmed"
            )
    numbers: dict[str, Any] = {
        "rows": sink.rows,
        "shown": sink.shown,
        "targets": list(survey.targets),
        "first_s": survey.timing.first_s,
        "last_s": survey.timing.last_s,
        "readings": dict(tracker.counts),
    }
    told = _told(tracker)
    found = trajectories.every(passes) if passes is not None else ()
    if passes is not None:
        numbers |= trajectories.numbers(found)
        told += trajectories.told(found)
    numbers |= sink.numbers
    drawn = trajectories.courses(found, survey.timing) if wanted.keep else ()
    return Outcome(numbers, [*told, *sink.told], warnings, sink.kept, drawn)


def _told(tracker: ReadingsTracker) -> list[str]:
    """Say how readings and tracks fared."""
    counts = tracker.counts
    return [
        f"{what}: "
        + ", ".join(f"{counts[key]} {name}" for key, name in names.items() if key in counts)
        for what, names in COUNTS.items()
    ]


def _dropped(site: Site, counts: Mapping[str, int]) -> list[str]:
    """Say which readings the tracker had to leave out."""
    window = site.tracker.window_s
    return [
        f"{counts[name]} readings {why.format(window=window)}"
        for name, why in DROPPED.items()
        if counts.get(name)
    ]


def draw(
    site: Site,
    chunks: list[Tracks],
    truth: Truth | None,
    path: Path,
    *,
    courses: Sequence[Course] = (),
) -> None:
    """Draw tracks and trajectories, with truth and errors if truth is known."""
    from trackfield.metrics.error import match
    from trackfield.plotting.style import save
    from trackfield.plotting.tagged import Errors, plot_tracks
    from trackfield.types import join_rows

    tracks = join_rows(chunks)
    matched = match(truth, tracks) if truth is not None else None
    errors = Errors(matched.row, matched.error) if matched is not None else None
    save(plot_tracks(site, tracks, truth=truth, errors=errors, courses=courses), path)
