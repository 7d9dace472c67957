"""Binary sensors on the command line: a run with truth in, their learned models out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackfield.cli.output import naming, number, say, show_table

if TYPE_CHECKING:
    from trackfield.calibration.detection_site import CalibratedDetections
    from trackfield.network.site import Site

_SHARED = {"radius_m": "radius [m]", "p_detection": "p", "p_false": "q", "edge_m": "edge [m]"}


def calibrated_detections(
    site: Site, data: Path, truth: Path, moved: Callable[[float], None]
) -> CalibratedDetections:
    """Fit the binary sensors of a site to files."""
    from trackfield.calibration.detection_site import calibrate_detection_site
    from trackfield.io.measurements import read_readings
    from trackfield.io.truth import read_truth

    known = read_truth(truth)
    readings = read_readings(data, sensor_ids=site.sensor_ids, progress=moved)
    with naming(data, truth):
        return calibrate_detection_site(site, readings, known)


def detection_numbers(found: CalibratedDetections) -> dict[str, Any]:
    """Say what was learned, for JSON."""
    learned = found.calibration
    pooled, errors = learned.pooled, learned.errors
    return {
        "steps": learned.given,
        "used": learned.used,
        "clock_offset_s": learned.clock_offset_s,
        "clock_error_s": learned.clock_error_s if isfinite(learned.clock_error_s) else None,
        "pooled": {name: getattr(pooled, name) for name in _SHARED},
        "pooled_errors": {
            name: error if isfinite(error) else None for name, error in errors._asdict().items()
        },
        "sensors": [
            {"sensor_id": name, **row._asdict()}
            for name, row in zip(found.sensor_ids, learned.sensors, strict=True)
        ],
    }


def show_detections(result: dict[str, Any]) -> None:
    """Tell what all sensors share, which are broken, and how the clocks stand."""
    rows = [
        (word, f"{number(result['pooled'][name])} ± {number(result['pooled_errors'][name])}")
        for name, word in _SHARED.items()
    ]
    show_table(("of all sensors", ""), rows)
    health = Counter(row["health"] for row in result["sensors"])
    say(f"{len(result['sensors'])} sensors: {', '.join(f'{n} {h}' for h, n in health.items())}")
    for word in ("dead", "babbling"):
        names = [row["sensor_id"] for row in result["sensors"] if row["health"] == word]
        if names:
            say(f"{word}: {', '.join(names)}")
    error = number(result["clock_error_s"])
    say(f"clock of the readings: {result['clock_offset_s']:+.3f} ± {error} s to the truth's")
    say(f"{result['used']} of {result['steps']} steps had truth beside them")
    say(f"{result['site']}: written; sensors stand as in {result['sensors_file'] or 'it'}")
