"""Which settings a site gives, and which are the defaults."""

import dataclasses
import json
from pathlib import Path

from trackfield.network.defaults import settings
from trackfield.network.site import Target, TrackerSettings
from trackfield.network.site_file import site_from_toml
from trackfield.sensing.range import UNCALIBRATED

SENSORS = "".join(
    f"[[sensors]]\nsensor_id = '{name}'\nx_m = {x}\ny_m = 0\nmodel = '{model}'\n"
    for name, x, model in (("A", 0, "uwb"), ("B", 1, "uwb"), ("C", 2, "far"))
)
TEXT = f"""
[models.uwb]
kind = "range"
bias_m = 0.25
[models.uwb.sensors.B]
bias_m = 0.5
learn_noise = false
[models.far]
kind = "range"
max_range_m = 50
[target]
max_speed_m_s = 2
{SENSORS}
"""


def test_every_key_of_every_model_and_section_is_told():
    found = settings(site_from_toml(TEXT, Path()))
    keys = {
        f"models.{m}.{f.name}" for m in ("uwb", "far") for f in dataclasses.fields(UNCALIBRATED)
    }
    keys |= {f"target.{f.name}" for f in dataclasses.fields(Target)}
    keys |= {f"tracker.{f.name}" for f in dataclasses.fields(TrackerSettings)}
    assert set(found) == keys
    json.dumps({key: one.to_json() for key, one in found.items()}, allow_nan=False)


def test_given_values_are_told_from_defaults():
    found = settings(site_from_toml(TEXT, Path()))
    assert (found["models.far.max_range_m"].text, found["models.far.max_range_m"].default) == (
        "50",
        False,
    )
    assert found["models.uwb.max_range_m"].text == "unlimited"
    assert found["models.uwb.max_range_m"].default
    assert not found["target.max_speed_m_s"].default
    assert found["target.accel_sigma_m_s2"].text == "none"


def test_what_differs_between_sensors_is_told_as_a_span():
    found = settings(site_from_toml(TEXT, Path()))
    assert found["models.uwb.bias_m"].text == "0.25 to 0.5"
    assert found["models.uwb.bias_m"].to_json() == {
        "value": None,
        "default": False,
        "low": 0.25,
        "high": 0.5,
    }
    assert found["models.uwb.learn_noise"].text == "differs between sensors"
