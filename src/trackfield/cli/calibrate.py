"""`trackfield calibrate`: a run with truth in, a site with calibrated sensors out."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trackfield.cli.output import (
    Json,
    check_figure,
    check_output,
    emit,
    naming,
    number,
    progress,
    say,
    show_table,
    warn,
)
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.calibration.ranges import Calibration, Method
    from trackfield.cli.calibrate_fields import FieldKind
    from trackfield.network.site import Site


class Fitted(NamedTuple):
    """A calibration, the names of the targets that its readings know, and what looked odd."""

    calibration: Calibration
    target_ids: tuple[str, ...]
    warnings: list[str]


def calibrate(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Readings: CSV, NDJSON, Parquet.")],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Where targets really were.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="SITE", help="Where the site is written.")
    ],
    method: Annotated[
        str,
        typer.Option(metavar="M", help="robust, or Wang's statistics: weighted or least-squares."),
    ] = "robust",
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw how well the models fit.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit the sensors' models of SITE to the readings of DATA, knowing the TRUTH."""
    from trackfield.cli.calibrate_fields import calibrated_field, show_field
    from trackfield.network.site_file import load_site
    from trackfield.network.site_writer import sensors_file_for, write_site

    chosen = parse_method(method)
    loaded = load_site(site)
    inputs = (data, truth, loaded.sensors_file)
    check_output(output, inputs)
    if plot is not None:
        check_figure(plot)
        check_output(plot, (site, *inputs))
    kind = field_kind(loaded)
    if kind is not None and (plot is not None or chosen != "robust"):
        problem = f"found --plot or --method, which are for ranges, on a site of {kind}s"
        raise ConfigurationError([f"{site}: {problem}"])
    file = loaded.sensors_file
    result: dict[str, Any] = {
        "site": str(output),
        "sensors_file": str(sensors_file_for(file, output.parent)) if file else None,
    }
    comment = f"Calibrated on {data.name} with {truth.name}."
    if kind is not None:
        with progress("calibrating") as moved:
            learned = calibrated_field(loaded, data, truth, moved, kind=kind)
        write_site(learned.site, output, comment=comment)
        result |= {**learned.numbers, "warnings": []}
        if as_json:
            emit(result)
        else:
            show_field(result, learned.told)
        return
    with progress("calibrating") as moved:
        calibration, target_ids, warnings = calibrated(loaded, data, truth, moved, method=chosen)
    for warning in warnings:
        warn(warning)
    write_site(calibration.site, output, comment=comment)
    result |= {**_numbers(calibration), "warnings": warnings}
    if plot is not None:
        from trackfield.plotting.calibration import plot_calibration
        from trackfield.plotting.style import save

        title = f"{loaded.name}: calibration on {data.name}"
        save(plot_calibration(calibration, target_ids=target_ids, title=title), plot)
        result["plot"] = str(plot)
    if as_json:
        emit(result)
        return
    _show(result)


def field_kind(site: Site) -> FieldKind | None:
    """Kind of all sensors of a site, if they name no target; None for ranges.

    `ConfigurationError` where there are several kinds, or one that cannot be calibrated yet.
    """
    from trackfield.network.kinds import kind_of

    match sorted({kind_of(model) for model in site.models}):
        case ["detection"]:
            return "detection"
        case ["signal"]:
            return "signal"
        case [] | ["range"]:
            return None
        case [kind]:
            found = f"found sensors of kind {kind!r}"
            expected = "ranges, signals or detections: others cannot be calibrated yet"
            raise ConfigurationError([f"site {site.name}: {found}, expected {expected}"])
        case kinds:
            found = f"found sensors of kinds {', '.join(kinds)}"
            raise ConfigurationError([f"site {site.name}: {found}, expected one kind"])


def parse_method(text: str) -> Method:
    """Read the name of a way to calibrate; `least-squares` needs no quotes on a command line."""
    match text.replace("-", " "):
        case "robust" | "weighted" | "least squares" as method:
            return method
        case _:
            expected = "robust, weighted or least-squares"
            raise ConfigurationError([f"--method: found {text!r}, expected {expected}"])


def calibrated(
    site: Site,
    data: Path,
    truth: Path,
    moved: Callable[[float], None],
    *,
    method: Method = "robust",
) -> Fitted:
    """Fit a site to files."""
    from trackfield.calibration.ranges import calibrate as fit
    from trackfield.io.measurements import read_readings
    from trackfield.io.truth import read_truth
    from trackfield.network.survey import empty_survey, surveyed, unit_suspicion

    known = read_truth(truth)
    readings = read_readings(data, sensor_ids=site.sensor_ids, progress=moved)
    suspicion = unit_suspicion(surveyed(empty_survey(site), readings))
    warnings = [f"{data}: {suspicion}"] if suspicion else []
    with naming(data, truth):
        return Fitted(fit(site, readings, known, method=method), readings.target_ids, warnings)


def _numbers(calibration: Calibration) -> dict[str, Any]:
    """Say what was learned, for JSON."""
    return {
        "readings": calibration.given,
        "used": calibration.used,
        "clock_offset_s": dict(calibration.clock_offset_s),
        "clock_error_s": {
            target: error if isfinite(error) else None  # a clock that nothing tells
            for target, error in calibration.clock_error_s.items()
        },
        "sensors": [row._asdict() for row in calibration.sensors],
    }


def _show(result: dict[str, Any]) -> None:
    several = len(result["clock_offset_s"]) > 1
    rows = [
        [
            f"{row['sensor_id']} of {row['target_id']}" if several else row["sensor_id"],
            str(row["readings"]),
            f"{number(row['bias_m'])} ± {number(row['bias_error_m'])}",
            f"{number(row['scale'], 4)} ± {number(row['scale_error'], 4)}",
            f"{number(row['sigma_m'])} ± {number(row['sigma_error_m'])}",
        ]
        for row in result["sensors"]
    ]
    show_table(("sensor", "readings", "bias [m]", "scale", "sigma [m]"), rows)
    for target, offset in result["clock_offset_s"].items():
        error = result["clock_error_s"][target]
        say(
            f"clock of {target or 'the readings'}: {offset:+.3f} ± {number(error)} s to the truth's"
        )
    say(f"{result['used']} of {result['readings']} readings had truth beside them")
    say(f"{result['site']}: written; sensors stand as in {result['sensors_file'] or 'it'}")
