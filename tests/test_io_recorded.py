"""The recordings that gtsam carries, as tables and as a folder."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from conftest import lacking
from trackfield.errors import InputError
from trackfield.io.measurements import read_readings
from trackfield.io.recorded import recorded, write_recorded
from trackfield.io.truth import read_truth
from trackfield.network.site_file import load_site
from trackfield.sensing.range import UNCALIBRATED

ROWS = {"plaza1": (3529, 9658), "plaza2": (1816, 4091)}


@pytest.fixture
def gtsam() -> None:
    if importlib.util.find_spec("gtsam") is None:
        lacking('the package gtsam (pip install "trackfield[recorded]")')


@pytest.mark.usefixtures("gtsam")
@pytest.mark.parametrize("name", ROWS)
def test_a_recording_is_in_order_and_agrees_with_its_truth(name):
    site, readings, truth = recorded(name)
    assert (len(readings), len(truth)) == ROWS[name]
    assert readings.t_s[0] == 0.0
    assert (np.diff(readings.t_s) >= 0).all()
    assert (np.diff(truth.t_s) > 0).all()
    assert truth.t_s[0] <= 0.0
    assert truth.t_s[-1] >= readings.t_s[-1]

    # Ranges are a line of the true distances but for about half a metre, at every time: parts of
    # plaza1 whose clock was wrong would miss by many metres.
    place = np.column_stack(
        [np.interp(readings.t_s, truth.t_s, truth.position[:, i]) for i in (0, 1)]
    )
    distance = np.hypot(*(place - site.positions[readings.sensor, :2]).T)
    error = readings.value - np.polyval(np.polyfit(distance, readings.value, 1), distance)
    blocks = np.array_split(error, len(error) // 50)
    assert max(np.sqrt(np.mean(block**2)) for block in blocks) < 1.0


@pytest.mark.usefixtures("gtsam")
@pytest.mark.parametrize("name", ROWS)
def test_a_folder_says_the_same(tmp_path, name):
    site, readings, truth = recorded(name)
    write_recorded(name, tmp_path / "new" / name)
    folder = tmp_path / "new" / name
    assert sorted(path.name for path in folder.iterdir()) == [
        "measurements.csv",
        "sensors.csv",
        "site.toml",
        "truth.csv",
    ]
    loaded = load_site(folder / "site.toml")
    assert loaded.name == name
    assert loaded.sensor_ids == site.sensor_ids
    assert loaded.models == (UNCALIBRATED,) * 4 == site.models  # nothing is tuned
    assert loaded.model_names == site.model_names
    np.testing.assert_array_equal(loaded.positions, site.positions)
    found = read_readings(folder / "measurements.csv", sensor_ids=loaded.sensor_ids)
    for column, expected in readings.to_numpy().items():
        np.testing.assert_array_equal(found.to_numpy()[column], expected)
    for column, expected in truth.to_numpy().items():
        np.testing.assert_array_equal(read_truth(folder / "truth.csv").to_numpy()[column], expected)
    assert "Journal of Field Robotics" in (folder / "site.toml").read_text()


@pytest.mark.usefixtures("gtsam")
def test_gtsam_itself_is_not_imported():
    code = (
        "import sys; from trackfield.io.recorded import recorded; recorded('plaza2');"
        "sys.exit('gtsam' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_gtsam_it_is_said_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InputError) as caught:
        write_recorded("plaza2", tmp_path / "folder")
    assert str(caught.value) == (
        "plaza2: found no package gtsam, which carries the recording: "
        'pip install "trackfield[recorded]"'
    )
    assert not list(tmp_path.iterdir())


def test_an_unknown_recording():
    with pytest.raises(
        InputError, match="found recording 'plaza3', expected one of: plaza1, plaza2"
    ):
        recorded("plaza3")


@pytest.mark.usefixtures("gtsam")
def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        write_recorded("plaza2", tmp_path / "file" / "folder")
