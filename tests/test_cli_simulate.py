"""`trackfield simulate`: files that other verbs read, counts, repeatability, what is refused."""

import numpy as np
import pytest

import cli_runs
from conftest import ROOT
from trackfield.io.measurements import read_readings
from trackfield.io.reports import read_reports
from trackfield.io.truth import read_truth
from trackfield.network.site_file import load_site

SCENARIOS = ROOT / "examples" / "scenarios"
BINARY = """
duration_s = 20
region = [0, 0, 30, 30]
[sensors]
spacing_m = 5
dead = 2
[detection]
[network]
hop_m = 8
p_loss = 0.2
p_delay = 0.3
[[groups]]
id = "base, north"
x_m = 15
y_m = 30
[[targets]]
motion = "crossing"
count = 2
[[faults]]
kind = "silent"
count = 1
"""


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "field.toml"
    path.write_text(BINARY)
    return path


def test_reports_are_written_as_files_that_can_be_read(call, tmp_path):
    folder = tmp_path / "made" / "here"
    done = call("simulate", SCENARIOS / "reports.toml", "-o", folder, "--json")
    assert (done.code, done.err) == (0, "")
    assert {path.name for path in folder.iterdir()} == {"site.toml", "reports.csv", "truth.csv"}
    result, reports = done.json, read_reports(folder / "reports.csv")
    truth, site = read_truth(folder / "truth.csv"), load_site(folder / "site.toml")
    assert result["folder"] == str(folder)
    assert result["scenario"] == site.name == "reports"
    (file,) = result["files"].values()
    assert file["rows"] == len(reports) == file["messages"]["sent"]
    assert result["truth_rows"] == len(truth)
    assert result["targets"] == len(truth.target_ids) == 12
    assert (result["steps"], result["seed"], result["sensors"], result["cut_off"]) == (
        100,
        0,
        0,
        [],
    )
    assert np.isnan(reports.arrival_s).all()
    assert site.reports.false_per_scan == 6.0


def test_readings_are_written_as_files_that_can_be_read(call, scenario, tmp_path):
    folder = tmp_path / "run"
    done = call("simulate", scenario, "-o", folder, "--json")
    assert (done.code, done.err) == (0, "")
    site = load_site(folder / "site.toml")
    readings = read_readings(folder / "measurements.csv", sensor_ids=site.sensor_ids)
    result = done.json
    file = result["files"]["measurements.csv"]
    messages = file["messages"]
    assert file["rows"] == len(readings) == messages["sent"] - messages["lost"]
    assert (np.diff(readings.arrival_s) >= 0.0).all()
    assert np.count_nonzero(readings.arrival_s > readings.t_s) == messages["delayed"]
    assert (result["sensors"], len(result["dead"])) == (36, 2)
    assert set(result["dead"]).isdisjoint(site.sensor_ids[i] for i in readings.sensor)
    assert len(site.sensor_ids) == 36
    assert set(site.sensor_groups) == {"base, north"}
    assert site.network.p_loss == 0.2
    assert (folder / "site.toml").read_text().startswith("# Simulated: field, seed 0.\n")
    assert call("check", folder / "site.toml", folder / "measurements.csv").code == 0


def test_a_run_is_told_in_lines(call, scenario, tmp_path):
    done = call("simulate", scenario, "-o", tmp_path / "run")
    assert done.err == ""
    lines = done.out.splitlines()
    assert lines[0] == f"{tmp_path / 'run'}: field, 20 steps"
    assert lines[1].startswith("  truth.csv: 2 targets, ")
    assert lines[2] == "  sensors.csv: 36 sensors, 2 of them dead"
    assert lines[3].startswith("  measurements.csv: ")
    assert " rows; " in lines[3]
    assert lines[3].endswith(" silent")
    assert len(lines) == 5


def test_signals_and_what_they_are_fused_to_are_both_written(call, tmp_path):
    text = (
        "duration_s = 5\nregion = [0, 0, 30, 30]\nfusion = 'fit'\n[sensors]\nspacing_m = 1\n"
        "[signal]\n[[targets]]\ncount = 2\ninset_m = 5\n[network]\np_delay = 0.5\n"
    )
    (tmp_path / "signals.toml").write_text(text)
    done = call("simulate", tmp_path / "signals.toml", "-o", tmp_path / "run", "--json")
    assert (done.code, done.err) == (0, "")
    files = done.json["files"]
    assert files["measurements.csv"]["rows"] == 5 * 900
    readings = read_readings(tmp_path / "run" / "measurements.csv")
    assert np.isnan(readings.arrival_s).all()  # they are fused where they are heard
    reports = read_reports(tmp_path / "run" / "reports.csv")
    assert len(reports) == files["reports.csv"]["rows"] == 10
    assert (reports.arrival_s >= reports.t_s).all()
    assert (reports.covariance[:, 0] > 0.0).all()


def test_ranges_name_their_tags_and_are_tracked(call, tmp_path):
    folder = tmp_path / "run"
    assert call("simulate", SCENARIOS / "tags.toml", "-o", folder, "--seed", "3").code == 0
    site = load_site(folder / "site.toml")
    readings = read_readings(folder / "measurements.csv", sensor_ids=site.sensor_ids)
    assert readings.target_ids == ("t1", "t2")
    tracks = folder / "tracks.csv"
    assert call("track", folder / "site.toml", folder / "measurements.csv", "-o", tracks).code == 0
    done = call("score", folder / "truth.csv", tracks, "--json")
    assert done.json["rmse_m"] < 0.2


def test_the_same_seed_writes_the_same_files(call, scenario, tmp_path):
    runs = [("a", ()), ("b", ("--seed", "0")), ("c", ("--seed", "1"))]
    for name, options in runs:
        assert call("simulate", scenario, "-o", tmp_path / name, *options).code == 0

    def content(name, file):
        return (tmp_path / name / file).read_bytes()

    for file in ("measurements.csv", "truth.csv", "sensors.csv", "site.toml"):
        assert content("a", file) == content("b", file)
    assert content("a", "measurements.csv") != content("c", "measurements.csv")
    assert content("a", "truth.csv") != content("c", "truth.csv")


def test_what_may_not_be_meant_is_warned_of(call, scenario, tmp_path):
    text = BINARY.replace("hop_m = 8", "hop_m = 5").replace("dead = 2", "dead = 16")
    scenario.write_text(text.replace("count = 2", "count = 0"))
    done = call("simulate", scenario, "-o", tmp_path / "run", "--json")
    assert done.code == 0
    first, second = done.err.splitlines()
    assert first.startswith(f"warning: {len(done.json['cut_off'])} of 36 sensors cannot reach")
    assert second == "warning: no target ever appears"
    assert (tmp_path / "run" / "truth.csv").read_text() == "t_s,target_id,x_m,y_m,z_m\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["missing.toml"], "error: {folder}/missing.toml: found no such file"),
        (["bad.toml"], "error: {folder}/bad.toml: duration_s: found 0, expected a number above 0"),
        (["cut.toml"], "error: network.hop_m: found 1, with which no sensor reaches its tier-2"),
        (["field.toml", "--seed", "-1"], "Invalid value for '--seed'"),
    ],
)
def test_what_cannot_be_simulated_is_refused_and_nothing_written(
    call, scenario, tmp_path, arguments, told
):
    (tmp_path / "bad.toml").write_text("duration_s = 0\nregion = [0, 0, 1, 1]\n[reports]\n")
    (tmp_path / "cut.toml").write_text(BINARY.replace("hop_m = 8", "hop_m = 1"))
    name, *options = arguments
    done = call("simulate", tmp_path / name, "-o", tmp_path / "run", *options)
    assert (done.code, done.out) == (2, "")
    assert told.format(folder=tmp_path) in done.err
    assert not list((tmp_path / "run").glob("*"))


def test_a_scenario_is_not_written_over(call, scenario, tmp_path):
    own = scenario.rename(tmp_path / "site.toml")
    done = call("simulate", own, "-o", tmp_path)
    assert done.code == 2
    assert "found an input, expected another file to write to" in done.err
    assert own.read_text() == BINARY


def test_a_folder_that_cannot_be_is_refused(call, scenario):
    done = call("simulate", scenario, "-o", scenario / "below")
    assert done.code == 2
    assert "cannot be written" in done.err
