"""Ranges on the command line: a run with truth in, learned models out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from trackfield.cli.learned import Learned
from trackfield.cli.output import naming, number, say, show_table

if TYPE_CHECKING:
    from trackfield.calibration.ranges import Calibration, Method
    from trackfield.network.site import Site


class Fitted(NamedTuple):
    """A calibration, the names of the targets that its readings know, and what looked odd."""

    calibration: Calibration
    target_ids: tuple[str, ...]
    warnings: list[str]


def learned_ranges(
    site: Site, data: Path, truth: Path, moved: Callable[[float], None], *, method: Method
) -> Learned:
    """Fit a site to files."""
    calibration, target_ids, warnings = calibrated(site, data, truth, moved, method=method)

    def draw(title: str, path: Path) -> None:
        from trackfield.plotting.calibration import plot_calibration
        from trackfield.plotting.style import save

        save(plot_calibration(calibration, target_ids=target_ids, title=title), path)

    return Learned(calibration.site, _numbers(calibration), _show, warnings, draw)


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


def _show(result: Mapping[str, Any]) -> None:
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
