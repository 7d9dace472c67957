"""Scenario files: what is read, what is refused and how it is told, what is documented."""

import json
import re
from dataclasses import fields

import pytest

from pages import DOCS, ROOT
from trackfield.errors import ConfigurationError
from trackfield.network.channel import Channel
from trackfield.simulation.deployment import sensor_count
from trackfield.simulation.scenario import Fault, Party, Reports, Scenario, Sensors
from trackfield.simulation.scenario_file import (
    load_scenario,
    scenario_from_toml,
    scenario_schema,
)

SHIPPED = sorted((ROOT / "examples" / "scenarios").glob("*.toml"))
HEAD = "duration_s = 10\nregion = [0, 0, 10, 10]\n"
REPORTS = HEAD + "[reports]\n"
DETECTION = HEAD + "[sensors]\n[detection]\n"


def faults(text):
    with pytest.raises(ConfigurationError) as told:
        scenario_from_toml(text, "s.toml")
    return told.value.problems


def test_a_short_scenario_has_defaults_that_work():
    scenario = scenario_from_toml(REPORTS, "short.toml")
    assert scenario == Scenario(
        duration_s=10.0, region=(0.0, 0.0, 10.0, 10.0), name="short", reports=Reports()
    )
    assert scenario.steps == 10
    assert scenario.area.area == 100.0


def test_every_section_comes_through():
    text = """
        name = "all"
        duration_s = 9.5
        step_s = 0.5
        seed = 7
        carries = "readings"
        region = [-5, 0, 5, 10]
        [sensors]
        layout = "listed"
        positions = [[0, 1], [2, 3.5]]
        [signal]
        amplitude = 10
        [[targets]]
        motion = "walk"
        path = [[0, 1], [2, 3]]
        go_s = [5, 10]
        [[targets]]
        births_per_s = 0.1
        mean_lifetime_s = 20
        [[groups]]
        id = "a"
        x_m = 0
        y_m = 5
        [network]
        hop_m = inf
        p_loss = 1
        [[faults]]
        kind = "silent"
        group = "a"
        to_s = 5
    """
    scenario = scenario_from_toml(text)
    assert scenario.name == "all"
    assert scenario.steps == 19
    assert scenario.seed == 7
    assert scenario.sensors == Sensors(layout="listed", positions=((0.0, 1.0), (2.0, 3.5)))
    assert scenario.signal.amplitude == 10.0
    assert scenario.targets == (
        Party(motion="walk", path=((0.0, 1.0), (2.0, 3.0)), go_s=(5.0, 10.0)),
        Party(births_per_s=0.1, mean_lifetime_s=20.0),
    )
    assert scenario.groups[0].id == "a"
    assert scenario.network == Channel(p_loss=1.0)
    assert scenario.faults == (Fault(kind="silent", group="a", to_s=5.0),)
    assert scenario.carried == "readings"


def test_the_network_carries_readings_of_detections_and_reports_of_signals():
    detection = scenario_from_toml(DETECTION)
    signal = scenario_from_toml(HEAD + "[sensors]\n[signal]\n")
    reports = scenario_from_toml(REPORTS)
    ranges = scenario_from_toml(HEAD + "[sensors]\n[range]\n")
    assert [s.carried for s in (detection, ranges)] == ["readings", "readings"]
    assert [s.carried for s in (signal, reports)] == ["reports", "reports"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("duration_s = ", "s.toml: not TOML: "),
        ("region = [0, 0, 1, 1]\n[reports]\n", "duration_s: found nothing, expected a value"),
        ("duration_s = -1\nregion = [0,0,1,1]\n[reports]\n", "duration_s: found -1, expected a "),
        (
            REPORTS + "sigma = 1\n",
            "reports.sigma: found an unknown key; nearest valid one: sigma_m",
        ),
        (REPORTS + "sigma_m = {}\n", "reports.sigma_m: found a table, expected a number"),
        (
            "duration_s = 1e6\nregion = [0, 0, 1, 1]\n[reports]\n[[targets]]\ncount = 100\n",
            "targets: found up to 1e+08 rows of truth, expected at most 50000000",
        ),
        (REPORTS + "sigma_m = 'a'\n", "reports.sigma_m: found 'a', expected a number"),
        (REPORTS + "sigma_m = nan\n", "reports.sigma_m: found nan, expected a finite number"),
        (REPORTS + "sigma_m = true\n", "reports.sigma_m: found true, expected a number"),
        (
            REPORTS + "p_detection = 1.5\n",
            "reports.p_detection: found 1.5, expected a probability from 0 to 1",
        ),
        (REPORTS + "false_per_scan = -1\n", "false_per_scan: found -1, expected 0 or more"),
        (HEAD + "reports = 3\n", "reports: found 3, expected a table"),
        (HEAD + "seed = 1.5\n[reports]\n", "seed: found 1.5, expected a whole number"),
        (HEAD + "name = ''\n[reports]\n", "name: found '', expected text that is not empty"),
        (HEAD + "targets = 3\n[reports]\n", "targets: found 3, expected a list"),
        (
            "duration_s = 1\nregion = [0, 0, 1]\n[reports]\n",
            "region: found [0, 0, 1], expected 4 values",
        ),
        (
            "duration_s = 1\nregion = [0, 0, 1, 1, 1]\n[reports]\n",
            "region: found [0, 0, 1, 1, 1], expected 4 values",
        ),
        (
            "duration_s = 1\nregion = [0, 0, 1, 0]\n[reports]\n",
            "region: found [0.0, 0.0, 1.0, 0.0]",
        ),
        (HEAD, "found nothing that is sensed, expected one of [range], [signal], [detection], "),
        (DETECTION + "[reports]\n", "found [detection] and [reports], expected one of"),
        (HEAD + "[detection]\n", "sensors: found nothing, expected [sensors] for [detection]"),
        (REPORTS + "[network]\n", "sensors: found nothing, expected [sensors] for [network]"),
        (
            HEAD + "[sensors]\n[detection]\np_false = 0.8\n",
            "detection.p_detection: found 0.7, expected more than p_false = 0.8",
        ),
        (
            HEAD + "[sensors]\n[detection]\nradius_m = 0\n",
            "detection.radius_m: found 0, expected a number above 0",
        ),
        (
            HEAD + "[sensors]\n[detection]\nradius = 3\n",
            "detection.radius: found an unknown key; nearest valid one: radius_m",
        ),
        (HEAD + "[sensors]\n[signal]\nsigma = nan\n", "signal.sigma: found nan, expected a number"),
        (
            DETECTION + "[network]\np_loss = 2\n",
            "network.p_loss: found 2, expected a probability from 0 to 1",
        ),
        (DETECTION + "[network]\np_delay = 'a'\n", "network.p_delay: found 'a', expected a number"),
        (DETECTION + "[network]\nhop_m = -inf\n", "network.hop_m: found -inf, expected a number"),
        (HEAD + "[sensors]\nspacing_m = 11\n[detection]\n", "sensors.spacing_m: found 0 sensors"),
        (
            HEAD + "[sensors]\nlayout = 'random'\n[detection]\n",
            "sensors.count: found 0 sensors, expected from 1 to 1000000 with layout 'random'",
        ),
        (
            HEAD + "[sensors]\nlayout = 'hexagonal'\nspacing_m = 99\n[detection]\n",
            "sensors.spacing_m: found 0 sensors, expected from 1 to 1000000 with layout 'hexagon",
        ),
        (
            HEAD + "[sensors]\nlayout = 'random'\ncount = 1\nspacing_m = 2\n[detection]\n",
            "sensors.spacing_m: found with layout 'random'; it is for 'grid' and 'hexagonal'",
        ),
        (
            HEAD + "[sensors]\ncount = 3\n[detection]\n",
            "sensors.count: found with layout 'grid'; it is for 'random'",
        ),
        (
            HEAD + "[sensors]\nthreshold = 2\n[detection]\n",
            "sensors.threshold: found 2 without [signal]",
        ),
        ("step_s = 1e-7\n" + REPORTS, "step_s: found 100000000 steps, expected at most 10000000"),
        (
            HEAD + "[sensors]\ndead = 4\n[detection]\n",
            "sensors.dead: found 4 of 4 sensors, expected one that lives",
        ),
        (
            HEAD + "[sensors]\nlayout = 'hexagons'\n[detection]\n",
            "sensors.layout: found 'hexagons', expected 'grid', 'hexagonal', 'random' or 'listed'",
        ),
        (
            DETECTION + "[[groups]]\nid = 'a'\nx_m = 11\ny_m = 0\n",
            "groups[1]: found tier-2 node 'a' at (11, 0) m, expected one in the region",
        ),
        (
            DETECTION + "[[groups]]\nid = 'a'\nx_m = nan\ny_m = 0\n",
            "groups[1].x_m: found nan, expected a finite number",
        ),
        (
            DETECTION + 2 * "[[groups]]\nid = 'a'\nx_m = 1\ny_m = 0\n",
            "groups: found 'a' 2 times, expected every group once",
        ),
        ("carries = 'reports'\n" + DETECTION, "carries: found 'reports' without [network]"),
        (DETECTION + "[energy]\n", "energy: found without [scheduling], expected sensors that are"),
        (
            REPORTS + "[scheduling]\n",
            "scheduling: found with reports, expected readings of sensors",
        ),
        (
            DETECTION + "[scheduling]\ninterval_s = 0.5\n",
            "scheduling.interval_s: found 0.5, expected step_s = 1 or more",
        ),
        (DETECTION + "[scheduling]\nburst = 2\n", "scheduling.burst: found 2 without [range]"),
        (
            DETECTION + "[scheduling]\nsensors = 0\n",
            "scheduling.sensors: found 0, expected a whole number from 1 to 1000",
        ),
        (
            DETECTION + "[scheduling]\n[energy]\nbattery_j = 0\n",
            "energy.battery_j: found 0, expected a number above 0",
        ),
        (
            "fusion = 'fit'\n" + DETECTION,
            "fusion: found without [signal] whose reports travel",
        ),
        (
            "fusion = 'fit'\ncarries = 'readings'\n" + HEAD + "[sensors]\n[signal]\n[network]\n",
            "fusion: found without [signal] whose reports travel",
        ),
        (
            "carries = 'readings'\n" + REPORTS + "[sensors]\n[network]\n",
            "carries: found 'readings', expected 'reports' with [reports]",
        ),
    ],
)
def test_a_faulty_scenario_is_refused(text, told):
    problems = faults(text)
    assert len(problems) == 1
    assert told in problems[0]
    assert problems[0].startswith("s.toml: ")


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ("speed_m_s = [-1, 1]", ".speed_m_s[1]: found -1, expected 0 or more"),
        ("speed_m_s = [2, 1]", ".speed_m_s: found [2.0, 1.0], expected [low, high]"),
        ("speed_m_s = [1]", ".speed_m_s: found [1], expected 2 values"),
        ("speed = 1", ".speed: found an unknown key; nearest valid one: speed_m_s"),
        ("count = -1", ".count: found -1, expected 0 or more"),
        ("count = 100_001", ": found more than 100000 targets, expected fewer"),
        (
            "births_per_s = 2e4\nlifetime_s = [0, 100]",
            ": found more than 100000 targets, expected fewer",
        ),
        (
            "births_per_s = 1e9\nmean_lifetime_s = 1e-3",
            ": found more than 100000 targets, expected fewer",
        ),
        ("count = 1\nat_start = 2", ".at_start: found 2 of count = 1 targets"),
        ("enter_s = [0, 11]", ".enter_s: found [0.0, 11.0], expected times within duration_s"),
        ("lifetime_s = [1, 2]\nmean_lifetime_s = 3", ": found both lifetime_s and mean_lifetime_s"),
        ("inset_m = 5", ".inset_m: found 5, which leaves nothing of the region"),
        ("path = [[1, 2], [3, 4]]", ".path: found with motion 'random'; it is for 'walk'"),
        ("within_m = 1\nmotion = 'walk'", ".within_m: found with motion 'walk'; it is for 'cross"),
        ("motion = 'walk'\npath = [[1, 2]]", ".path: found one place, expected at least two"),
        ("motion = 'walk'\nspeed_m_s = [0, 1]", ".speed_m_s: found [0.0, 1.0], expected speeds "),
        ("motion = 'walk'\ngo_s = [0, 0]", ".go_s: found [0.0, 0.0], expected walkers that walk"),
        ("motion = 'row'\nbirths_per_s = 1", ".births_per_s: found with motion 'row', expected co"),
        ("motion = 'run'", ".motion: found 'run', expected 'random', 'walk', 'crossing' or 'row'"),
    ],
)
def test_a_faulty_party_is_refused(keys, told):
    (problem,) = faults(REPORTS + "[[targets]]\n" + keys + "\n")
    assert problem.startswith("s.toml: targets[1]" + told)


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ("", ".kind: found nothing, expected a value"),
        ("kind = 'flood'", ".kind: found 'flood', expected 'silent', 'burst', 'clock_jump' or"),
        ("kind = 'silent'", ".kind: found 'silent', expected one of group, sensors and count"),
        ("kind = 'silent'\ncount = 1\nsensors = ['s0']", ".kind: found 'silent', expected one of"),
        ("kind = 'silent'\ngroup = 'b'", ".group: found 'b', expected one of the groups: a"),
        (
            "kind = 'stuck'\nsensors = ['s9']",
            ".sensors: found 's9', expected sensors from s0 to s3",
        ),
        ("kind = 'stuck'\ncount = 5", ".count: found 5, expected at most the 4 sensors"),
        ("kind = 'stuck'\ncount = 1\nvalue = 2", ".value: found 2, expected 0 or 1 of a detection"),
        ("kind = 'burst'\ncount = 1", ".kind: found 'burst' of some nodes, expected neither group"),
        ("kind = 'burst'\njump_s = 1", ".jump_s: found with kind 'burst'; it is for 'clock_jump'"),
        ("kind = 'burst'\nfactor = 0.5", ".factor: found 0.5, expected 1 or more"),
        ("kind = 'burst'\nfrom_s = 5\nto_s = 5", ".to_s: found 5, expected a time after from_s"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(keys, told):
    group = "[[groups]]\nid = 'a'\nx_m = 1\ny_m = 0\n"
    (problem,) = faults(DETECTION + group + "[[faults]]\n" + keys + "\n")
    assert problem.startswith("s.toml: faults[1]" + told)


def test_faults_that_need_another_kind_of_sensing_are_refused():
    stuck = "[sensors]\n[[faults]]\nkind = 'stuck'\ncount = 1\n"
    (problem,) = faults(REPORTS + stuck)
    assert "found 'stuck' without [signal], [detection] or [amplitude]" in problem
    (problem,) = faults(HEAD + "[sensors]\n[signal]\n[[faults]]\nkind = 'burst'\n")
    assert "found 'burst' without [reports] or [detection]" in problem
    (problem,) = faults(REPORTS + "[[faults]]\nkind = 'silent'\ngroup = 'a'\n")
    assert "found 'a', expected one of the groups: none" in problem


def test_all_faults_are_told_at_once():
    text = (
        "duration = 5\nregion = [0, 0, 1, 1]\n[network]\np_loss = 2\nhop = 1\n"
        "[[targets]]\nspeed_m_s = [-1, 1]\n[reports]\nsigma_m = 0\n"
    )
    told = "\n".join(faults(text))
    for part in (
        "duration_s",
        "duration:",
        "network.p_loss",
        "network.hop:",
        "targets[1].speed",
        "reports.sigma",
    ):
        assert part in told


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigurationError, match="found no such file"):
        load_scenario(tmp_path / "none.toml")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_scenario_is_sound(path):
    assert load_scenario(path).name == path.stem


def test_the_scenarios_that_the_docs_speak_of_are_shipped():
    page = (DOCS / "howto" / "simulate.md").read_text(encoding="utf-8")
    assert {f"{path.stem}.toml" for path in SHIPPED} == {
        *re.findall(r"^\| `(\w+\.toml)`", page, re.M)
    }
    lochness = load_scenario(ROOT / "examples" / "scenarios" / "lochness.toml")
    assert sensor_count(lochness) == 10_000
    model = lochness.signal
    assert model.amplitude == 3.0 * (1.0 + model.falloff * model.max_range_m**model.exponent)


SECTIONS = {  # of the page, by the names that the tables have in the schema
    "Sensors": "[sensors]",
    "SignalModel": "[signal]",
    "DetectionModel": "[detection]",
    "RangeModel": "[range]",
    "RssiModel": "[rssi]",
    "BearingModel": "[bearing]",
    "AngularRateModel": "[angular_rate]",
    "MotionRateModel": "[motion]",
    "AmplitudeModel": "[amplitude]",
    "EnergyMessageModel": "[energy_message]",
    "Reports": "[reports]",
    "Party": "[[targets]]",
    "Group": "[[groups]]",
    "Channel": "[network]",
    "Fault": "[[faults]]",
    "SchedulingSettings": "[scheduling]",
    "Energy": "[energy]",
    "Pursuit": "[pursuit]",
    "Pursuer": "[[pursuers]]",
    "Obstacle": "[[obstacles]]",
}


def documented(title):
    page = (DOCS / "reference" / "scenario.md").read_text(encoding="utf-8")
    _, found, section = page.partition(f"\n## {title}\n")
    assert found, title
    rows = [
        [cell.strip().strip("`") for cell in line.split("|")[1:-1]]
        for line in section.partition("\n## ")[0].splitlines()
        if line.startswith("| `")
    ]
    assert all(re.search(r"\w", meaning) for *_, meaning in rows)
    return {key: default for key, _, default, _ in rows}


def defaults(properties):
    """Defaults as the page writes them; an empty list or nothing is an empty cell."""
    found = {key: value.get("default") for key, value in properties.items()}
    return {
        key: "" if value in (None, []) else json.dumps(value).strip('"')
        for key, value in found.items()
    }


def test_the_schema_is_one_that_json_can_say():
    assert "Infinity" not in json.dumps(scenario_schema(), allow_nan=False)


def test_every_table_of_a_scenario_is_documented():
    assert {*scenario_schema()["$defs"]} == {*SECTIONS}


@pytest.mark.parametrize("table", SECTIONS)
def test_every_key_of_a_table_is_documented_with_its_default(table):
    properties = scenario_schema()["$defs"][table]["properties"]
    assert documented(f"`{SECTIONS[table]}`") == defaults(properties)


def test_every_key_before_the_tables_is_documented():
    properties = scenario_schema()["properties"]
    tables = {name.strip("[]") for name in SECTIONS.values()}
    own = {key: value for key, value in properties.items() if key not in tables}
    assert documented("Before all tables") == defaults(own)
    assert {field.name for field in fields(Scenario)} == {*properties}
