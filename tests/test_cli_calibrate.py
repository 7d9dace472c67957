"""`trackfield calibrate`: the site it writes, and tracks that get better by it."""

import shutil

import pytest

import cli_runs
from trackfield.network.site_file import load_site


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def run(tmp_path):
    return cli_runs.write_run(tmp_path / "run")


def inputs(folder):
    return [folder / name for name in ("site.toml", "measurements.csv", "truth.csv")]


def test_the_written_site_knows_the_bias_and_where_its_sensors_stand(call, run, tmp_path):
    output = tmp_path / "calibrated.toml"
    done = call("calibrate", *inputs(run), "-o", output)
    assert (done.code, done.err) == (0, "")
    assert f"{output}: written" in done.out
    assert "bias [m]" in done.out
    site = load_site(output)
    assert site.sensor_ids == ("A", "B", "C", "D")
    for model in site.models:
        assert model.bias_m + model.scale * 10.0 == pytest.approx(cli_runs.BIAS_M, abs=0.05)
    assert 'sensors_file = "run/sensors.csv"' in output.read_text()


def test_json_tells_every_sensor_with_standard_errors(call, run, tmp_path):
    done = call("calibrate", *inputs(run), "-o", tmp_path / "c.toml", "--json")
    found = done.json
    assert [row["sensor_id"] for row in found["sensors"]] == ["A", "B", "C", "D"]
    assert all(row["bias_error_m"] > 0 and row["readings"] == 100 for row in found["sensors"])
    assert (found["used"], found["readings"]) == (400, 400)
    assert set(found["clock_offset_s"]) == {"tag"}


def test_a_calibrated_site_tracks_another_run_better(call, run, tmp_path):
    other = cli_runs.write_run(tmp_path / "other", seed=1)
    call("calibrate", *inputs(run), "-o", tmp_path / "c.toml")
    rmse = {}
    for name, site in (("before", other / "site.toml"), ("after", tmp_path / "c.toml")):
        output = tmp_path / f"{name}.csv"
        text = site.read_text()
        site.write_text(text + "\n[tracker]\nself_calibration = false\n")
        assert call("track", site, other / "measurements.csv", "-o", output).code == 0
        rmse[name] = call("score", other / "truth.csv", output, "--json").json["rmse_m"]
    assert rmse["after"] < 0.12 < rmse["before"]


def test_sensors_beside_the_written_site_are_those_of_the_same_kit_set_up_there(
    call, run, tmp_path
):
    there = tmp_path / "there"
    there.mkdir()
    (there / "sensors.csv").write_text("sensor_id,x_m,y_m\nD,0,1\nE,5,5\nA,9,1\n")
    done = call("calibrate", *inputs(run), "-o", there / "site.toml", "--json")
    assert done.json["sensors_file"] == str(there / "sensors.csv")
    site = load_site(there / "site.toml")
    assert site.sensor_ids == ("D", "E", "A")
    at_home = load_site(run / "site.toml")
    assert [model.bias_m for model in site.models] != [model.bias_m for model in at_home.models]
    assert site.models[1].bias_m == pytest.approx(cli_runs.BIAS_M, abs=0.2)  # by its kin


def test_a_site_may_be_calibrated_in_its_place(call, run):
    site = run / "site.toml"
    assert call("calibrate", *inputs(run), "-o", site).code == 0
    assert 'sensors_file = "sensors.csv"' in site.read_text()
    assert call("calibrate", *inputs(run), "-o", site).code == 0


def test_how_well_the_models_fit_is_drawn(call, run, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "fit.png"
    done = call("calibrate", *inputs(run), "-o", tmp_path / "c.toml", "--plot", picture)
    assert done.code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "truth.csv").write_text("t_s,target_id,x_m\n"), "truth.csv, line 1"),
        (lambda f: (f / "truth.csv").unlink(), "truth.csv: cannot be read"),
        (
            lambda f: (f / "truth.csv").write_text("t_s,target_id,x_m,y_m\n99,tag,0,0\n"),
            "30 readings beside its truth",
        ),
        (lambda f: (f / "measurements.csv").write_text(""), "found an empty file"),
        (lambda f: shutil.copy(f / "sensors.csv", f / "site.toml"), "site.toml: not TOML"),
    ],
)
def test_bad_input_is_one_message_and_leaves_no_site(call, run, tmp_path, spoil, message):
    spoil(run)
    output = tmp_path / "c.toml"
    done = call("calibrate", *inputs(run), "-o", output)
    assert done.code == 2
    (line,) = done.err.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert not output.exists()


def test_a_place_that_cannot_be_written_is_refused(call, run, tmp_path):
    done = call("calibrate", *inputs(run), "-o", tmp_path / "absent" / "c.toml")
    assert done.code == 2
    assert "c.toml: cannot be written" in done.err


def test_ranges_in_millimetres_are_warned_of(call, run, tmp_path):
    data = run / "measurements.csv"
    head, *rows = data.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    large = [[t, name, kind, f"{1000 * float(value)}", tag] for t, name, kind, value, tag in cells]
    data.write_text("\n".join([head, *map(",".join, large)]) + "\n")
    done = call("calibrate", *inputs(run), "-o", tmp_path / "c.toml", "--json")
    assert "are both in metres?" in done.err
    assert done.code == 0
    assert done.json["warnings"] == [done.err.removeprefix("warning: ").rstrip("\n")]
    assert done.json["clock_error_s"] == {"tag": None}  # not to be told from such readings


@pytest.mark.parametrize("name", ["measurements.csv", "truth.csv", "sensors.csv"])
def test_no_input_is_overwritten(call, run, name):
    before = (run / name).read_text()
    done = call("calibrate", *inputs(run), "-o", run / name)
    assert done.code == 2
    assert done.err == f"error: {run / name}: found an input, expected another file to write to\n"
    assert (run / name).read_text() == before


def test_a_place_that_cannot_be_written_is_told_before_the_work(call, run, tmp_path):
    for options in (["-o", tmp_path / "no" / "c.toml"], ["-o", tmp_path]):
        done = call("calibrate", *inputs(run), *options)
        assert done.code == 2
        assert "cannot be written: found" in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]


def test_runs_that_do_not_belong_together_are_named(call, run, tmp_path):
    truth = run / "truth.csv"
    truth.write_text("t_s,target_id,x_m,y_m\n9000,tag,1,1\n9001,tag,2,1\n")
    done = call("calibrate", *inputs(run), "-o", tmp_path / "c.toml")
    assert done.code == 2
    assert done.err.startswith(f"error: {run / 'measurements.csv'}, {truth}: found no target")


@pytest.mark.parametrize("method", ["weighted", "least-squares"])
def test_wangs_statistics_serve_all_sensors_alike(call, run, tmp_path, method):
    done = call("calibrate", *inputs(run), "-o", tmp_path / "c.toml", "--method", method, "--json")
    assert done.code == 0
    assert len({row["bias_m"] for row in done.json["sensors"]}) == 1


def test_a_method_that_is_none(call, run, tmp_path):
    done = call("calibrate", *inputs(run), "-o", tmp_path / "c.toml", "--method", "magic")
    assert done.code == 2
    assert "--method: found 'magic', expected robust, weighted or least-squares" in done.err
