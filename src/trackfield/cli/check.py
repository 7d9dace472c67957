"""`trackfield check`: what is wrong with a site or its data, and which defaults apply."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trackfield.cli.output import Json, emit, naming, progress, say, show_table
from trackfield.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from trackfield.network.defaults import Setting
    from trackfield.network.kinds import Family
    from trackfield.network.site import Site
    from trackfield.network.survey import Survey
    from trackfield.network.timing import Timing

_UNKNOWN = ("signal", "detection")  # families whose targets have no names


class Look(NamedTuple):
    """What data look like: the site with what they settle, numbers for `--json`, and problems."""

    site: Site
    numbers: dict[str, Any]
    problems: list[str]


def check(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[
        Path | None,
        typer.Argument(metavar="[DATA]", help="Readings or reports: CSV, NDJSON, Parquet."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Look at SITE, and at DATA if given: faults, doubts, and the defaults that apply."""
    from trackfield.io.data import holds_reports
    from trackfield.network.geometry import geometry
    from trackfield.network.needs import Needs, needs
    from trackfield.network.site_file import load_site

    loaded = load_site(site)
    of_reports = data is not None and holds_reports(data)
    found = Needs() if of_reports else needs(loaded)
    problems = [f"{site}: {problem}" for problem in found.problems]
    look = None
    if data is not None:
        look = _look_at_reports(loaded, data) if of_reports else _look_at_readings(loaded, data)
        problems += look.problems
    applied = _settings(loaded, look.site if look else loaded)
    result: dict[str, Any] = {
        "ok": not problems,
        "problems": problems,
        "remarks": [f"{site}: {remark}" for remark in found.remarks],
        "sensors": len(loaded.sensor_ids),
        "span_m": geometry(loaded).span_m,
        "settings": {key: setting.to_json() for key, setting in applied.items()},
    }
    if look is not None:
        result["data"] = look.numbers
    if as_json:
        emit(result)
    else:
        rows = [(key, one.text, one.source) for key, one in applied.items()]
        _show(site, result, rows)
    if problems:
        raise typer.Exit(1)


def _settings(told: Site, settled: Site) -> dict[str, Setting]:
    """All settings that apply, with what the data settle of those that the site leaves open."""
    from trackfield.network.defaults import settings

    open_ones = settings(told)
    return {
        key: one._replace(source="derived") if open_ones[key].source == "derived" else one
        for key, one in settings(settled).items()
    }


def _look_at_readings(site: Site, data: Path) -> Look:
    from trackfield.io.measurements import stream_readings
    from trackfield.network.survey import data_problems, empty_survey, surveyed
    from trackfield.pipeline.extent import settled

    family, problems = _family(site, data)
    if family in _UNKNOWN:
        with naming(data):
            site = settled(site, stream_readings(data, sensor_ids=site.sensor_ids))
    survey = empty_survey(site)
    with progress("reading") as moved:
        for chunk in stream_readings(data, sensor_ids=site.sensor_ids, progress=moved):
            survey = surveyed(survey, chunk)
    if survey.family in (family, None):  # else values are in the unit of something else
        problems += [f"{data}: {problem}" for problem in data_problems(survey)]
    if family in _UNKNOWN:
        problems += _scene_problems(site, of_signals=True)
    return Look(site, _numbers(survey), problems)


def _family(site: Site, data: Path) -> tuple[Family | None, list[str]]:
    """Tell of which family the readings are, and what keeps them from being tracked here."""
    from trackfield.io.measurements import stream_readings
    from trackfield.pipeline.dispatch import family_of, tracker_of

    first = next(stream_readings(data, sensor_ids=site.sensor_ids))
    try:
        family = family_of(first)
    except InputError as error:
        return None, [f"{data}: {error}"]
    if family in ("range", *_UNKNOWN):
        return family, []  # ranges: their geometry is told already
    try:
        tracker_of(site, family)
    except ConfigurationError as error:
        return family, error.problems
    return family, []


def _look_at_reports(site: Site, data: Path) -> Look:
    from trackfield.io.reports import stream_reports
    from trackfield.pipeline.extent import settled
    from trackfield.pipeline.report_survey import no_reports, with_reports

    site = settled(site, stream_reports(data))
    survey = no_reports(site)
    with progress("reading") as moved:
        for chunk in stream_reports(data, progress=moved):
            survey = with_reports(survey, chunk)
    numbers = {
        "reports": survey.timing.rows,
        **_times(survey.timing),
        "outside": survey.outside,
        "reports_a_step": survey.per_step,
        "mean_delay_s": survey.mean_delay_s,
    }
    return Look(site, numbers, _scene_problems(site))


def _scene_problems(site: Site, *, of_signals: bool = False) -> list[str]:
    """Say what a tracker of unknown targets lacks."""
    from trackfield.pipeline.scene import scene

    try:
        scene(site, of_signals=of_signals)
    except ConfigurationError as error:
        return error.problems
    return []


def _times(timing: Timing) -> dict[str, Any]:
    return {
        "first_s": timing.first_s,
        "last_s": timing.last_s,
        "longest_gap_s": timing.longest_gap_s,
        "repeated": timing.repeated,
        "out_of_order": timing.unordered,
        "latest_s": timing.late_s,
        "too_late": timing.behind,
    }


def _numbers(survey: Survey) -> dict[str, Any]:
    from trackfield.network.survey import median_value

    ids = survey.site.sensor_ids
    return {
        "readings": survey.timing.rows,
        "targets": list(survey.targets),
        **_times(survey.timing),
        "median_range_m": median_value(survey) if survey.family == "range" else None,
        "median_rssi_dbm": median_value(survey) if survey.family == "rssi" else None,
        "per_sensor": {n: int(k) for n, k in zip(ids, survey.per_sensor, strict=True)},
    }


def _show(site: Path, result: dict[str, Any], rows: list[tuple[str, str, str]]) -> None:
    if result["sensors"]:
        say(f"{site}: {result['sensors']} sensors on a field of {result['span_m']:.4g} m")
    else:
        say(f"{site}: no sensors, for data that are positions")
    show_table(("setting", "value", ""), rows)
    data: dict[str, Any] | None = result.get("data")
    if data is not None:
        _show_data(data)
    for remark in result["remarks"]:
        say(f"remark: {remark}")
    for problem in result["problems"]:
        say(f"problem: {problem}")
    count = len(result["problems"])
    say(f"found {count or 'no'} problem{'s' if count > 1 else ''}")


def _show_data(data: dict[str, Any]) -> None:
    duration, silence = data["last_s"] - data["first_s"], data["longest_gap_s"]
    if "reports" in data:
        delay = data["mean_delay_s"]
        told = "" if delay is None else f"; they arrive {delay:.4g} s late in the mean"
        say(
            f"{data['reports']} reports over {duration:.4g} s, {data['outside']} outside the region"
        )
        say(f"longest silence {silence:.4g} s; {data['reports_a_step']:.4g} a step{told}")
    else:
        targets = ", ".join(data["targets"]) or "none named"
        middles = data["median_range_m"], data["median_rssi_dbm"]
        words = ("; middle range {:.4g} m", "; middle strength {:.4g} dBm")
        told = "".join(
            word.format(one) for word, one in zip(words, middles, strict=True) if one is not None
        )
        say(f"{data['readings']} readings over {duration:.4g} s, targets: {targets}")
        say(f"longest silence {silence:.4g} s{told}")
    say(
        f"{data['repeated']} repeated; {data['out_of_order']} out of order, by at most "
        f"{data['latest_s']:.4g} s; {data['too_late']} too late for the tracker's window"
    )
    silent = [name for name, count in data.get("per_sensor", {}).items() if not count]
    if silent:
        say(f"silent sensors: {', '.join(silent)}")
