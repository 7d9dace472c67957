"""Sensors that name no target on the command line: a run with truth in, learned models out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from trackfield.cli.learned import Learned
from trackfield.cli.output import naming, number, say, show_table

if TYPE_CHECKING:
    from trackfield.calibration.detection_site import CalibratedDetections
    from trackfield.calibration.signal_site import CalibratedSignals
    from trackfield.network.site import Site

FieldKind = Literal["detection", "signal"]

_OF_DETECTIONS = {
    "radius_m": "radius [m]",
    "p_detection": "p",
    "p_false": "q",
    "edge_m": "edge [m]",
}
_OF_SIGNALS = {
    "amplitude": "amplitude",
    "falloff": "falloff",
    "exponent": "exponent",
    "sigma": "sigma",
    "sigma_gain": "spread of gains",
}


def learned_field(
    site: Site, data: Path, truth: Path, moved: Callable[[float], None], *, kind: FieldKind
) -> Learned:
    """Fit the sensors of a site, all of one kind, to files."""
    from trackfield.calibration.detection_site import calibrate_detection_site
    from trackfield.calibration.signal_site import calibrate_signal_site
    from trackfield.io.measurements import read_readings
    from trackfield.io.truth import read_truth

    known = read_truth(truth)
    readings = read_readings(data, sensor_ids=site.sensor_ids, progress=moved)
    with naming(data, truth):
        if kind == "detection":
            return _of_detections(calibrate_detection_site(site, readings, known))
        return _of_signals(calibrate_signal_site(site, readings, known))


def _learned(site: Site, numbers: dict[str, Any], told: list[str]) -> Learned:
    def show(result: Mapping[str, Any]) -> None:
        _show(result, told)

    return Learned(site, numbers, show, [])


def _show(result: Mapping[str, Any], told: list[str]) -> None:
    """Tell what all sensors share, and the rest as lines."""
    words = {**_OF_DETECTIONS, **_OF_SIGNALS}
    errors = result["pooled_errors"]
    rows = [
        (words[name], number(value) + (f" ± {number(errors[name])}" if name in errors else ""))
        for name, value in result["pooled"].items()
    ]
    show_table(("of all sensors", ""), rows)
    for line in told:
        say(line)
    say(f"{result['site']}: written; sensors stand as in {result['sensors_file'] or 'it'}")


def _of_detections(found: CalibratedDetections) -> Learned:
    learned = found.calibration
    health = Counter(row.health for row in learned.sensors)
    error = learned.clock_error_s if isfinite(learned.clock_error_s) else None
    broken = {
        word: [
            n
            for n, row in zip(found.sensor_ids, learned.sensors, strict=True)
            if row.health == word
        ]
        for word in ("dead", "babbling")
    }
    told = [
        f"{len(learned.sensors)} sensors: {', '.join(f'{n} {word}' for word, n in health.items())}",
        *(f"{word}: {', '.join(names)}" for word, names in broken.items() if names),
        f"clock of the readings: {learned.clock_offset_s:+.3f} ± {number(error)} s to the truth's",
        f"{learned.used} of {learned.given} steps had truth beside them",
    ]
    numbers = {
        "steps": learned.given,
        "used": learned.used,
        "clock_offset_s": learned.clock_offset_s,
        "clock_error_s": error,
        "pooled": {name: getattr(learned.pooled, name) for name in _OF_DETECTIONS},
        "pooled_errors": _known(learned.errors._asdict()),
        "sensors": [
            {"sensor_id": name, **row._asdict()}
            for name, row in zip(found.sensor_ids, learned.sensors, strict=True)
        ],
    }
    return _learned(found.site, numbers, told)


def _of_signals(found: CalibratedSignals) -> Learned:
    learned = found.calibration
    broken = [name for name, odd in zip(found.sensor_ids, learned.broken, strict=True) if odd]
    told = [
        *([f"broken: {', '.join(broken)}"] if broken else []),
        f"{learned.used} of {learned.given} readings were near a target",
    ]
    numbers = {
        "readings": learned.given,
        "used": learned.used,
        "pooled": {name: getattr(learned.pooled, name) for name in _OF_SIGNALS},
        "pooled_errors": _known(learned.errors._asdict()),
        "sensors": [
            {"sensor_id": name, "gain": gain, "gain_error": error, "broken": odd}
            for name, gain, error, odd in zip(
                found.sensor_ids,
                learned.gain.tolist(),
                learned.gain_error.tolist(),
                learned.broken.tolist(),
                strict=True,
            )
        ],
    }
    return _learned(found.site, numbers, told)


def _known(errors: Mapping[str, float]) -> dict[str, float | None]:
    """Put None for the error of what was not learned."""
    return {name: error if isfinite(error) else None for name, error in errors.items()}
