"""`trackfield calibrate` for signal strength: surveys, runs, what is written, what is refused."""

import numpy as np
import pytest

import cli_runs
import trackfield
from trackfield.errors import InputError
from trackfield.network.site_file import load_site

SITE = """
[site]
name = "hall"
sensors_file = "sensors.csv"
[models.ble]
kind = "rssi"
[target]
height_m = 1.0
[[rooms]]
id = "west"
polygon = [[0, 0], [5, 0], [5, 8], [0, 8]]
"""
SENSORS = "sensor_id,x_m,y_m,z_m\nA,0,0,2\nB,10,0,2\nC,10,8,2\nD,0,8,2\n"
PLACES = np.array([[0, 0, 2], [10, 0, 2], [10, 8, 2], [0, 8, 2]], float)


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


def strength(place, rng, sigma):
    r = np.linalg.norm(PLACES - place, axis=1)
    return -62.0 - 18.0 * np.log10(r) + sigma * rng.standard_normal(4)


@pytest.fixture
def run(tmp_path):
    """Write a site, a survey, readings with truth, of power -62 dBm and exponent 1.8."""
    folder, rng = tmp_path / "run", np.random.default_rng(0)
    folder.mkdir()
    (folder / "site.toml").write_text(SITE)
    (folder / "sensors.csv").write_text(SENSORS)
    lines = ["set,sensor_id,x_m,y_m,z_m,n,mean_dbm,std_db,median_dbm"]
    for k in range(40):
        place = np.array([*rng.uniform(0, [10, 8]), 1.0])
        lines += [
            f"s{k},{name},{place[0]:.3f},{place[1]:.3f},1.0,100,{level:.2f},3.0,-70"
            for name, level in zip("ABCD", strength(place, rng, 1.0), strict=True)
        ]
    (folder / "fingerprints.csv").write_text("\n".join(lines) + "\n")
    readings, truth = ["t_s,sensor_id,kind,value,target_id"], ["t_s,target_id,x_m,y_m,z_m"]
    for k in range(300):
        t = 0.5 * k
        place = np.array([5 + 4 * np.sin(t / 11), 4 + 3 * np.cos(t / 7), 1.0])
        truth.append(f"{t},b,{place[0]},{place[1]},1.0")
        readings += [
            f"{t},{name},rssi,{level:.0f},b"
            for name, level in zip("ABCD", strength(place, rng, 3.0), strict=True)
        ]
    (folder / "measurements.csv").write_text("\n".join(readings) + "\n")
    (folder / "truth.csv").write_text("\n".join(truth) + "\n")
    return folder


def assert_learned(site):
    for model in site.models:
        level = model.power_dbm - 10 * model.exponent * np.log10(6.0)
        assert level == pytest.approx(-62.0 - 18.0 * np.log10(6.0), abs=1.0)
        assert model.exponent == pytest.approx(1.8, abs=0.3)
        assert model.sigma_db == pytest.approx(3.1, abs=0.5)


def test_a_survey_needs_no_truth_and_stays_with_the_written_site(call, run, tmp_path):
    output = tmp_path / "calibrated.toml"
    done = call("calibrate", run / "site.toml", run / "fingerprints.csv", "-o", output)
    assert (done.code, done.err) == (0, "")
    assert "power [dBm]" in done.out
    assert "a place that is left out is foretold to" in done.out
    assert f"{output}: written" in done.out
    site = load_site(output)
    assert_learned(site)
    assert site.survey is not None
    assert len(site.survey) == 160
    assert 'survey_file = "run/fingerprints.csv"' in output.read_text()
    assert [room.id for room in site.rooms] == ["west"]
    assert output.read_text().startswith("# Calibrated on fingerprints.csv.\n")


def test_json_tells_every_receiver_and_what_was_left_out(call, run, tmp_path):
    figure = tmp_path / "c.png"
    inputs = run / "site.toml", run / "fingerprints.csv"
    done = call("calibrate", *inputs, "-o", tmp_path / "c.toml", "--json", "--plot", figure)
    found = done.json
    assert [row["sensor_id"] for row in found["sensors"]] == ["A", "B", "C", "D"]
    assert all(row["fingerprints"] == 40 for row in found["sensors"])
    assert found["left_out_db"]["map"] == pytest.approx(1.0, abs=0.3)
    assert (found["readings"], found["used"], found["what"]) == (160, 160, "fingerprints")
    assert found["plot"] == str(figure)
    assert figure.stat().st_size > 10_000


def test_a_run_with_truth_calibrates_as_well(call, run, tmp_path):
    inputs = [run / name for name in ("site.toml", "measurements.csv", "truth.csv")]
    done = call("calibrate", *inputs, "-o", tmp_path / "c.toml")
    assert (done.code, done.err) == (0, "")
    assert "1200 of 1200 readings used" in done.out
    site = load_site(tmp_path / "c.toml")
    assert_learned(site)
    assert site.survey is None


def test_a_calibrated_site_may_be_calibrated_again(call, run, tmp_path):
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    call("calibrate", run / "site.toml", run / "fingerprints.csv", "-o", first)
    inputs = run / "measurements.csv", run / "truth.csv"
    assert call("calibrate", first, *inputs, "-o", second).code == 0
    site = load_site(second)
    assert_learned(site)
    assert site.survey is not None


UWB = "sensors_file = 'sensors.csv'\n[models.uwb]\nkind = 'range'\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("site.toml", "measurements.csv"), "found no TRUTH, expected where targets really were"),
        (("site.toml", "fingerprints.csv", "truth.csv"), "expected no truth such as"),
        (("site.toml", "missing.csv"), "found no TRUTH"),
        (("uwb.toml", "fingerprints.csv"), "found fingerprints for sensors of kind 'range'"),
        (("site.toml", "fingerprints.csv", "--method", "weighted"), "--method, which is for range"),
        (("site.toml", "strange.csv"), "sensor_id: found 'Z', expected a sensor of the site"),
        (("site.toml", "loud.csv"), "mean_dbm: found '7', expected a strength in dBm, -200 to 0"),
        (("site.toml", "one.csv"), "one.csv: found fingerprints of 1 places, expected 5 or more"),
        (("site.toml", "measurements.csv", "late.csv"), "found 0 of 1200 readings"),
    ],
)
def test_what_cannot_be_calibrated_is_refused(call, run, tmp_path, arguments, words):
    (run / "uwb.toml").write_text(UWB)
    head = "sensor_id,x_m,y_m,mean_dbm\n"
    (run / "strange.csv").write_text(head + "".join(f"Z,{k},1,-60\n" for k in range(9)))
    (run / "loud.csv").write_text(head + "A,1,1,7\n")
    (run / "one.csv").write_text(head + "".join(f"{name},1,1,-60\n" for name in "ABCD"))
    (run / "late.csv").write_text("t_s,target_id,x_m,y_m\n1000,b,1,1\n1001,b,2,2\n")
    paths = [run / a if a.endswith((".toml", ".csv")) else a for a in arguments]
    done = call("calibrate", *paths, "-o", tmp_path / "out.toml")
    assert done.code == 2
    assert words in done.err
    assert not (tmp_path / "out.toml").exists()


def test_many_faults_of_a_survey_are_told_by_the_first_few(call, run, tmp_path):
    rows = "".join(f"A,{k},1,9{k}\n" for k in range(9))
    (run / "bad.csv").write_text("sensor_id,x_m,y_m,mean_dbm\n" + rows)
    done = call("calibrate", run / "site.toml", run / "bad.csv", "-o", tmp_path / "out.toml")
    assert done.code == 2
    assert done.err.count("mean_dbm: found") == 5
    assert "and 4 more" in done.err


def test_a_survey_in_which_distance_does_not_matter_is_doubted(call, run, tmp_path):
    head, *lines = (run / "fingerprints.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    there = np.random.default_rng(1).permutation(len(cells) // 4)  # places belong to others
    mixed = [[*a[:2], *cells[4 * there[k // 4]][2:5], *a[5:]] for k, a in enumerate(cells)]
    odd = tmp_path / "odd.csv"
    odd.write_text("\n".join([head, *(",".join(row) for row in mixed)]) + "\n")
    done = call("calibrate", run / "site.toml", odd, "-o", tmp_path / "calibrated.toml")
    assert done.code == 0
    assert "strength hardly falls with distance" in done.err
    fine = call("calibrate", run / "site.toml", run / "fingerprints.csv", "-o", tmp_path / "c.toml")
    assert (fine.code, fine.err) == (0, "")


def test_the_survey_is_not_written_over(call, run):
    inputs = run / "site.toml", run / "fingerprints.csv"
    done = call("calibrate", *inputs, "-o", run / "fingerprints.csv")
    assert done.code == 2
    assert "found an input" in done.err


def test_python_calibrates_on_the_same_files(call, run, tmp_path):
    by_path = trackfield.calibrate(run / "site.toml", run / "fingerprints.csv")
    assert_learned(by_path.site)
    trackfield.write_site(by_path.site, tmp_path / "c.toml")
    again = load_site(tmp_path / "c.toml")
    assert again.survey is not None
    by_value = trackfield.calibrate(run / "site.toml", again.survey)
    assert by_value.site.models == by_path.site.models
    call("calibrate", run / "site.toml", run / "fingerprints.csv", "-o", tmp_path / "d.toml")
    assert load_site(tmp_path / "d.toml").models == by_path.site.models
    of_run = trackfield.calibrate(run / "site.toml", run / "measurements.csv", run / "truth.csv")
    assert_learned(of_run.site)


def test_python_refuses_what_the_program_refuses(run):
    site = load_site(run / "site.toml")
    survey = trackfield.calibrate(site, run / "fingerprints.csv").site.survey
    with pytest.raises(InputError, match="expected no truth"):
        trackfield.calibrate(site, survey, run / "truth.csv")
    with pytest.raises(InputError, match="found readings and no truth"):
        trackfield.calibrate(site, {"t_s": [0.0]})
