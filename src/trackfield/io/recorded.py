"""Public recordings that installed packages carry: UWB ranges of a robot mower.

Plaza 1 and 2: J. Djugash, B. Hamner, S. Roth, "Navigating with Ranging Radios: Five Data Sets with
Ground Truth", Journal of Field Robotics 26 (2009); carried by gtsam (BSD-3).
"""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.io.measurements import write_readings
from trackfield.io.output import replacing, saying
from trackfield.io.truth import write_truth
from trackfield.network.kinds import KINDS
from trackfield.network.site import Site
from trackfield.sensing.range import UNCALIBRATED
from trackfield.types import Readings, Truth

FILES = {"plaza1": "Plaza1_.mat", "plaza2": "Plaza2_.mat"}
TARGET = "mower"
_MODEL = "uwb"

_SITE = """\
# {name}: ranges of a robot mower to four UWB radios, with positions from GPS and odometry.
# J. Djugash, B. Hamner, S. Roth, "Navigating with Ranging Radios: Five Data Sets with Ground
# Truth", Journal of Field Robotics 26 (2009); carried by gtsam (BSD-3).

[site]
name = "{name}"
sensors_file = "sensors.csv"

[models.{model}]
kind = "range"
"""


class Recording(NamedTuple):
    """A run: where the sensors stand, what they said, and where the target really was."""

    site: Site
    readings: Readings
    truth: Truth


def recorded(name: str) -> Recording:
    """Load `plaza1` or `plaza2`; times start with the first reading, heights are unknown.

    Truth starts a little earlier, at negative times. `InputError` for another name, and where the
    package `gtsam` that carries the data is not installed.
    """
    data = _load(name)
    said, truth, radios = data["TD"], data["GT"], data["TL"]
    # Plaza 1 was logged in three parts that overlap by about a minute, so its clock steps back
    # twice. All parts agree with the truth at their own times, and not at shifted ones: the times
    # are right, only the order is not. The sort is stable, to keep the order of equal times.
    said = said[np.argsort(said[:, 0], kind="stable")]
    start = said[0, 0]
    sensor_ids = tuple(str(int(radio)) for radio in radios[:, 0])
    places = {sensor_id: place for place, sensor_id in enumerate(sensor_ids)}
    count = len(said)
    readings = Readings(
        t_s=_micro(said[:, 0] - start),
        sensor=np.array([places[str(int(radio))] for radio in said[:, 2]], np.int32),
        value=_micro(said[:, 3]),
        target=np.zeros(count, np.int32),
        kind=np.zeros(count, np.int32),
        sigma=np.full(count, np.nan),
        arrival_s=np.full(count, np.nan),
        sensor_ids=sensor_ids,
        target_ids=(TARGET,),
        kinds=tuple(KINDS),
    )
    site = Site(
        name=name,
        sensor_ids=sensor_ids,
        positions=_flat(radios[:, 1:3]),
        models=(UNCALIBRATED,) * len(sensor_ids),
        model_names=(_MODEL,) * len(sensor_ids),
    )
    path = Truth(
        t_s=_micro(truth[:, 0] - start),
        target=np.zeros(len(truth), np.int32),
        position=_flat(truth[:, 1:3]),
        target_ids=(TARGET,),
    )
    return Recording(site, readings, path)


def write_recorded(name: str, folder: str | Path) -> None:
    """Write a recording into `folder`: site.toml, sensors.csv, measurements.csv, truth.csv.

    The folder is made if it is not there. `InputError` as `recorded`, and where it cannot be
    written.
    """
    recording = recorded(name)
    folder = Path(folder)
    with saying(folder):
        folder.mkdir(parents=True, exist_ok=True)
    site = recording.site
    rows = zip(site.sensor_ids, site.positions.tolist(), strict=True)
    sensors = "".join(f"{sensor_id},{x!r},{y!r},\n" for sensor_id, (x, y, _) in rows)
    _write(folder / "sensors.csv", "sensor_id,x_m,y_m,z_m\n" + sensors)
    write_readings(folder / "measurements.csv", recording.readings)
    write_truth(folder / "truth.csv", recording.truth)
    _write(folder / "site.toml", _SITE.format(name=name, model=_MODEL))


def _load(name: str) -> dict[str, NDArray[np.float64]]:
    if name not in FILES:
        known = ", ".join(FILES)
        raise InputError(f"found recording {name!r}, expected one of: {known}")
    # Found without being imported: the package takes a second to load, its data none.
    package = importlib.util.find_spec("gtsam")
    folders = (package.submodule_search_locations if package else None) or []
    files = [file for folder in folders if (file := Path(folder, "Data", FILES[name])).is_file()]
    if not files:
        raise InputError(
            f"{name}: found no package gtsam, which carries the recording: "
            'pip install "trackfield[recorded]"'
        )
    loadmat = importlib.import_module("scipy.io").loadmat
    content: dict[str, Any] = loadmat(files[0])
    return {key: np.asarray(content[key], np.float64) for key in ("TD", "GT", "TL")}


def _micro(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to 1e-6: differences of times and scaled ranges have no more digits that mean it."""
    return np.round(values, 6) + 0.0  # no -0


def _flat(position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (n, 3) of (n, 2), z unknown."""
    return np.column_stack([_micro(position), np.full(len(position), np.nan)])


def _write(path: Path, text: str) -> None:
    with replacing(path) as file, saying(path):
        file.write(text.encode())
