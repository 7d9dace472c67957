"""The flow for people who write Python: sites and runs as values, files or tables; tracks out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol, cast

from numpy.typing import ArrayLike

from trackfield.calibration import ranges
from trackfield.io.measurements import read_readings, readings_from_columns, stream_readings
from trackfield.io.tracks import read_tracks
from trackfield.io.truth import read_truth, truth_from_columns
from trackfield.metrics import score as metrics
from trackfield.network.site import Site
from trackfield.network.site_file import load_site
from trackfield.pipeline import tagged
from trackfield.types import Readings, Tracks, Truth


class Frame(Protocol):
    """A data frame of pandas or a table of Arrow."""

    @property
    def columns(self) -> object:
        """Its columns."""
        ...


File = str | Path
Columns = Mapping[str, ArrayLike] | Frame
Run = Readings | File | Columns


def track(
    site: Site | File,
    readings: Run | Iterable[Readings | Columns],
    *,
    lag_s: float = 0.0,
    lag_steps: int = 0,
    every_s: float = 0.0,
) -> Tracks:
    """Track all tagged targets of a run; rows in order of time.

    `site` is a `Site` or the path of its file. `readings` are `Readings`, the path of a file, a
    mapping of columns or a data frame (`t_s`, `sensor_id`, `kind`, `value`, and what else
    `measurements.csv` may have), or chunks of any of these in order. `lag_s` (or `lag_steps`, in
    updates) asks for positions that much later and better; `every_s` thins the rows.

    `ConfigurationError` for a site and `InputError` for readings that cannot be used.
    """
    place = _site(site)
    if isinstance(readings, str | Path):
        chunks = stream_readings(readings, sensor_ids=place.sensor_ids)
    elif isinstance(readings, Iterable) and not _is_run(readings):
        chunks = (_whole(place, chunk) for chunk in readings)
    else:
        chunks = [_whole(place, cast("Run", readings))]
    run = tagged.track(place, chunks, lag_s=lag_s, lag_steps=lag_steps, every_s=every_s)
    return run.tracks


def calibrate(
    site: Site | File, readings: Run, truth: Truth | File | Columns
) -> ranges.Calibration:
    """Learn the sensors' models of a site from a run whose truth is known.

    The calibrated site is the result's `site`; `trackfield.write_site` keeps it. Arguments and
    errors are those of `track`.
    """
    place = _site(site)
    return ranges.calibrate(place, _whole(place, readings), _truth(truth))


def score(
    truth: Truth | File | Columns, tracks: Tracks | File, *, max_gap_s: float = 1.0
) -> metrics.Score:
    """Compare tracks, or a file of them, with truth.

    Truth is interpolated between samples at most `max_gap_s` apart. `InputError` where nothing
    matches.
    """
    found = tracks if isinstance(tracks, Tracks) else read_tracks(tracks)
    return metrics.score(_truth(truth), found, max_gap_s=max_gap_s)


def _site(site: Site | File) -> Site:
    return site if isinstance(site, Site) else load_site(site)


def _truth(truth: Truth | File | Columns) -> Truth:
    if isinstance(truth, Truth):
        return truth
    return read_truth(truth) if isinstance(truth, str | Path) else truth_from_columns(truth)


def _is_run(value: object) -> bool:
    """Tell one run from an iterable of chunks; rows of numbers are a run, if a wrong one."""
    whole = isinstance(value, Readings | Mapping)
    return whole or hasattr(value, "columns") or hasattr(value, "dtype")


def _whole(site: Site, readings: Run) -> Readings:
    if isinstance(readings, Readings):
        return readings
    if isinstance(readings, str | Path):
        return read_readings(readings, sensor_ids=site.sensor_ids)
    return readings_from_columns(readings, sensor_ids=site.sensor_ids)
