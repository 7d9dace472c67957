"""A site's file: what it says, every fault of it at once, and writing it back."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError, InputError
from trackfield.network.channel import Channel
from trackfield.network.kinds import KINDS
from trackfield.network.site import (
    Group,
    Origin,
    ReportSettings,
    SchedulingSettings,
    Site,
    Target,
    TrackerSettings,
    range_models,
)
from trackfield.network.site_file import load_site, site_from_toml
from trackfield.network.site_schema import MODELS, site_schema
from trackfield.network.site_writer import relative_path, site_text, write_site
from trackfield.raster import Region
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.range import UNCALIBRATED, RangeModel
from trackfield.sensing.signal import SignalModel

ANY_KIND = (
    "'range', 'signal', 'detection', 'bearing', 'angular_rate', 'motion', 'rssi', 'amplitude' "
    "or 'energy_message'"
)

SENSORS = """
[[sensors]]
sensor_id = "A"
x_m = 0
y_m = 0
[[sensors]]
sensor_id = "B"
x_m = 4.5
y_m = 0
[[sensors]]
sensor_id = "C"
x_m = 0
y_m = 3
"""


def problems(text, folder=Path()):
    with pytest.raises(ConfigurationError) as caught:
        site_from_toml(text, folder)
    return caught.value.problems


def assert_same(a: Site, b: Site):
    np.testing.assert_array_equal(a.positions, b.positions)
    for field in dataclasses.fields(Site):
        if field.name != "positions":
            assert getattr(a, field.name) == getattr(b, field.name), field.name


def test_a_site_with_nothing_but_sensors_gets_every_default():
    site = site_from_toml(SENSORS, Path(), "garden.toml")
    assert site.name == "garden"
    assert site.sensor_ids == ("A", "B", "C")
    np.testing.assert_array_equal(site.positions[:, :2], [[0, 0], [4.5, 0], [0, 3]])
    assert np.isnan(site.positions[:, 2]).all()
    assert site.models == (UNCALIBRATED,) * 3
    assert (site.target, site.tracker, site.origin) == (Target(), TrackerSettings(), None)


def test_every_section_is_read_and_whole_numbers_become_floats():
    site = site_from_toml(
        """
        [site]
        name = "yard"
        frame = "local"
        origin = { lat = 40.5, lon = -80, rotation_deg = 12 }
        [models.uwb]
        kind = "range"
        bias_m = 1
        scale = 0.02
        [models.uwb.sensors.B]
        bias_m = -0.5
        [models.radar]
        kind = "range"
        sigma_m = 2
        [[groups]]
        id = "west"
        x_m = 0
        y_m = 1
        [target]
        motion = "cv"
        accel_sigma_m_s2 = 1
        height_m = 0.4
        [tracker]
        drop_s = 60
        self_calibration = false
        [scheduling]
        policy = "soft"
        bound_m2 = 0.5
        [[sensors]]
        sensor_id = "A"
        x_m = 0
        y_m = 0
        z_m = 2
        model = "radar"
        group = "west"
        [[sensors]]
        sensor_id = "B"
        x_m = 1
        y_m = 0
        z_m = 2
        model = "uwb"
        """,
        Path(),
    )
    assert site.name == "yard"
    assert site.origin == Origin(lat=40.5, lon=-80.0, rotation_deg=12.0)
    uwb = dataclasses.replace(
        UNCALIBRATED, bias_m=-0.5, scale=0.02, bias_sigma_m=0, common_bias_sigma_m=0, scale_sigma=0
    )
    radar = dataclasses.replace(
        UNCALIBRATED, sigma_m=2.0, correlated_sigma_m=0.0, learn_noise=False
    )
    assert site.models == (radar, uwb)
    assert isinstance(site.models[0].sigma_m, float)
    assert site.model_names == ("radar", "uwb")
    assert site.groups == (Group("west", 0.0, 1.0),)
    assert site.sensor_groups == ("west", None)
    assert site.target == Target(motion="cv", accel_sigma_m_s2=1.0, height_m=0.4)
    assert site.tracker == TrackerSettings(drop_s=60.0, self_calibration=False)
    assert site.scheduling == SchedulingSettings(policy="soft", bound_m2=0.5)


def test_sensors_may_stand_in_a_file_named_in_site_or_before_it(tmp_path):
    (tmp_path / "s.csv").write_text(
        "\ufeffsensor_id, x_m,y_m,z_m,model\nA,0,0,1.5,uwb\n\nB,1,0,,uwb\n", encoding="utf-8"
    )
    for head in ("[site]\nsensors_file = 's.csv'\n", "sensors_file = 's.csv'\n"):
        path = tmp_path / "site.toml"
        path.write_text(head + "[models.uwb]\nkind = 'range'\nbias_m = 3\n")
        site = load_site(path)
        assert site.sensor_ids == ("A", "B")
        np.testing.assert_array_equal(site.positions, [[0, 0, 1.5], [1, 0, math.nan]])
        assert [model.bias_m for model in site.models] == [3.0, 3.0]
        assert site.sensors_file == tmp_path / "s.csv"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("colour = 1", ["site.toml: colour: found an unknown key; valid ones: site, sensors_file"]),
        ("[site]\nnam = 'x'", ["site.nam: found an unknown key; nearest valid one: name"]),
        ("[site]\nname = 3", ["site.name: found 3, expected text in quotes"]),
        ("[site]\nframe = 'wgs84'", ["site.frame: found 'wgs84', expected 'local'"]),
        ("[site]\norigin = {lat = 91, lon = 0}", ["site.origin.lat: found 91, expected degrees"]),
        ("[site]\norigin = {lat = 1}", ["site.origin.lon: found nothing, expected a value"]),
        ("[site]\norigin = {lt = 1, lat = 1, lon = 1}", ["site.origin.lt", "one: lat"]),
        ("site = 3", ["site: found 3, expected a table"]),
        ("models = 3", ["models: found 3, expected a table"]),
        ("groups = 3", ["groups: found 3, expected a list"]),
        (
            "[models.m]\nbias_m = 1",
            [f"models.m.kind: found nothing, expected {ANY_KIND}"],
        ),
        (
            "[models.m]\nkind = 'wifi'",
            [f"models.m.kind: found 'wifi', expected {ANY_KIND}"],
        ),
        (
            "[models.m]\nkind = 'range'\nbias = 1",
            ["models.m.bias: found an unknown key; nearest valid one: bias_m"],
        ),
        (
            "[models.m]\nkind = 'range'\nbias_m = '1'",
            ["models.m.bias_m: found '1', expected a num"],
        ),
        ("[models.m]\nkind = 'range'\nbias_m = true", ["models.m.bias_m: found true, expected"]),
        ("[models.m]\nkind = 'range'\nbias_m = nan", ["bias_m: found nan, expected a finite num"]),
        ("[models.m]\nkind = 'range'\nbias_m = inf", ["bias_m: found inf, expected a finite num"]),
        ("[models.m]\nkind = 'range'\nbias_m = [1]", ["bias_m: found a list, expected a number"]),
        ("[models.m]\nkind = 'range'\nsigma_m = -1", ["sigma_m: found -1, expected a finite"]),
        ("[models.m]\nkind = 'range'\nsigma_scale = -0.1", ["sigma_scale: found -0.1, expected"]),
        ("[models.m]\nkind = 'range'\nmax_range_m = nan", ["max_range_m: found nan, expected"]),
        (
            "[models.m]\nkind = 'range'\nmax_range_m = 0",
            ["max_range_m: found 0, expected a number"],
        ),
        ("[models.m]\nkind = 'range'\nlearn_noise = 1", ["found 1, expected true or false"]),
        (
            "[models.m]\nkind = 'range'\nscale = 1.02",
            ["models.m.scale: found 1.02", "a factor of 1.02 is written 0.02"],
        ),
        (
            "[models.m]\nkind = 'range'\nsigma_m = 0",
            ["models.m: found sigma_m = 0 and sigma_scale = 0 for 'A', expected one of them"],
        ),
        (
            "[models.m]\nkind = 'range'\n[models.m.sensors.A]\nbais_m = 1",
            ["models.m.sensors.A.bais_m: found an unknown key; nearest valid one: bias_m"],
        ),
        (
            "[models.m]\nkind = 'range'\n[models.m.sensors.AA]\nbias_m = 1",
            ["models.m.sensors.AA: found an unknown sensor; nearest valid one: A;"],
        ),
        ("[target]\nmotion = 'fly'", ["target.motion: found 'fly', expected 'imm' or 'cv'"]),
        ("[target]\ndimensions = 4", ["target.dimensions: found 4, expected 2 or 3"]),
        ("[target]\ndimensions = 3", ["target.dimensions: found 3", "none for A, B, C"]),
        ("[target]\nheight_m = 1", ["target.height_m: found 1.0, expected sensors with z_m"]),
        ("[target]\nmax_speed_m_s = 0", ["max_speed_m_s: found 0, expected a number above 0"]),
        ("[tracker]\nwindow_s = -1", ["tracker.window_s: found -1, expected a finite number, 0"]),
        ("[tracker]\ndrop_s = inf", ["tracker.drop_s: found inf, expected a number above 0"]),
        ("[[groups]]\nid = 'g'\nx_m = 0", ["groups[1].y_m: found nothing, expected a value"]),
        (
            "[[groups]]\nid = 'g'\nx_m = 0\ny_m = 0\n" * 2,
            ["groups[2].id: found 'g' a second time"],
        ),
        ("[models.m]\nkind = 3", [f"models.m.kind: found 3, expected {ANY_KIND}"]),
        ("[models]\nm = 3", ["models.m: found 3, expected a table"]),
        (
            "[models.m]\nkind = 'signal'\nbias_m = 1",
            ["models.m.bias_m: found an unknown key;", "valid ones: kind, amplitude, falloff"],
        ),
        ("[models.m]\nkind = 'signal'\nsigma = 0", ["models.m.sigma: found 0, expected a number"]),
        (
            "[models.m]\nkind = 'signal'\n[models.m.sensors.B]\nexponent = 0",
            ["models.m.sensors.B.exponent: found 0, expected a number above 0"],
        ),
        (
            "[models.m]\nkind = 'signal'\n[models.m.targets.t]\nsigma = 1",
            ["models.m.targets: found an unknown key"],
        ),
        (
            "[models.m]\nkind = 'detection'\np_detection = 1.5",
            ["models.m.p_detection: found 1.5, expected a probability above 0, up to 1"],
        ),
        (
            "[models.m]\nkind = 'detection'\np_false = 0.7",
            ["models.m: found p_false = 0.7 and p_detection = 0.7 for 'A', expected less false"],
        ),
        (
            "[models.m]\nkind = 'detection'\nwidth_deg = 0",
            ["models.m.width_deg: found 0, expected degrees above 0, up to 360"],
        ),
        (
            "[models.m]\nkind = 'detection'\npolygon = [[0, 0], [1, 'a'], [1]]",
            [
                "models.m.polygon: found a list, expected at least three corners [x, y] in "
                "metres from -1e9 to 1e9"
            ],
        ),
        (
            "[models.m]\nkind = 'detection'\npolygon = [[0, 0], [1, 0]]",
            ["models.m: polygon: found 2 corners for 'A', expected 3 or more"],
        ),
        (
            "[reports]\nsigma = 1",
            ["reports.sigma: found an unknown key; nearest valid one: sigma_m"],
        ),
        ("[reports]\nsigma_m = 0", ["reports.sigma_m: found 0, expected a number above 0"]),
        ("[reports]\np_detection = 0", ["reports.p_detection: found 0, expected a probability"]),
        ("[reports]\nstep_s = 0", ["reports.step_s: found 0, expected a number above 0"]),
        (
            "[reports]\nregion = [0, 0, 1]",
            ["reports.region: found a list, expected [x_min, y_min, x_max, y_max] in metres"],
        ),
        ("[reports]\nregion = 3", ["reports.region: found 3, expected a list"]),
        (
            "[reports]\nregion = [0, 5, 9, 5]",
            ["reports.region: found [0.0, 5.0, 9.0, 5.0], expected [x_min, y_min,", "min below"],
        ),
        ("[network]\np_loss = 1.1", ["network.p_loss: found 1.1, expected a probability from 0"]),
        ("[network]\np_delay = 1.5", ["network.p_delay: found 1.5, expected a probability from 0"]),
        ("[network]\nhop_m = nan", ["network.hop_m: found nan, expected a number above 0"]),
        ("[tracker]\nmethod = 'jpda'", ["tracker.method: found 'jpda', expected 'bernoulli', 'ji"]),
        ("[tracker]\nwindow_steps = 0", ["window_steps: found 0, expected a whole number from 1"]),
        ("[tracker]\nwindow_steps = 1.5", ["window_steps: found 1.5, expected a whole number"]),
        ("[scheduling]\npolicy = 'best'", ["scheduling.policy: found 'best', expected 'accuracy'"]),
        ("[scheduling]\nsensors = 0", ["scheduling.sensors: found 0, expected a whole number"]),
        ("[scheduling]\ninterval_s = 0", ["interval_s: found 0, expected a number above 0"]),
        ("[scheduling]\nnear = 0.5", ["scheduling.near: found 0.5, expected a factor of 1"]),
        ("[scheduling]\nalpha_deg = 181", ["alpha_deg: found 181, expected degrees from 0 to"]),
        ("[scheduling]\nsensor = 3", ["found an unknown key; nearest valid one: sensors"]),
        ("[target]\nlifetime_s = 0", ["target.lifetime_s: found 0, expected a number above 0"]),
        ("sensors_file = 's.csv'", ["found both [[sensors]] and sensors_file"]),
    ],
)
def test_a_fault_is_told_with_its_key_what_was_found_and_what_was_expected(text, expected):
    (problem,) = problems(text + SENSORS)
    assert problem.startswith("site.toml: ")
    for part in expected:
        assert part in problem


def test_kinds_of_sensors_stand_side_by_side():
    site = site_from_toml(
        """
        [models.acoustic]
        kind = "signal"
        amplitude = 100
        [models.acoustic.sensors.A]
        sigma_gain = 0.2
        [models.pir]
        kind = "detection"
        radius_m = 5
        polygon = [[0, 0], [2, 0], [2, 1]]
        [models.uwb]
        kind = "range"
        """
        + SENSORS.replace('"A"', '"A"\nmodel = "acoustic"')
        .replace('"B"', '"B"\nmodel = "pir"')
        .replace('"C"', '"C"\nmodel = "uwb"'),
        Path(),
    )
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0))
    assert site.models == (
        SignalModel(amplitude=100.0, sigma_gain=0.2),
        DetectionModel(radius_m=5.0, polygon=corners),
        UNCALIBRATED,
    )
    with pytest.raises(ConfigurationError, match="found sensor 'A' of kind 'signal', expected 'ra"):
        range_models(site)
    assert_same(site_from_toml(site_text(site, Path()), Path(), "site.toml"), site)


def test_reports_need_no_sensors_but_say_so():
    (problem,) = problems("[target]\nmotion = 'cv'")
    assert problem == (
        "site.toml: found no sensors, expected [[sensors]], sensors_file = 'FILE.csv', "
        "or [reports] for data that are positions"
    )
    site = site_from_toml("[reports]\nregion = [0, 0, 30, 20]\nstep_s = 0.5\n[network]", Path())
    assert site.positions.shape == (0, 3)
    assert site.reports == ReportSettings(region=Region(0.0, 0.0, 30.0, 20.0), step_s=0.5)
    assert site.network == Channel()
    assert site_from_toml("reports = {}", Path()).network is None
    (problem,) = problems("reports = 3")
    assert problem == "site.toml: reports: found 3, expected a table"


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("sensor_id = 'A'\nx_m = 1\ny_m = 1", "sensors[4]: sensor_id: found 'A' a second time"),
        ("sensor_id = 'D'\nx_m = 4.5\ny_m = 0", "found 'D' at (4.5, 0) m, the place of 'B'"),
        ("sensor_id = 'D'\nx_m = nan\ny_m = 0", "sensors[4].x_m: found nan, expected a finite"),
        ("sensor_id = 'D'\nx_m = '1'\ny_m = 0", "sensors[4].x_m: found '1', expected a number"),
        ("sensor_id = 4\nx_m = 1\ny_m = 1", "sensors[4].sensor_id: found 4, expected text"),
        ("sensor_id = ''\nx_m = 1\ny_m = 1", "sensors[4].sensor_id: found '', expected text that"),
        ("sensor_id = 'D'\ny_m = 0", "sensors[4].x_m: found nothing, expected a value"),
        ("sensor_id = 'D'\nx = 1\nx_m = 1\ny_m = 9", "sensors[4].x: found an unknown key; nearest"),
        ("sensor_id = 'D'\nx_m = 1\ny_m = 9\nmodel = 'm'", "model: found 'm', expected a model of"),
        ("sensor_id = 'D'\nx_m = 1\ny_m = 9\ngroup = 'g'", "group: found 'g', expected a group of"),
    ],
)
def test_a_fault_of_a_sensor_is_told_with_its_place_in_the_list(row, expected):
    (problem,) = problems(f"{SENSORS}[[sensors]]\n{row}")
    assert expected in problem


@pytest.mark.parametrize(
    ("csv", "expected"),
    [
        (
            "sensor_id,x_m,y_m\nA,0,0\nB,oops,0\n",
            "s.csv, line 3: x_m: found 'oops', expected a num",
        ),
        ("sensor_id,x_m,y_m\n\nA,0,0\nA,1,0\n", "s.csv, line 4: sensor_id: found 'A' a second"),
        (
            "sensor_id,x_m,y_m\nA,0,0\nB,0.0,0.0\n",
            "s.csv, line 3: found 'B' at (0, 0) m, the place",
        ),
        ("sensor_id,x_m,y_m\nA,0\n", "s.csv, line 2: found 2 cells, expected 3"),
        ("sensor_id,x_m,y_m\nA,inf,0\n", "s.csv, line 2: x_m: found inf, expected a finite"),
        ("sensor_id,x_m,y_m\nA,,0\n", "s.csv, line 2: x_m: found nothing, expected a value"),
        ("sensor_id,x,y_m,x_m\nA,1,1,1\n", "line 1: found an unknown column 'x'; nearest valid"),
        ("sensor_id,x_m,x_m,y_m\nA,1,1,1\n", "s.csv, line 1: found column 'x_m' twice"),
        (
            "sensor_id,x_m\nA,1\n",
            "s.csv, line 1: found no column 'y_m', expected sensor_id,x_m,y_m",
        ),
        ("", "s.csv: found no header, expected sensor_id,x_m,y_m"),
        ("sensor_id,x_m,y_m\n", "s.csv: found no sensors, expected a line a sensor"),
        (
            "sensor_id,x_m,y_m,model\nA,0,0,uwb\n",
            "model: found 'uwb', expected a model of site.toml",
        ),
        (
            b"\x89PNG\r\n\x1a\n\x00\xff",
            "s.csv: found binary data at byte 0, expected text in UTF-8",
        ),
        (None, "site.toml: sensors_file: "),
    ],
)
def test_a_fault_of_the_sensors_file_is_told_with_its_line(tmp_path, csv, expected):
    if isinstance(csv, bytes):
        (tmp_path / "s.csv").write_bytes(csv)
    elif csv is not None:
        (tmp_path / "s.csv").write_text(csv)
    (problem,) = problems("sensors_file = 's.csv'", tmp_path)
    assert expected in problem


def test_all_faults_of_all_files_are_told_at_once(tmp_path):
    (tmp_path / "s.csv").write_text("sensor_id,x_m,y_m,model\nA,0,0,uwb\nB,x,0,uwb\nC,0,0,uw\n")
    text = """
    sensors_file = "s.csv"
    [site]
    nmae = "x"
    [models.uwb]
    kind = "range"
    sigma_m = -1
    scale = 2
    [target]
    motion = "fly"
    """
    keys = ("site.nmae", "sigma_m", "scale", "target.motion", "line 3: x_m", "the place of", "'uw'")
    found = problems(text, tmp_path)
    assert len(found) == len(keys)
    for key in keys:
        assert sum(key in problem for problem in found) == 1, key


@pytest.mark.parametrize(
    ("told", "believed"),
    [
        ("", UNCALIBRATED),
        ("max_range_m = 9", dataclasses.replace(UNCALIBRATED, max_range_m=9.0)),
        (
            "bias_m = 0",
            dataclasses.replace(UNCALIBRATED, bias_sigma_m=0.0, common_bias_sigma_m=0.0),
        ),
        (
            "bias_m = 1\nbias_sigma_m = 0.5",
            dataclasses.replace(
                UNCALIBRATED, bias_m=1.0, bias_sigma_m=0.5, common_bias_sigma_m=0.0
            ),
        ),
        ("scale = 0.01", dataclasses.replace(UNCALIBRATED, scale=0.01, scale_sigma=0.0)),
        (
            "sigma_m = 0.05\nsigma_scale = 0.01\nlearn_noise = true",
            dataclasses.replace(
                UNCALIBRATED, sigma_m=0.05, sigma_scale=0.01, correlated_sigma_m=0.0
            ),
        ),
    ],
)
def test_what_is_told_is_believed_and_the_rest_is_doubted(told, believed):
    site = site_from_toml(f"[models.m]\nkind = 'range'\n{told}\n{SENSORS}", Path())
    assert site.models == (believed,) * 3


def test_a_target_may_have_models_of_its_own():
    site = site_from_toml(
        """
        [models.m]
        kind = "range"
        bias_m = 1.0
        [models.m.sensors.B]
        bias_m = 2.0
        [models.m.targets.tag]
        sigma_m = 0.5
        [models.m.targets.tag.sensors.C]
        bias_m = 3.0
        """
        + SENSORS,
        Path(),
    )
    assert [model.bias_m for model in site.models] == [1.0, 2.0, 1.0]
    tag = site.target_models["tag"]
    assert [(model.bias_m, model.sigma_m) for model in tag] == [(1.0, 0.5), (2.0, 0.5), (3.0, 0.5)]
    (problem,) = problems(
        "[models.m]\nkind = 'range'\n[models.m.targets.tag.sensors.D]\nbias_m = 1" + SENSORS
    )
    assert "models.m.targets.tag.sensors.D: found an unknown sensor; valid ones: A, B" in problem


def test_several_models_ask_every_sensor_for_its_own():
    found = problems("[models.a]\nkind = 'range'\n[models.b]\nkind = 'range'\n" + SENSORS)
    assert found[0] == "site.toml: sensors[1]: model: 'A' names no model, expected one of: a, b"
    assert len(found) == 3


def test_a_file_that_cannot_be_read_is_one_problem(tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "bad.toml").write_text("[site\nname = 1")
    for name, expected in [
        ("absent.toml", "absent.toml: found no such file"),
        (".", "found a folder, expected a file"),
        ("binary", "binary: found binary data at byte 0, expected text in UTF-8"),
        ("bad.toml", "bad.toml: not TOML: "),
    ]:
        with pytest.raises(ConfigurationError) as caught:
            load_site(tmp_path / name)
        (problem,) = caught.value.problems
        assert expected in problem


def test_the_schema_names_every_parameter_of_the_model_and_is_json():
    import json

    schema = json.loads(json.dumps(site_schema(), allow_nan=False))
    parameters = schema["$defs"]["RangeParameters"]["properties"]
    assert set(parameters) == {field.name for field in dataclasses.fields(RangeModel)}
    assert schema["additionalProperties"] is False
    assert set(schema["properties"]) >= {"site", "sensors", "models", "target", "tracker"}


@pytest.mark.parametrize("name", KINDS)
def test_defaults_of_the_file_are_those_of_the_dataclass(name):
    told = MODELS[name](kind=name).model_dump(exclude={"kind", "sensors", "targets"})
    plain = {key: tuple(v) if isinstance(v, list) else v for key, v in told.items()}
    assert KINDS[name].parameters(**plain) == KINDS[name].usual


numbers = st.floats(-1e6, 1e6)
positive = st.floats(1e-9, 1e6)
of_ranges = st.builds(
    RangeModel,
    bias_m=numbers,
    scale=st.floats(-0.499, 0.499),
    sigma_m=positive,
    sigma_scale=st.sampled_from([0.0, 0.01]),
    max_range_m=st.just(math.inf) | positive,
    learn_noise=st.booleans(),
)
names = st.text(min_size=1, max_size=6).filter(lambda s: s.strip() == s and "\r" not in s)
targets = st.builds(
    Target, motion=st.sampled_from(["imm", "cv"]), accel_sigma_m_s2=st.none() | positive
)
origins = st.none() | st.builds(Origin, lat=st.floats(-90, 90), lon=st.floats(-180, 180))


shares = st.floats(0.01, 0.99)
reports = st.builds(
    ReportSettings,
    sigma_m=st.none() | positive,
    region=st.none() | st.just(Region(-1.5, 0.0, 20.0, 1e3)),
    step_s=st.none() | positive,
)
networks = st.none() | st.builds(Channel, hop_m=st.just(math.inf) | positive, p_loss=shares)
corners = st.just(()) | st.lists(st.tuples(numbers, numbers), min_size=3, max_size=4).map(tuple)


def of_signals(draw, n):
    one = st.builds(SignalModel, amplitude=positive, sigma=positive, sigma_gain=shares)
    return tuple(draw(st.lists(one, min_size=n, max_size=n)))


def of_detections(draw, n):
    one = st.builds(DetectionModel, radius_m=positive, p_false=st.just(0.001), polygon=corners)
    return tuple(draw(st.lists(one, min_size=n, max_size=n)))


def of_angles(draw, n):
    one = st.builds(BearingModel, sigma_rad=positive, bias_rad=st.floats(-3, 3))
    one |= st.builds(AngularRateModel, sigma_rad_s=positive, max_range_m=positive)
    kind = type(draw(one))
    return tuple(draw(st.lists(one.filter(lambda m: type(m) is kind), min_size=n, max_size=n)))


@st.composite
def sites(draw):
    ids = draw(st.lists(names, min_size=1, max_size=5, unique=True))
    n = len(ids)
    xy = draw(st.lists(st.tuples(numbers, numbers), min_size=n, max_size=n, unique_by=_cell))
    z = draw(st.just(math.nan) | numbers)
    named = draw(st.lists(st.sampled_from(["uwb", "far"]), min_size=n, max_size=n))
    models = tuple(draw(st.lists(of_ranges, min_size=n, max_size=n)))
    models = draw(st.sampled_from([models, of_signals(draw, n), of_detections(draw, n)]))
    models = draw(st.just(models) | st.just(of_angles(draw, n)))
    return Site(
        name=draw(names),
        sensor_ids=tuple(ids),
        positions=np.array([[x, y, z] for x, y in xy]),
        models=models,
        target=draw(targets),
        origin=draw(origins),
        groups=draw(st.sampled_from([(), (Group("g", 1.0, 2.0),)])),
        model_names=tuple(named),
        sensor_groups=(None,) * n,
        target_models=draw(
            st.dictionaries(names, st.tuples(*[of_ranges] * n) | st.just(models), max_size=2)
        )
        if isinstance(models[0], RangeModel)
        else {},
        reports=draw(reports),
        network=draw(networks),
    )


def _cell(place):
    return round(place[0], 3), round(place[1], 3)


@settings(max_examples=50)
@given(sites())
def test_reading_what_was_written_gives_the_same_site(site):
    assert_same(site_from_toml(site_text(site, Path()), Path(), "x.toml"), site)


def test_a_calibrated_site_names_the_sensors_file_relative_to_itself(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "out" / "deep").mkdir(parents=True)
    (tmp_path / "in" / "s.csv").write_text("sensor_id,x_m,y_m\nA,0,0\nB,3,0\nC,0,4\n")
    (tmp_path / "in" / "site.toml").write_text("sensors_file = 's.csv'\n")
    site = load_site(tmp_path / "in" / "site.toml")
    models = tuple(dataclasses.replace(m, bias_m=0.1 * i) for i, m in enumerate(site.models))
    calibrated = dataclasses.replace(site, models=models)

    write_site(calibrated, tmp_path / "out" / "deep" / "c.toml", comment="from a run\nin May")
    again = load_site(tmp_path / "out" / "deep" / "c.toml")
    assert again.models == models
    assert again.sensor_ids == site.sensor_ids
    text = (tmp_path / "out" / "deep" / "c.toml").read_text()
    assert 'sensors_file = "../../in/s.csv"' in text
    assert text.startswith("# from a run\n# in May\n")


def test_numpy_numbers_are_written_as_plain_ones(tmp_path):
    site = site_from_toml(SENSORS, Path())
    models = (RangeModel(bias_m=np.float64(0.25), learn_noise=np.bool_(1)),) * 3
    write_site(dataclasses.replace(site, models=models), tmp_path / "c.toml")
    assert load_site(tmp_path / "c.toml").models[1].bias_m == 0.25


def test_a_site_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    site = site_from_toml(SENSORS, Path())
    (tmp_path / "c.toml").mkdir()
    with pytest.raises(InputError, match=r"c\.toml: cannot be written"):
        write_site(site, tmp_path / "c.toml")
    with pytest.raises(InputError, match="cannot be written"):
        write_site(site, tmp_path / "absent" / "c.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["c.toml"]


def test_a_path_is_told_relative_to_the_folder_that_names_it():
    assert relative_path(Path("/a/b/s.csv"), Path("/a/b")) == "s.csv"
    assert relative_path(Path("/a/b/s.csv"), Path("/a/c/d")) == "../../b/s.csv"
    assert relative_path(Path("/s.csv"), Path("/a")) == "../s.csv"
