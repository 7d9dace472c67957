"""Which settings a site gives, and which are the defaults."""

import dataclasses
import json
from pathlib import Path

from trackfield.network.defaults import settings
from trackfield.network.energy import Energy
from trackfield.network.site import ReportSettings, SchedulingSettings, Target, TrackerSettings
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
    keys |= {f"reports.{f.name}" for f in dataclasses.fields(ReportSettings)}
    keys |= {f"scheduling.{f.name}" for f in dataclasses.fields(SchedulingSettings)}
    keys |= {f"energy.{f.name}" for f in dataclasses.fields(Energy)}
    assert set(found) == keys
    json.dumps({key: one.to_json() for key, one in found.items()}, allow_nan=False)


def test_given_values_are_told_from_defaults():
    found = settings(site_from_toml(TEXT, Path()))
    assert found["models.far.max_range_m"].text == "50"
    assert found["models.far.max_range_m"].source == "given"
    assert found["models.uwb.max_range_m"].text == "unlimited"
    assert found["models.uwb.max_range_m"].source == "default"
    assert found["target.max_speed_m_s"].source == "given"
    assert found["target.accel_sigma_m_s2"].text == "none"


def test_what_differs_between_sensors_is_told_as_a_span():
    found = settings(site_from_toml(TEXT, Path()))
    assert found["models.uwb.bias_m"].text == "0.25 to 0.5"
    assert found["models.uwb.bias_m"].to_json() == {
        "value": None,
        "source": "given",
        "low": 0.25,
        "high": 0.5,
    }
    assert found["models.uwb.learn_noise"].text == "differs between sensors"


FIELD = """
[models.pir]
kind = "detection"
p_detection = 0.8
[models.pir.sensors.C]
polygon = [[0, 0], [1, 0], [1, 1]]
[network]
p_loss = 0.1
[reports]
region = [0, 0, 50, 20]
false_per_scan = 2
[target]
lifetime_s = 90
""" + SENSORS.replace("'uwb'", "'pir'").replace("'far'", "'pir'")


def test_what_is_left_open_is_told_as_learned_or_derived():
    found = settings(site_from_toml(FIELD, Path()))
    told = {key: (found[key].text, found[key].source) for key in found}
    assert told["models.pir.p_detection"] == ("0.8", "given")
    assert told["models.pir.p_false"] == ("0.05", "default")
    assert told["models.pir.polygon"] == ("differs between sensors", "given")
    assert told["reports.region"] == ("0, 0, 50, 20", "given")
    assert told["reports.false_per_scan"] == ("2", "given")
    assert told["reports.p_detection"] == told["reports.sigma_m"] == ("-", "learned")
    assert told["reports.step_s"] == ("-", "derived")
    assert told["network.p_loss"] == ("0.1", "given")
    assert told["network.hop_m"] == ("unlimited", "default")
    assert told["target.lifetime_s"] == ("90", "given")
    assert told["tracker.method"] == ("bernoulli", "default")
    assert told["scheduling.reach_m"] == ("-", "derived")
    assert told["scheduling.policy"] == ("accuracy", "default")
    json.dumps({key: one.to_json() for key, one in found.items()}, allow_nan=False)


def test_a_shape_that_all_share_is_told_by_its_corners():
    text = FIELD.replace("[models.pir.sensors.C]\n", "")
    found = settings(site_from_toml(text, Path()))["models.pir.polygon"]
    assert (found.text, found.source) == ("3 corners", "given")
    assert settings(site_from_toml("reports = {}", Path()))["reports.region"].source == "derived"
