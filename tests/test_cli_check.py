"""`trackfield check`: defaults, geometry, and what is odd about data."""

import pytest

import cli_runs


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def run(tmp_path):
    return cli_runs.write_run(tmp_path / "run")


def test_a_sound_site_is_said_to_be_sound_and_which_defaults_apply(call, run):
    site = run / "site.toml"
    site.write_text(site.read_text() + "max_range_m = 40\n[target]\nmax_speed_m_s = 3\n")
    done = call("check", site)
    assert (done.code, done.err) == (0, "")
    lines = {line.split()[0]: line.split()[1:] for line in done.out.splitlines() if line.split()}
    assert lines["models.uwb.max_range_m"] == ["40", "given"]
    assert lines["models.uwb.sigma_m"][-1] == "default"
    assert lines["target.max_speed_m_s"] == ["3", "given"]
    assert lines["tracker.self_calibration"] == ["true", "default"]
    assert lines["found"] == ["no", "problem"]


def test_data_are_counted(call, run):
    data = run / "measurements.csv"
    lines = data.read_text().splitlines(keepends=True)
    lines[1:] = [line for line in lines[1:] if not 10 <= float(line.split(",")[0]) < 25]
    lines += [lines[-1], lines[50]]
    data.write_text("".join(lines))
    found = call("check", run / "site.toml", data, "--json").json["data"]
    assert found["readings"] == 252
    assert found["repeated"] == 2
    assert found["out_of_order"] == found["too_late"] == 1
    assert found["latest_s"] == pytest.approx(39.9 - 4.9)
    assert found["longest_gap_s"] == pytest.approx(15.1)
    assert found["targets"] == ["tag"]
    assert sum(found["per_sensor"].values()) == 252
    text = call("check", run / "site.toml", data).out
    assert "252 readings over 39.9 s, targets: tag" in text
    assert "2 repeated; 1 out of order" in text


@pytest.mark.parametrize(
    ("sensors", "problem"),
    [
        ("A,0,0\nB,1,1\nC,2,2\nD,3,3\n", "found all 4 sensors (A, B, C, D) on a line"),
        ("A,0,0\nB,9,0\n", "found 2 sensors (A, B), expected at least 3"),
        ("A,0,0\n", "found 1 sensors (A), expected at least 3"),
    ],
)
def test_a_geometry_that_fixes_no_position_fails_the_check(call, run, sensors, problem):
    (run / "sensors.csv").write_text("sensor_id,x_m,y_m\n" + sensors)
    done = call("check", run / "site.toml", "--json")
    assert done.code == 1
    assert done.json["ok"] is False
    assert problem in done.json["problems"][0]
    assert f"problem: {run / 'site.toml'}: {problem}" in call("check", run / "site.toml").out


def test_sensors_that_never_speak_are_told_and_too_few_that_do_fail(call, run):
    data = run / "measurements.csv"
    lines = data.read_text().splitlines(keepends=True)
    data.write_text("".join(line for line in lines if ",D," not in line))
    done = call("check", run / "site.toml", data)
    assert done.code == 0
    assert "silent sensors: D" in done.out
    data.write_text("".join(line for line in lines if ",D," not in line and ",B," not in line))
    done = call("check", run / "site.toml", data)
    assert done.code == 1
    assert "found 2 sensors (A, C), expected at least 3" in done.out


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_another_unit_is_suspected(call, run, factor):
    data = run / "measurements.csv"
    head, *rows = [line.split(",") for line in data.read_text().splitlines()]
    for row in rows:
        row[3] = repr(factor * float(row[3]))
    data.write_text("".join(",".join(row) + "\n" for row in [head, *rows]))
    done = call("check", run / "site.toml", data)
    assert done.code == 1
    assert "are both in metres?" in done.out


def test_sensors_in_one_plane_are_remarked_in_3d(call, run):
    (run / "sensors.csv").write_text("sensor_id,x_m,y_m,z_m\nA,0,0,3\nB,9,0,3\nC,9,9,3\nD,0,9,3\n")
    site = run / "site.toml"
    site.write_text(site.read_text() + "[target]\ndimensions = 3\n")
    done = call("check", site, "--json")
    assert done.code == 0
    assert "in one plane" in done.json["remarks"][0]


def test_faults_of_the_file_are_all_told(call, run):
    (run / "site.toml").write_text(
        "[site]\nnme = 'x'\nsensors_file = 'sensors.csv'\n[tracker]\na = 1"
    )
    done = call("check", run / "site.toml", "--json")
    assert (done.code, done.out) == (2, "")
    first, second = done.err.splitlines()
    assert first.startswith(f"error: {run / 'site.toml'}: site.nme: found an unknown key; nearest")
    assert "tracker.a: found an unknown key" in second
