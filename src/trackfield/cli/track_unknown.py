"""Unknown targets on the command line: what names no target in, tracks out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast, get_args

from trackfield.cli.output import naming, warn
from trackfield.cli.runs import Outcome, Wanted
from trackfield.cli.track_rows import rows_into
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.network.site import MethodName, Site
    from trackfield.pipeline.fronts import Source, Table
    from trackfield.pipeline.untagged import Feed
    from trackfield.types import Tracks, Truth

# Why rows were dropped, in which words.
DROPPED = {
    "duplicate": "came again",
    "late": "came later than tracker.window_steps = {window} allows",
    "ahead": "came from far ahead of all others, as of a clock that jumped",
    "outside": "lay outside the region",
    "flooded": "came on top of all that a step takes",
}


def prepared(site: Site, data: Path, *, source: Source, method: str | None) -> Site:
    """Take association `method`, and derive from the data what the site leaves open.

    A pipe can be read only once: for it, the site must say all.
    """
    from trackfield.pipeline.extent import settled

    site = with_association(site, method)
    if data.is_fifo():
        return site
    with naming(data):
        return settled(site, stream(site, data, source))


def stream(
    site: Site, data: Path, source: Source, progress: Callable[[float], None] | None = None
) -> Iterator[Table]:
    """Read a file of reports, or of readings of the site's sensors, chunk by chunk."""
    from trackfield.io.measurements import stream_readings
    from trackfield.io.reports import stream_reports

    if source == "reports":
        return stream_reports(data, progress=progress)
    return stream_readings(data, sensor_ids=site.sensor_ids, progress=progress)


def with_association(site: Site, method: str | None) -> Site:
    """Put association `method`, if one is given, in place of the site's own."""
    from trackfield.network.site import MethodName

    if method is None:
        return site
    known = get_args(MethodName)
    if method not in known:
        *most, last = map(repr, known)
        expected = f"{', '.join(most)} or {last} for unknown targets"
        raise ConfigurationError([f"--method: found {method!r}, expected {expected}"])
    return replace(site, tracker=replace(site.tracker, method=cast("MethodName", method)))


def run_tracker(
    site: Site,
    data: Path,
    output: Path,
    *,
    feed: Feed,
    wanted: Wanted,
    moved: Callable[[float], None],
) -> Outcome:
    """Stream `data` through the tracker into `output`; the file appears only if the run is good."""
    from trackfield.pipeline.untagged import UntaggedTracker

    lag, times = wanted.lag, list[float]()
    tracker = UntaggedTracker(
        site, feed, lag_s=lag.seconds, lag_steps=lag.steps, every_s=wanted.every_s
    )
    with rows_into(output, site, wanted) as sink, naming(data):
        for chunk in stream(site, data, feed.source, moved):
            times += [float(chunk.t_s.min()), float(chunk.t_s.max())]
            sink.put(tracker.process(chunk))
        sink.put(tracker.finish())
    counts = tracker.counts
    warnings = [f"{data}: {odd}" for odd in _dropped(site, counts)]
    if not sink.shown:
        warnings.append(f"{data}: no track was shown in {counts['steps']} steps")
    for warning in warnings:
        warn(warning)
    what = "reports" if feed.source == "reports" else "readings"
    learned = ", ".join(f"{name} {value:.4g}" for name, value in tracker.learned.items())
    told = [
        f"{what}: {counts['accepted']} accepted, {counts['delayed']} of them late; "
        f"{sum(counts[name] for name in DROPPED)} dropped",
        f"tracks: {counts['started']} started, {counts['ended']} ended in {counts['steps']} steps",
        *([f"learned: {learned}"] if learned else []),
    ]
    numbers = {
        "rows": sink.rows,
        "shown": sink.shown,
        "source": feed.source,
        "method": site.tracker.method,
        "by_group": site.tracker.by_group,
        "handed_over": tracker.method_counts.get("handed_over", 0),
        "first_s": min(times),
        "last_s": max(times),
        "region": None if site.reports.region is None else list(site.reports.region),
        "step_s": site.reports.step_s,
        what: counts,
        "learned": dict(tracker.learned),
    }
    told += sink.told
    return Outcome({**numbers, **sink.numbers}, told, warnings, sink.kept)


def _dropped(site: Site, counts: Mapping[str, int]) -> list[str]:
    """Say which rows the tracker had to leave out."""
    window = site.tracker.window_steps
    return [
        f"{_rows(counts[name])} {why.format(window=window)}"
        for name, why in DROPPED.items()
        if counts[name]
    ]


def _rows(count: int) -> str:
    return f"dropped {count} row{'s' if count > 1 else ''} that"


def draw(site: Site, chunks: list[Tracks], truth: Truth | None, path: Path) -> None:
    """Draw where tracks went, and whom they followed if truth is known."""
    from trackfield.metrics.many import followed
    from trackfield.plotting.many import Scenery, plot_many
    from trackfield.plotting.style import save
    from trackfield.types import join_rows

    tracks = join_rows(chunks)
    sensors = site.positions[:, :2] if site.sensor_ids else None
    whose = followed(truth, tracks) if truth is not None else None
    scenery = Scenery(site.reports.region, sensors, truth=truth, followed=whose)
    save(plot_many(tracks, scenery, title=site.name), path)
