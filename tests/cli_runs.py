"""A small simulated run on disk, and the program called as a person calls it."""

import json
from typing import NamedTuple

import numpy as np

from trackfield.cli import main

ANCHORS = {"A": (0.0, 0.0), "B": (20.0, 0.0), "C": (20.0, 15.0), "D": (0.0, 15.0)}
BIAS_M = 0.3


class Outcome(NamedTuple):
    code: int
    out: str
    err: str

    @property
    def json(self):
        (line,) = self.out.splitlines()  # exactly one object, and nothing else
        return json.loads(line)


def caller(capsys):
    """A function that runs the program in this process."""

    def call(*arguments):
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        return Outcome(code, *capsys.readouterr())

    return call


def write_run(folder, *, seed=0, duration_s=40.0, bias_m=BIAS_M):
    """Write site.toml, sensors.csv, measurements.csv and truth.csv of one tag on an ellipse."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    rows = [f"{name},{x},{y}\n" for name, (x, y) in ANCHORS.items()]
    (folder / "sensors.csv").write_text("sensor_id,x_m,y_m\n" + "".join(rows))
    (folder / "site.toml").write_text(
        "[site]\nname = 'yard'\nsensors_file = 'sensors.csv'\n[models.uwb]\nkind = 'range'\n"
    )
    t = np.arange(0.0, duration_s, 0.1)
    path = np.column_stack([10 + 6 * np.sin(t / 5), 7 + 4 * np.cos(t / 5)])
    truth = [f"{a:.2f},tag,{x:.4f},{y:.4f}\n" for a, (x, y) in zip(t, path, strict=True)]
    (folder / "truth.csv").write_text("t_s,target_id,x_m,y_m\n" + "".join(truth))
    readings = []
    for i, (time, place) in enumerate(zip(t, path, strict=True)):
        name = "ABCD"[i % 4]
        distance = np.hypot(*(place - ANCHORS[name]))
        value = distance + bias_m + 0.1 * rng.standard_normal()
        readings.append(f"{time:.2f},{name},range,{value:.4f},tag\n")
    (folder / "measurements.csv").write_text(
        "t_s,sensor_id,kind,value,target_id\n" + "".join(readings)
    )
    return folder
