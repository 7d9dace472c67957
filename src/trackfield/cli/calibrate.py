"""`trackfield calibrate`: a run with truth in, a site with calibrated sensors out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackfield.cli.output import Json, check_figure, emit, number, progress, say, show_table

if TYPE_CHECKING:
    from trackfield.calibration import Calibration


def calibrate(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Readings: CSV, NDJSON, Parquet.")],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Where targets really were.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="SITE", help="Where the site is written.")
    ],
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw how well the models fit.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit the sensors' models of SITE to the readings of DATA, knowing the TRUTH."""
    from trackfield.calibration import calibrate as fit
    from trackfield.io.measurements import read_readings
    from trackfield.io.truth import read_truth
    from trackfield.network.site_file import load_site
    from trackfield.network.site_writer import write_site

    loaded = load_site(site)
    if plot is not None:
        check_figure(plot)
    with progress("reading") as moved:
        readings = read_readings(data, sensor_ids=loaded.sensor_ids, progress=moved)
    calibration = fit(loaded, readings, read_truth(truth))
    write_site(calibration.site, output, comment=f"Calibrated on {data.name} with {truth.name}.")
    result: dict[str, Any] = {"site": str(output), **_numbers(calibration)}
    if plot is not None:
        draw(calibration, plot, title=f"{loaded.name}: calibration on {data.name}")
        result["plot"] = str(plot)
    if as_json:
        emit(result)
        return
    _show(result)


def _numbers(calibration: Calibration) -> dict[str, Any]:
    return {
        "clock_offset_s": calibration.clock_offset_s,
        "sensors": [row._asdict() for row in calibration.report],
    }


def _show(result: dict[str, Any]) -> None:
    rows = [
        [
            row["sensor_id"],
            str(row["n"]),
            f"{number(row['bias_m'])} ± {number(row['bias_se_m'])}",
            f"{number(row['scale'], 4)} ± {number(row['scale_se'], 4)}",
            number(row["sigma_m"]),
        ]
        for row in result["sensors"]
    ]
    show_table(("sensor", "readings", "bias [m]", "scale", "sigma [m]"), rows)
    say(f"clock of the readings behind that of the truth by {result['clock_offset_s']:.3f} s")
    say(f"{result['site']}: written")


def draw(calibration: Calibration, path: Path, *, title: str) -> None:
    """Draw the residuals of a calibration."""
    from trackfield.plotting import Residuals, plot_calibration, save

    save(
        plot_calibration(
            Residuals(*calibration.residuals), calibration.site.sensor_ids, title=title
        ),
        path,
    )
