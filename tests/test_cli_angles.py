"""Bearings and angular rates on the command line: planned with, not tracked yet, no crash."""

import os

import pytest

import cli_runs

SITE = """
[models.camera]
kind = "bearing"
max_range_m = 30
[models.uwb]
kind = "range"
[[sensors]]
sensor_id = "A"
x_m = 0
y_m = 0
model = "camera"
[[sensors]]
sensor_id = "B"
x_m = 10
y_m = 0
model = "camera"
[[sensors]]
sensor_id = "C"
x_m = 0
y_m = 10
model = "OTHER"
"""
HEADER = "t_s,sensor_id,kind,value,target_id\n"
BEARINGS = HEADER + "0,A,bearing,0.3,T\n0,B,bearing,2.4,T\n"
RANGES = HEADER + "0,C,range,7.3,T\n1,C,range,7.3,T\n"


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def run(tmp_path):
    (tmp_path / "cameras.toml").write_text(SITE.replace("OTHER", "camera"))
    (tmp_path / "mixed.toml").write_text(SITE.replace("OTHER", "uwb"))
    (tmp_path / "bearings.csv").write_text(BEARINGS)
    (tmp_path / "ranges.csv").write_text(RANGES)
    (tmp_path / "both.csv").write_text(BEARINGS + RANGES.removeprefix(HEADER))
    (tmp_path / "truth.csv").write_text("t_s,target_id,x_m,y_m\n0,T,5,5\n1,T,5,5\n")
    return tmp_path


def test_a_site_of_cameras_is_sound_and_says_its_defaults(call, run):
    done = call("check", run / "cameras.toml", "--json").json
    assert done["ok"]
    assert done["settings"]["models.camera.sigma_rad"] == {"value": 0.05, "source": "default"}
    assert done["settings"]["models.camera.max_range_m"] == {"value": 30, "source": "given"}


def test_a_range_and_a_bearing_are_enough_to_plan_with(call, run):
    site = run / "two.toml"
    site.write_text((run / "mixed.toml").read_text().replace('sensor_id = "B"', 'sensor_id = "D"'))
    text = site.read_text()
    first = text.index("[[sensors]]")
    second = text.index("[[sensors]]", first + 1)
    site.write_text(text[:first] + text[second:])
    done = call("check", site, "--json").json
    assert (done["ok"], done["sensors"]) == (True, 2)


@pytest.mark.parametrize("site", ["cameras", "mixed"])
def test_data_of_kinds_that_no_tracker_takes_fail_the_check(call, run, site):
    done = call("check", run / f"{site}.toml", run / "bearings.csv", "--json")
    assert done.code == 1
    assert any(
        "kind 'bearing', whose readings no tracker takes yet" in p for p in done.json["problems"]
    )


@pytest.mark.parametrize(
    ("site", "data", "words"),
    [
        ("cameras", "bearings", "readings of kind 'bearing', which no tracker takes yet"),
        ("mixed", "both", "expected one kind"),
        ("mixed", "ranges", "found sensor 'A' of kind 'bearing', expected 'range' of all"),
    ],
)
def test_they_are_not_tracked_yet_and_the_program_says_so(call, run, site, data, words):
    done = call("track", run / f"{site}.toml", run / f"{data}.csv", "-o", run / "tracks.csv")
    assert done.code == 2
    assert words in done.err
    assert not (run / "tracks.csv").exists()


@pytest.mark.parametrize(
    ("site", "words"),
    [
        ("cameras", "found sensors of kind 'bearing', expected ranges, signals, detections or"),
        ("mixed", "found sensors of kinds bearing, range, expected one kind"),
    ],
)
def test_nor_are_they_calibrated(call, run, site, words):
    data = run / "bearings.csv", run / "truth.csv"
    done = call("calibrate", run / f"{site}.toml", *data, "-o", run / "out.toml")
    assert done.code == 2
    assert words in done.err


def test_a_pipe_of_bearings_is_refused_before_it_is_read(call, run):
    pipe = run / "pipe.csv"
    os.mkfifo(pipe)
    done = call("track", run / "cameras.toml", pipe, "-o", run / "tracks.csv")
    assert done.code == 2
    assert "kind 'bearing', whose readings no tracker takes yet" in done.err
