"""`trackfield check`: what is wrong with a site or its data, and which defaults apply."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trackfield.cli.output import Json, emit, naming, progress, say, show_table
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.network.defaults import Setting
    from trackfield.network.site import Site
    from trackfield.network.survey import Survey
    from trackfield.network.timing import Timing


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
    from trackfield.network.kinds import untracked
    from trackfield.network.site_file import load_site

    loaded = load_site(site)
    places = geometry(loaded)
    of_reports = data is not None and holds_reports(data)
    # Only who is located by ranges alone needs sensors that stand well for ranges.
    ranged = _measures_ranges(loaded) and not untracked(loaded.models) and not of_reports
    problems = [f"{site}: {problem}" for problem in places.problems if ranged]
    look = None
    if data is not None:
        look = _look_at_reports(loaded, data) if of_reports else _look_at_readings(loaded, data)
        problems += look.problems
    applied = _settings(loaded, look.site if look else loaded)
    result: dict[str, Any] = {
        "ok": not problems,
        "problems": problems,
        "remarks": [f"{site}: {remark}" for remark in places.remarks if ranged],
        "sensors": len(loaded.sensor_ids),
        "span_m": places.span_m,
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


def _measures_ranges(site: Site) -> bool:
    from trackfield.sensing.range import RangeModel

    return any(isinstance(model, RangeModel) for model in site.models)


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
    from trackfield.network.kinds import untracked
    from trackfield.network.survey import data_problems, empty_survey, surveyed
    from trackfield.pipeline.extent import settled

    ranged = _measures_ranges(site)
    if not ranged:
        with naming(data):
            site = settled(site, stream_readings(data, sensor_ids=site.sensor_ids))
    survey = empty_survey(site)
    with progress("reading") as moved:
        for chunk in stream_readings(data, sensor_ids=site.sensor_ids, progress=moved):
            survey = surveyed(survey, chunk)
    problems = [
        f"{site.name}: found sensors of kind {kind!r}, whose readings no tracker takes yet"
        for kind in untracked(site.models)
    ]
    problems += [f"{data}: {problem}" for problem in data_problems(survey)]
    if not ranged:
        problems += _scene_problems(site, of_signals=True)
    return Look(site, _numbers(survey), problems)


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
    from trackfield.network.survey import median_range

    ids = survey.site.sensor_ids
    return {
        "readings": survey.timing.rows,
        "targets": list(survey.targets),
        **_times(survey.timing),
        "median_range_m": median_range(survey) if survey.of_ranges else None,
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
        middle = data["median_range_m"]
        told = "" if middle is None else f"; middle range {middle:.4g} m"
        say(f"{data['readings']} readings over {duration:.4g} s, targets: {targets}")
        say(f"longest silence {silence:.4g} s{told}")
    say(
        f"{data['repeated']} repeated; {data['out_of_order']} out of order, by at most "
        f"{data['latest_s']:.4g} s; {data['too_late']} too late for the tracker's window"
    )
    silent = [name for name, count in data.get("per_sensor", {}).items() if not count]
    if silent:
        say(f"silent sensors: {', '.join(silent)}")
