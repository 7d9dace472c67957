"""`trackfield calibrate`: a run with truth, or a survey, in; a calibrated site out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from trackfield.cli.output import Json, check_figure, check_output, emit, progress, warn
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.calibration.ranges import Method
    from trackfield.cli.learned import Learned
    from trackfield.network.site import Site

CalibratedKind = Literal["range", "signal", "detection", "rssi"]


def calibrate(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[
        Path,
        typer.Argument(
            metavar="DATA",
            help="Readings (CSV, NDJSON, Parquet), or fingerprints of a survey (CSV).",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="SITE", help="Where the site is written.")
    ],
    truth: Annotated[
        Path | None,
        typer.Argument(metavar="TRUTH", help="Where targets really were; a survey needs none."),
    ] = None,
    method: Annotated[
        str,
        typer.Option(metavar="M", help="robust, or Wang's statistics: weighted or least-squares."),
    ] = "robust",
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw how well the models fit.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit the sensors' models of SITE to the readings of DATA, knowing the TRUTH.

    Where sensors tell signal strength, DATA may be a survey: fingerprints of known places.
    """
    from trackfield.network.site_file import load_site
    from trackfield.network.site_writer import sensors_file_for, write_site

    chosen = parse_method(method)
    loaded = load_site(site)
    inputs = (data, truth, loaded.sensors_file, loaded.survey_file)
    check_output(output, inputs)
    if plot is not None:
        check_figure(plot)
        check_output(plot, (site, *inputs))
    kind = kind_of_all(loaded)
    check_options(site, kind, method=chosen, plot=plot)
    check_truth(data, truth, kind=kind)
    with progress("calibrating") as moved:
        learned = learn(loaded, data, truth, moved, kind=kind, method=chosen)
    for warning in learned.warnings:
        warn(warning)
    comment = f"Calibrated on {data.name}{f' with {truth.name}' if truth else ''}."
    write_site(learned.site, output, comment=comment)
    file = loaded.sensors_file
    result: dict[str, Any] = {
        "site": str(output),
        "sensors_file": str(sensors_file_for(file, output.parent)) if file else None,
        **learned.numbers,
        "warnings": learned.warnings,
    }
    if plot is not None and learned.draw is not None:
        learned.draw(f"{loaded.name}: calibration on {data.name}", plot)
        result["plot"] = str(plot)
    if as_json:
        emit(result)
        return
    learned.show(result)


def learn(
    site: Site,
    data: Path,
    truth: Path | None,
    moved: Callable[[float], None],
    *,
    kind: CalibratedKind,
    method: Method,
) -> Learned:
    """Fit the sensors of a site, all of one `kind`, to files."""
    from trackfield.cli.calibrate_fields import learned_field
    from trackfield.cli.calibrate_ranges import learned_ranges
    from trackfield.cli.calibrate_rssi import learned_rssi

    if truth is None or kind == "rssi":
        return learned_rssi(site, data, truth, moved)
    if kind == "range":
        return learned_ranges(site, data, truth, moved, method=method)
    return learned_field(site, data, truth, moved, kind=kind)


def kind_of_all(site: Site) -> CalibratedKind:
    """Kind of all sensors of a site.

    `ConfigurationError` where there are several kinds, or one that cannot be calibrated yet.
    """
    from trackfield.network.kinds import kind_of

    match sorted({kind_of(model) for model in site.models}):
        case ["detection" | "signal" | "rssi" as kind]:
            return kind
        case [] | ["range"]:
            return "range"
        case [kind]:
            found = f"found sensors of kind {kind!r}"
            expected = (
                "ranges, signals, detections or signal strength: others cannot be calibrated yet"
            )
            raise ConfigurationError([f"site {site.name}: {found}, expected {expected}"])
        case kinds:
            found = f"found sensors of kinds {', '.join(kinds)}"
            raise ConfigurationError([f"site {site.name}: {found}, expected one kind"])


def check_options(site: Path, kind: CalibratedKind, *, method: Method, plot: Path | None) -> None:
    """Refuse options that are for other kinds of sensors."""
    if kind != "range" and method != "robust":
        problem = f"found --method, which is for ranges, on a site of kind {kind!r}"
        raise ConfigurationError([f"{site}: {problem}"])
    if kind in {"signal", "detection"} and plot is not None:
        problem = f"found --plot, which is for ranges and signal strength, on a site of {kind}s"
        raise ConfigurationError([f"{site}: {problem}"])


def check_truth(data: Path, truth: Path | None, *, kind: CalibratedKind) -> None:
    """Refuse a survey with a truth, or without sensors of signal strength; a run without truth."""
    from trackfield.io.fingerprints import holds_fingerprints

    survey = holds_fingerprints(data)
    if survey and kind != "rssi":
        problem = f"found fingerprints for sensors of kind {kind!r}, expected readings"
    elif survey and truth is not None:
        problem = f"found fingerprints, whose places are known, expected no truth such as {truth}"
    elif truth is None and not survey:
        columns = "sensor_id, x_m, y_m, mean_dbm"
        expected = f"where targets really were, or fingerprints ({columns}) as DATA"
        problem = f"found no TRUTH, expected {expected}"
    else:
        return
    raise ConfigurationError([f"{data}: {problem}"])


def parse_method(text: str) -> Method:
    """Read the name of a way to calibrate; `least-squares` needs no quotes on a command line."""
    match text.replace("-", " "):
        case "robust" | "weighted" | "least squares" as method:
            return method
        case _:
            expected = "robust, weighted or least-squares"
            raise ConfigurationError([f"--method: found {text!r}, expected {expected}"])
