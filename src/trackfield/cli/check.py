"""`trackfield check`: what is wrong with a site or its data, and which defaults apply."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackfield.cli.output import Json, emit, progress, say, show_table

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.network.survey import Survey


def check(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[
        Path | None, typer.Argument(metavar="[DATA]", help="Readings: CSV, NDJSON, Parquet.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Look at SITE, and at DATA if given: faults, doubts, and the defaults that apply."""
    from trackfield.network.defaults import settings
    from trackfield.network.geometry import geometry
    from trackfield.network.site_file import load_site
    from trackfield.network.survey import data_problems

    loaded = load_site(site)
    places = geometry(loaded)
    survey = _survey(loaded, data) if data is not None else None
    problems = [f"{site}: {problem}" for problem in places.problems]
    if survey is not None:
        problems += [f"{data}: {problem}" for problem in data_problems(survey)]
    applied = settings(loaded)
    result: dict[str, Any] = {
        "ok": not problems,
        "problems": problems,
        "remarks": [f"{site}: {remark}" for remark in places.remarks],
        "sensors": len(loaded.sensor_ids),
        "span_m": places.span_m,
        "settings": {key: setting.to_json() for key, setting in applied.items()},
    }
    if survey is not None:
        result["data"] = _numbers(survey)
    if as_json:
        emit(result)
    else:
        rows = [(key, one.text, one.source) for key, one in applied.items()]
        _show(site, result, rows)
    if problems:
        raise typer.Exit(1)


def _survey(site: Site, data: Path) -> Survey:
    from trackfield.io.measurements import stream_readings
    from trackfield.network.survey import empty_survey, surveyed

    survey = empty_survey(site)
    with progress("reading") as moved:
        for chunk in stream_readings(data, sensor_ids=site.sensor_ids, progress=moved):
            survey = surveyed(survey, chunk)
    return survey


def _numbers(survey: Survey) -> dict[str, Any]:
    from trackfield.network.survey import median_range

    ids = survey.site.sensor_ids
    return {
        "readings": survey.readings,
        "targets": list(survey.targets),
        "first_s": survey.first_s,
        "last_s": survey.last_s,
        "longest_gap_s": survey.longest_gap_s,
        "repeated": survey.repeated,
        "out_of_order": survey.unordered,
        "latest_s": survey.late_s,
        "too_late": survey.behind,
        "median_range_m": median_range(survey),
        "per_sensor": {n: int(k) for n, k in zip(ids, survey.per_sensor, strict=True)},
    }


def _show(site: Path, result: dict[str, Any], rows: list[tuple[str, str, str]]) -> None:
    say(f"{site}: {result['sensors']} sensors on a field of {result['span_m']:.4g} m")
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
    targets = ", ".join(data["targets"]) or "none named"
    say(f"{data['readings']} readings over {duration:.4g} s, targets: {targets}")
    say(f"longest silence {silence:.4g} s; middle range {data['median_range_m']:.4g} m")
    say(
        f"{data['repeated']} repeated; {data['out_of_order']} out of order, by at most "
        f"{data['latest_s']:.4g} s; {data['too_late']} too late for the tracker's window"
    )
    silent = [name for name, count in data["per_sensor"].items() if not count]
    if silent:
        say(f"silent sensors: {', '.join(silent)}")
