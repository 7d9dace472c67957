"""Signal strength on the command line: a survey, or a run with truth, in; learned models out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackfield.cli.learned import Learned
from trackfield.cli.output import naming, number, say, show_table

if TYPE_CHECKING:
    from trackfield.calibration.rssi_site import CalibratedRssi
    from trackfield.network.site import Site
    from trackfield.sensing.rssi import RssiModel

_HARDLY = 0.5  # an exponent of a quarter of the receivers below which something else is wrong
_POOLED = {
    "power_dbm": "power at 1 m [dBm]",
    "exponent": "exponent",
    "sigma_db": "noise [dB]",
    "shadow_db": "shadow [dB]",
    "shadow_m": "its length [m]",
    "fading_db": "fading [dB]",
    "p_blocked": "share blocked",
    "p_outlier": "share of outliers",
}


def learned_rssi(
    site: Site, data: Path, truth: Path | None, moved: Callable[[float], None]
) -> Learned:
    """Fit the receivers of a site to files; without a `truth`, to a survey."""
    from trackfield.calibration.fingerprints import calibrate_fingerprints
    from trackfield.calibration.rssi import calibrate_rssi
    from trackfield.io.fingerprints import read_fingerprints
    from trackfield.io.measurements import read_readings
    from trackfield.io.truth import read_truth

    if truth is None:
        survey = read_fingerprints(data, sensor_ids=site.sensor_ids)
        with naming(data):
            found = calibrate_fingerprints(site, survey)
        return _learned(replace(found.site, survey_file=data), found)
    known = read_truth(truth)
    readings = read_readings(data, sensor_ids=site.sensor_ids, progress=moved)
    with naming(data, truth):
        found = calibrate_rssi(site, readings, known)
    return _learned(found.site, found)


def _show(result: Mapping[str, Any]) -> None:
    """Tell what was learned of each receiver, and how well a fingerprint left out is foretold."""
    rows = [
        [
            row["sensor_id"],
            str(row["fingerprints"]),
            f"{number(row['power_dbm'], 1)} ± {number(row['power_error_db'], 1)}",
            f"{number(row['exponent'], 2)} ± {number(row['exponent_error'], 2)}",
            number(row["sigma_db"], 1),
            number(row["off_db"], 1),
        ]
        for row in result["sensors"]
    ]
    head = ("sensor", "places", "power [dBm]", "exponent", "noise [dB]", "left out [dB]")
    show_table(head, rows)
    show_table(
        ("of all sensors", ""), [(_POOLED[k], number(v, 2)) for k, v in result["pooled"].items()]
    )
    off = result["left_out_db"]
    say(
        f"a place that is left out is foretold to {number(off['map'], 2)} dB, "
        f"by the law alone to {number(off['law'], 2)} dB; expected {number(off['expected'], 2)} dB"
    )
    say(f"{result['used']} of {result['readings']} {result['what']} used, {result['odd']} odd")
    say(f"{result['site']}: written; sensors stand as in {result['sensors_file'] or 'it'}")


def _learned(site: Site, found: CalibratedRssi) -> Learned:
    numbers = {
        "what": "readings" if site.survey_file is None else "fingerprints",
        "readings": found.given,
        "used": found.used,
        "odd": found.odd,
        "left_out_db": {
            "map": found.map_error_db,
            "law": found.law_error_db,
            "expected": found.expected_error_db,
        },
        "pooled": _pooled(found.pooled),
        "sensors": [row._asdict() for row in found.receivers],
    }

    def draw(title: str, path: Path) -> None:
        from trackfield.plotting.rssi import plot_rssi_calibration
        from trackfield.plotting.style import save

        save(plot_rssi_calibration(found, title=title), path)

    return Learned(site, numbers, _show, _doubts(found), draw)


def _doubts(found: CalibratedRssi) -> list[str]:
    """Say if strength hardly falls with distance: then places are not what they seem."""
    exponents = sorted(row.exponent for row in found.receivers if row.fingerprints)
    low = exponents[len(exponents) // 4]
    if low > _HARDLY:
        return []
    return [
        f"strength hardly falls with distance for many receivers (exponent {low:.2g}, usual are "
        "1.5 to 4): are places and sensors in the same frame, and in metres?"
    ]


def _pooled(model: RssiModel) -> dict[str, float]:
    return {name: getattr(model, name) for name in _POOLED}
