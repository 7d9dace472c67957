"""Readings that know no distance on the command line: what is tracked, told, refused."""

import os

import numpy as np
import pytest

import cli_runs
from conftest import ROOT
from trackfield.io.tracks import read_tracks

SCENARIOS = ROOT / "examples" / "scenarios"
SENSORS = "sensor_id,x_m,y_m\nA,0,0\nB,10,0\nC,10,8\nD,0,8\n"
HEADER = "t_s,sensor_id,kind,value,target_id\n"
PLACES = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]])


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


def write(folder, kind, rows, *, sensors=SENSORS, model=""):
    """A site of sensors of one kind, and the rows of its readings."""
    (folder / "sensors.csv").write_text(sensors)
    text = "[site]\nname = 'yard'\nsensors_file = 'sensors.csv'\n[models.m]\n"
    (folder / "site.toml").write_text(f"{text}kind = '{kind}'\n{model}")
    (folder / "data.csv").write_text(HEADER + "".join(rows))
    return folder / "site.toml", folder / "data.csv"


def bearings(steps=60, *, sensors="ABCD", target="cart"):
    """Rows of noisy bearings of a cart that drives across the yard."""
    rng, rows = np.random.default_rng(5), []
    for k in range(steps):
        place = np.array([2.0 + 0.1 * k, 3.0 + 0.03 * k])
        for i, name in enumerate("ABCD"):
            x, y = place - PLACES[i]
            z = np.arctan2(y, x) + 0.01 * rng.standard_normal()
            if name in sensors:
                rows.append(f"{0.2 * k:.2f},{name},bearing,{z:.5f},{target}\n")
    return rows


def strengths(steps=60, *, sign=1.0):
    rng, rows = np.random.default_rng(6), []
    for k in range(steps):
        place = np.array([2.0 + 0.1 * k, 3.0 + 0.03 * k])
        for i, name in enumerate("ABCD"):
            z = -59.0 - 20.0 * np.log10(np.linalg.norm(place - PLACES[i])) + rng.standard_normal()
            rows.append(f"{0.2 * k:.2f},{name},rssi,{sign * z:.3f},tag\n")
    return rows


@pytest.mark.parametrize(
    ("name", "rmse_m"),
    [("bearings", 1.2), ("rates", 0.06), ("rssi", 2.0)],
)
def test_a_simulated_site_tracks_its_own_measurements(call, tmp_path, name, rmse_m):
    folder = tmp_path / name
    assert call("simulate", SCENARIOS / f"{name}.toml", "-o", folder, "--seed", 5).code == 0
    site, data, tracks = (folder / n for n in ("site.toml", "measurements.csv", "tracks.csv"))
    assert call("check", site, data).code == 0
    done = call("track", site, data, "-o", tracks, "--json")
    assert (done.code, done.err) == (0, "")
    assert done.json["targets"] == ["t1"]
    assert done.json["readings"]["started"] == 1
    score = call("score", folder / "truth.csv", tracks, "--json").json
    assert score["rmse_m"] < rmse_m
    assert score["availability"] > 0.8


@pytest.mark.parametrize("seed", [330, 333])
def test_a_first_answer_that_was_wrong_is_not_shown(call, tmp_path, seed):
    scenario = (SCENARIOS / "rates.toml").read_text().replace("duration_s = 20", "duration_s = 3")
    (tmp_path / "rates.toml").write_text(scenario)
    call("simulate", tmp_path / "rates.toml", "-o", tmp_path, "--seed", seed)
    tracks = tmp_path / "tracks.csv"
    assert (
        call("track", tmp_path / "site.toml", tmp_path / "measurements.csv", "-o", tracks).code == 0
    )
    score = call("score", tmp_path / "truth.csv", tracks, "--json").json
    assert score["p95_m"] < 0.1


def test_kinds_of_one_family_are_tracked_in_one_run(call, tmp_path):
    scenario = (SCENARIOS / "motion.toml").read_text().replace("duration_s = 60", "duration_s = 12")
    (tmp_path / "motion.toml").write_text(scenario)
    folder = tmp_path / "run"
    call("simulate", tmp_path / "motion.toml", "-o", folder)
    data, tracks = folder / "measurements.csv", folder / "tracks.csv"
    kinds = {line.split(",")[2] for line in data.read_text().splitlines()[1:]}
    assert kinds == {"bearing", "angular_rate", "motion"}
    assert call("track", folder / "site.toml", data, "-o", tracks).code == 0
    assert len(read_tracks(tracks)) > 20
    score = call("score", folder / "truth.csv", tracks, "--json").json
    assert score["rmse_m"] < 0.5


def test_lags_thinning_methods_and_pictures_work(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings())
    asked = {
        "lag": ("--lag", "1"),
        "steps": ("--lag", "5steps"),
        "thin": ("--every", "1"),
        "cv": ("--method", "cv"),
    }
    found = {}
    for name, options in {"live": (), **asked}.items():
        tracks = tmp_path / f"{name}.csv"
        done = call("track", site, data, "-o", tracks, *options)
        assert (done.code, done.err) == (0, "")
        assert "240 accepted, 0 repeated, 0 too late" in done.out
        found[name] = read_tracks(tracks)
    assert len(found["lag"]) == len(found["steps"]) == len(found["live"])
    assert len(found["thin"]) < len(found["live"]) / 3
    assert found["lag"].covariance[20:40, 0].mean() < found["live"].covariance[20:40, 0].mean()
    assert not np.array_equal(found["cv"].position, found["live"].position)
    figure, film = tmp_path / "tracks.png", tmp_path / "tracks.html"
    done = call(
        "track", site, data, "-o", tmp_path / "t.csv", "--plot", figure, "--animate", film, "--json"
    )
    assert figure.stat().st_size > 10_000
    assert film.exists()
    assert done.json["plot"] == str(figure)


def test_a_reading_without_a_tag_is_of_one_that_has_no_name(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings(target=""))
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert done.json["targets"] == []
    assert done.json["shown"] > 20


def test_late_and_repeated_readings_are_warned_of(call, tmp_path):
    rows = bearings()
    site, data = write(tmp_path, "bearing", [*rows, rows[-1], rows[0]])
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert done.code == 0
    assert done.json["warnings"] == [
        f"{data}: 1 readings came again and were dropped",
        f"{data}: 1 readings came later than tracker.window_s = 1 allows and were dropped",
    ]


def test_two_targets_without_tags_are_suspected_where_much_comes_again(call, tmp_path):
    rows = bearings(target="")
    site, data = write(tmp_path, "bearing", [row for row in rows for _ in range(2)])
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert done.json["readings"]["duplicate"] == len(rows)
    assert "several targets are not named by target_id" in done.json["warnings"][-1]


def test_strengths_without_their_sign_are_suspected(call, tmp_path):
    site, data = write(tmp_path, "rssi", strengths(sign=-1.0))
    done = call("check", site, data)
    assert done.code == 1
    assert "beacons are heard with less than 0 dBm" in done.out
    site, data = write(tmp_path, "rssi", strengths())
    done = call("check", site, data)
    assert done.code == 0
    assert "middle strength -7" in done.out


def test_a_file_is_told_by_its_rows_and_a_pipe_by_its_site(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings())
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    child = os.fork()
    if child == 0:
        pipe.write_bytes(data.read_bytes())
        os._exit(0)
    done = call("track", site, pipe, "-o", tmp_path / "piped.csv")
    os.waitpid(child, 0)
    assert done.code == 0
    call("track", site, data, "-o", tmp_path / "read.csv")
    assert (tmp_path / "piped.csv").read_bytes() == (tmp_path / "read.csv").read_bytes()


WRONG = {
    "bearing": [
        ("0,A,bearing,40,T\n", "", "expected an angle in radians, -2 pi to 2 pi"),
        ("0,A,bearing,nan,T\n", "", "expected a finite number"),
        ("0,E,bearing,0.3,T\n", "", "expected a sensor of the site"),
        ("0,A,bearing,0.3,T\n0,B,rssi,-60,T\n", "", "kinds bearing, rssi, expected one kind"),
        ("0,A,rssi,-60,T\n", "", "expected 'rssi' of all"),
        ("0,A,angular_rate,0.3,T\n", "", "found kind 'angular_rate' from 'A', expected the kind"),
        ("0,A,bearing,0.3,T\n0,B,bearing,2.4,T\n", "", "no time at which a track could start"),
        ("0,A,bearing,0.3,T\n", "sigma_rad = 0\n", "expected a number above 0"),
    ],
    "rssi": [
        ("0,A,rssi,-300,T\n", "", "expected a strength in dBm, -200 to 100"),
        ("0,A,rssi,,T\n", "", "found nothing"),
        ("0,A,bearing,0.1,T\n", "", "expected 'bearing', 'angular_rate' or 'motion' of all"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "rows", "model", "words"),
    [(kind, *case) for kind, cases in WRONG.items() for case in cases],
)
def test_wrong_input_is_one_message_and_exit_2(call, tmp_path, kind, rows, model, words):
    site, data = write(tmp_path, kind, [rows], model=model)
    done = call("track", site, data, "-o", tmp_path / "tracks.csv")
    assert done.code == 2
    assert words in done.err
    assert done.err.count("error: ") == 1
    assert "Traceback" not in done.err
    assert not (tmp_path / "tracks.csv").exists()


@pytest.mark.parametrize("kind", ["bearing", "angular_rate", "motion", "rssi", "amplitude"])
def test_a_single_sensor_is_refused(call, tmp_path, kind):
    rows = [f"{0.1 * k:.1f},A,{kind},-0.5,T\n" for k in range(50)]
    site, data = write(tmp_path, kind, rows, sensors="sensor_id,x_m,y_m\nA,0,0\n")
    least = 3 if kind == "amplitude" else 2
    for command in (("track", site, data, "-o", tmp_path / "t.csv"), ("check", site, data)):
        done = call(*command)
        assert done.code == (2 if command[0] == "track" else 1)
        assert f"found 1 sensors (A), expected at least {least}" in done.err + done.out


def test_sensors_of_which_only_one_speaks_are_refused(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings(sensors="A"))
    done = call("track", site, data, "-o", tmp_path / "t.csv")
    assert done.code == 2
    assert "of the sensors that say anything: found 1 sensors (A)" in done.err


def test_a_method_of_unknown_targets_is_refused(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings())
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--method", "mcmcda")
    assert done.code == 2
    assert "--method: found 'mcmcda', expected 'imm' or 'cv'" in done.err


MIXED = """
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
model = "uwb"
"""


def test_ranges_and_bearings_are_planned_with_and_not_tracked_together(call, tmp_path):
    site, data, tracks = (tmp_path / name for name in ("site.toml", "data.csv", "tracks.csv"))
    site.write_text(MIXED)
    done = call("check", site, "--json").json
    assert (done["ok"], done["sensors"]) == (True, 2)
    assert done["settings"]["models.camera.max_range_m"] == {"value": 30, "source": "given"}
    rows = {"bearing": "0,A,bearing,0.3,T\n", "range": "0,B,range,7.3,T\n"}
    for kind, words in (("bearing", "found sensor 'B' of kind 'range'"), ("range", "'A' of kind")):
        data.write_text(HEADER + rows[kind])
        done = call("track", site, data, "-o", tracks)
        assert (done.code, words in done.err) == (2, True)
    data.write_text(HEADER + "".join(rows.values()))
    assert "expected one kind" in call("check", site, data).out
    assert call("track", site, data, "-o", tracks).code == 2


def test_bearings_are_not_calibrated(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings())
    (tmp_path / "truth.csv").write_text("t_s,target_id,x_m,y_m\n0,cart,5,5\n1,cart,5,5\n")
    done = call("calibrate", site, data, tmp_path / "truth.csv", "-o", tmp_path / "out.toml")
    assert done.code == 2
    assert "found sensors of kind 'bearing', expected ranges, signals, detections or" in done.err


ROOMS = """
[[rooms]]
id = "west"
polygon = [[0, 0], [5, 0], [5, 8], [0, 8]]
[[rooms]]
id = "east"
polygon = [[5, 0], [10, 0], [10, 8], [5, 8]]
"""


def test_rooms_are_told_of_whoever_is_tracked(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings())
    site.write_text(site.read_text() + ROOMS)
    tracks, rooms = tmp_path / "tracks.csv", tmp_path / "rooms.csv"
    done = call("track", site, data, "-o", tracks, "--rooms", rooms, "--json")
    assert (done.code, done.err) == (0, "")
    assert (done.json["rooms"], done.json["room_changes"]) == (str(rooms), 1)
    header, *rows = rooms.read_text().splitlines()
    assert header == "t_s,track_id,target_id,room,p"
    assert len(rows) == done.json["shown"]
    told = [row.split(",")[3] for row in rows]
    assert told == ["west"] * told.count("west") + ["east"] * told.count("east")
    crossed = float(rows[told.count("west")].split(",")[0])
    assert 6.0 <= crossed < 9.0  # the cart crosses after 6 s: it is told when it is sure
    text = call("track", site, data, "-o", tracks, "--rooms", rooms).out
    assert f"{rooms}: {len(rows)} rows, 1 changes of rooms" in text


def test_rooms_that_cannot_be_told_are_refused_before_the_work(call, tmp_path):
    site, data = write(tmp_path, "bearing", bearings())
    tracks = tmp_path / "tracks.csv"
    done = call("track", site, data, "-o", tracks, "--rooms", tmp_path / "rooms.csv")
    assert (done.code, "found no rooms in site yard" in done.err) == (2, True)
    site.write_text(site.read_text() + ROOMS)
    for path, words in ((tracks, "where tracks are written"), (data, "found an input")):
        done = call("track", site, data, "-o", tracks, "--rooms", path)
        assert (done.code, words in done.err) == (2, True)
    assert not tracks.exists()


def test_values_of_a_kind_that_the_site_has_not_are_not_judged_as_ranges(call, tmp_path):
    site, data = write(tmp_path, "rssi", strengths())
    site.write_text(site.read_text().replace("'rssi'", "'range'"))
    done = call("check", site, data)
    assert done.code == 1
    assert "of kind 'range', expected 'rssi' of all" in done.out
    assert "both in metres" not in done.out
