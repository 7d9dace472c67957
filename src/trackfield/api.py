"""The flow for people who write Python: sites and runs as values, files or tables; tracks out."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Protocol, cast, overload

from numpy.typing import ArrayLike

from trackfield.calibration import ranges
from trackfield.calibration.detection_site import CalibratedDetections, calibrate_detection_site
from trackfield.calibration.fingerprints import calibrate_fingerprints
from trackfield.calibration.rssi import calibrate_rssi
from trackfield.calibration.rssi_site import CalibratedRssi
from trackfield.calibration.signal_site import CalibratedSignals, calibrate_signal_site
from trackfield.errors import InputError
from trackfield.io.data import data_from_columns, stream_data
from trackfield.io.fingerprints import read_fingerprints
from trackfield.io.measurements import read_readings, readings_from_columns
from trackfield.io.tracks import read_tracks
from trackfield.io.truth import read_truth, truth_from_columns
from trackfield.metrics.many import USUAL, ManyScore, Measure, asks_for_many, score_many
from trackfield.metrics.score import Score
from trackfield.metrics.score import score as score_tagged
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.site import Site
from trackfield.network.site_file import load_site
from trackfield.pipeline.dispatch import family_of, feed_of, source_of, tracker_of
from trackfield.pipeline.extent import settled
from trackfield.pipeline.runs import track_readings
from trackfield.pipeline.untagged import track_unknown
from trackfield.sensing.rssi import RssiModel
from trackfield.types import Readings, Reports, Tracks, Truth


class Frame(Protocol):
    """A data frame of pandas or a table of Arrow."""

    @property
    def columns(self) -> object:
        """Its columns."""
        ...


File = str | Path
Columns = Mapping[str, ArrayLike] | Frame
Table = Readings | Reports
Run = Table | File | Columns


def track(
    site: Site | File,
    data: Run | Iterable[Table | Columns],
    *,
    lag_s: float = 0.0,
    lag_steps: int = 0,
    every_s: float = 0.0,
    seed: int = 0,
) -> Tracks:
    """Track all targets of a run; rows in order of time.

    `site` is a `Site` or the path of its file. `data` are `Readings` or `Reports`, the path of a
    file, a mapping of columns or a data frame (those of `measurements.csv` or of `reports.csv`), or
    chunks of any of these in order. What they are decides how they are tracked: ranges, strengths
    of beacons, and bearings, angular rates and motion by the tags that they name; amplitudes and
    energy messages as passes of sources; reports, signals and detections as of unknown targets, by
    the site's `tracker.method`, for which `seed` is. A region or step that the site leaves open is
    derived from them. `lag_s` (or `lag_steps`, in updates) asks for positions that much later and
    better; `every_s` thins the rows.

    `ConfigurationError` for a site and `InputError` for data that cannot be used.
    """
    place = _site(site)
    if isinstance(data, str | Path):
        chunks = stream_data(data, sensor_ids=place.sensor_ids)
    elif isinstance(data, Iterable) and not _is_run(data):
        chunks = (_whole(place, chunk) for chunk in cast("Iterable[Table | Columns]", data))
    else:
        chunks = iter([_whole(place, cast("Table | Columns", data))])
    lags: dict[str, Any] = {"lag_s": lag_s, "lag_steps": lag_steps, "every_s": every_s}
    first = next(chunks, None)
    feed = None if first is None else feed_of(first, seed=seed)
    whole = itertools.chain([] if first is None else [first], chunks)
    if feed is None:
        family = "range" if first is None else family_of(cast("Readings", first))
        tracker = tracker_of(place, family, **lags)
        return track_readings(tracker, cast("Iterable[Readings]", whole)).tracks
    if place.reports.region is None or place.reports.step_s is None:
        if isinstance(data, str | Path):  # is read twice rather than kept
            place = settled(place, stream_data(data, sensor_ids=place.sensor_ids))
        else:
            whole = list(whole)
            place = settled(place, whole)
    return track_unknown(place, whole, feed, **lags).tracks


def calibrate(
    site: Site | File,
    readings: Readings | Fingerprints | File | Columns,
    truth: Truth | File | Columns | None = None,
) -> ranges.Calibration | CalibratedDetections | CalibratedSignals | CalibratedRssi:
    """Learn the sensors' models of a site from a run whose truth is known, or from a survey.

    Of ranges, signals, detections or signal strength, whichever the site's sensors tell. Without
    `truth`, `readings` are `Fingerprints` or their file. The calibrated site is the result's
    `site`; `trackfield.write_site` keeps it. Arguments and errors are those of `track`.
    """
    place = _site(site)
    if truth is None or isinstance(readings, Fingerprints):
        return _surveyed(place, readings, truth)
    table = _readings(place, readings)
    if any(isinstance(model, RssiModel) for model in place.models):
        return calibrate_rssi(place, table, _truth(truth))
    source = source_of(table)
    if source == "detection":
        return calibrate_detection_site(place, table, _truth(truth))
    if source == "signal":
        return calibrate_signal_site(place, table, _truth(truth))
    return ranges.calibrate(place, table, _truth(truth))


def _surveyed(
    site: Site, survey: Readings | Fingerprints | File | Columns, truth: object
) -> CalibratedRssi:
    """Calibrate on a survey, which has no truth but its own places."""
    if truth is not None:
        raise InputError(
            "found fingerprints and a truth, expected no truth: their places are known"
        )
    if isinstance(survey, Fingerprints):
        return calibrate_fingerprints(site, survey)
    if not isinstance(survey, str | Path):
        raise InputError("found readings and no truth, expected where targets really were")
    found = read_fingerprints(survey, sensor_ids=site.sensor_ids)
    learned = calibrate_fingerprints(site, found)
    return replace(learned, site=replace(learned.site, survey_file=Path(survey)))


@overload
def score(
    truth: Truth | File | Columns,
    tracks: Tracks | File,
    *,
    many: Literal[False],
    max_gap_s: float | None = None,
) -> Score: ...


@overload
def score(
    truth: Truth | File | Columns,
    tracks: Tracks | File,
    *,
    many: Literal[True],
    max_gap_s: float | None = None,
    measure: Measure = USUAL,
    tolerance_s: float | None = None,
) -> ManyScore: ...


@overload
def score(
    truth: Truth | File | Columns,
    tracks: Tracks | File,
    *,
    many: bool | None = None,
    max_gap_s: float | None = None,
    measure: Measure = USUAL,
    tolerance_s: float | None = None,
) -> Score | ManyScore: ...


def score(
    truth: Truth | File | Columns,
    tracks: Tracks | File,
    *,
    many: bool | None = None,
    max_gap_s: float | None = None,
    measure: Measure = USUAL,
    tolerance_s: float | None = None,
) -> Score | ManyScore:
    """Compare tracks, or a file of them, with truth: a `Score`, or a `ManyScore` of many targets.

    `many` sets identities of tracks free; where None, it is so for tracks that name no target, if
    there are several. Truth is interpolated between samples at most `max_gap_s` apart; None: 1 s
    where targets have names, else not at all. `measure` and `tolerance_s` are those of
    `trackfield.metrics.many.score_many`. `InputError` where nothing matches.
    """
    known = _truth(truth)
    found = tracks if isinstance(tracks, Tracks) else read_tracks(tracks)
    if many or (many is None and asks_for_many(known, found)):
        gap_s = 0.0 if max_gap_s is None else max_gap_s
        return score_many(known, found, measure=measure, tolerance_s=tolerance_s, max_gap_s=gap_s)
    return score_tagged(known, found, max_gap_s=1.0 if max_gap_s is None else max_gap_s)


def _site(site: Site | File) -> Site:
    return site if isinstance(site, Site) else load_site(site)


def _truth(truth: Truth | File | Columns) -> Truth:
    if isinstance(truth, Truth):
        return truth
    return read_truth(truth) if isinstance(truth, str | Path) else truth_from_columns(truth)


def _is_run(value: object) -> bool:
    """Tell one run from an iterable of chunks; rows of numbers are a run, if a wrong one."""
    whole = isinstance(value, Readings | Reports | Mapping)
    return whole or hasattr(value, "columns") or hasattr(value, "dtype")


def _whole(site: Site, data: Table | Columns) -> Table:
    if isinstance(data, Readings | Reports):
        return data
    return data_from_columns(data, sensor_ids=site.sensor_ids)


def _readings(site: Site, readings: Readings | File | Columns) -> Readings:
    if isinstance(readings, Readings):
        return readings
    if isinstance(readings, str | Path):
        return read_readings(readings, sensor_ids=site.sensor_ids)
    return readings_from_columns(readings, sensor_ids=site.sensor_ids)
