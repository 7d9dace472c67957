"""Unknown targets on the command line and from Python: the same calls, whatever the data are."""

from __future__ import annotations

import csv
import os
import threading
from dataclasses import replace

import numpy as np
import pytest

import cli_runs
import field_runs
import trackfield
from trackfield.errors import ConfigurationError, InputError
from trackfield.io.data import data_from_columns, holds_reports
from trackfield.io.measurements import write_readings
from trackfield.io.reports import read_reports, write_reports
from trackfield.io.truth import write_truth
from trackfield.network.site import TrackerSettings
from trackfield.network.site_file import load_site
from trackfield.network.site_writer import write_site
from trackfield.pipeline.extent import settled, spanned, usual_step
from trackfield.raster import Region
from trackfield.sensing.signal import SignalModel
from trackfield.types import Reports, select_rows
from untagged_runs import site, table, walkers

OPEN = "[site]\nname = 'square'\n[reports]\n"
RUN = walkers(seed=4, steps=60, targets=4, clutter=1.5)


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def run(tmp_path):
    (tmp_path / "site.toml").write_text(OPEN)
    write_reports(tmp_path / "reports.csv", RUN)
    return tmp_path


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_reports_become_tracks_and_region_and_step_are_derived(call, run):
    output = run / "tracks.csv"
    done = call("track", run / "site.toml", run / "reports.csv", "-o", output)
    assert (done.code, done.err) == (0, "")
    assert f"reports: {len(RUN)} accepted, 0 of them late; 0 dropped" in done.out
    assert "learned: sigma_m 0." in done.out
    rows = rows_of(output)
    assert {row["target_id"] for row in rows} == {""}
    assert len({row["track_id"] for row in rows if row["status"] == "confirmed"}) >= 4
    found = call("track", run / "site.toml", run / "reports.csv", "-o", output, "--json").json
    assert (found["source"], found["method"], found["step_s"]) == ("reports", "bernoulli", 0.5)
    assert found["region"] == pytest.approx([0, 0, 60, 40], abs=4.0)
    assert found["rows"] == len(rows)
    assert found["reports"]["accepted"] == len(RUN)
    assert 0.15 < found["learned"]["sigma_m"] < 0.6
    assert found["warnings"] == []


@pytest.mark.parametrize("method", ["jipda", "mcmcda", "gnn", "nearest"])
def test_every_method_tracks_by_name_and_a_seed_repeats_it(call, run, method):
    outputs = [run / "a.csv", run / "b.csv"]
    for output in outputs:
        options = ("--method", method, "--seed", 3, "--lag", "2steps")
        done = call("track", run / "site.toml", run / "reports.csv", "-o", output, *options)
        assert done.code == 0
    first, second = (output.read_text() for output in outputs)
    assert first == second
    shown = [row for row in rows_of(outputs[0]) if row["status"] in ("confirmed", "coasting")]
    assert len(shown) > 150


def test_python_tracks_the_same_from_every_form(call, run):
    output = run / "tracks.csv"
    assert call("track", run / "site.toml", run / "reports.csv", "-o", output).code == 0
    place = load_site(run / "site.toml")
    columns = {"t_s": RUN.t_s, "x_m": RUN.position[:, 0], "y_m": RUN.position[:, 1]}
    halves = [select_rows(RUN, RUN.t_s < 10.0), select_rows(RUN, RUN.t_s >= 10.0)]
    forms = [RUN, columns, run / "reports.csv", str(run / "reports.csv"), halves, iter(halves)]
    first, *others = [trackfield.track(place, form) for form in forms]
    for other in others:
        np.testing.assert_array_equal(first.position, other.position)
    written = trackfield.read_tracks(output)
    np.testing.assert_allclose(written.position[:, :2], first.position[:, :2], atol=1e-6)
    told = replace(place, reports=replace(settled(place, [RUN]).reports))
    np.testing.assert_array_equal(trackfield.track(told, RUN).position, first.position)
    assert len(trackfield.track(place, RUN, lag_steps=3)) > 150


@pytest.mark.parametrize("method", ["bernoulli", "mcmcda", "nearest"])
def test_a_lag_longer_than_the_window_lengthens_it(method):
    place = site(tracker=TrackerSettings(method=method, window_steps=3))
    rows = trackfield.track(place, RUN, lag_steps=20)
    assert rows.t_s.max() == RUN.t_s.max()


def test_frames_are_data_too():
    pandas, arrow = pytest.importorskip("pandas"), pytest.importorskip("pyarrow")
    columns = {"t_s": [0.0, 1.0], "x_m": [1.0, 2.0], "y_m": [3.0, 4.0]}
    for frame in (pandas.DataFrame(columns), arrow.table(columns), columns):
        assert isinstance(data_from_columns(frame), Reports)
    said = {"t_s": [0.0], "sensor_id": ["A"], "kind": ["signal"], "value": [1.0]}
    assert not isinstance(data_from_columns(said), Reports)


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
def test_a_file_is_told_by_its_columns(tmp_path, suffix):
    reports, readings = tmp_path / f"r.{suffix}", tmp_path / f"m.{suffix}"
    write_reports(reports, RUN)
    write_readings(readings, field_runs.detections()[1])
    assert holds_reports(reports)
    assert not holds_reports(readings)
    assert not holds_reports(tmp_path / f"absent.{suffix}")
    (tmp_path / f"odd.{suffix}").write_bytes(b"\n\n")
    assert not holds_reports(tmp_path / f"odd.{suffix}")


@pytest.mark.parametrize("made", [field_runs.signals, field_runs.detections])
def test_fields_of_sensors_are_tracked_like_any_data(call, tmp_path, made):
    place, readings, truth = made(steps=25)
    write_site(place, tmp_path / "site.toml")
    write_readings(tmp_path / "measurements.csv", readings)
    write_truth(tmp_path / "truth.csv", truth)
    output = tmp_path / "tracks.csv"
    inputs = (tmp_path / "site.toml", tmp_path / "measurements.csv")
    found = call("track", *inputs, "-o", output, "--seed", 2, "--json").json
    assert found["source"] == made.__name__.removesuffix("s")
    assert found["readings"]["accepted"] == len(readings)
    score = call("score", tmp_path / "truth.csv", output, "--many", "--json").json
    assert score["mota"] > 0.6
    tracks = trackfield.track(place, readings, seed=2)
    assert len(tracks) == found["rows"]


def test_a_picture_is_drawn_of_unknown_targets(call, run):
    write_truth(run / "truth.csv", field_runs.signals(steps=5)[2])
    picture = run / "tracks.png"
    options = ("--plot", picture, "--truth", run / "truth.csv")
    done = call("track", run / "site.toml", run / "reports.csv", "-o", run / "t.csv", *options)
    assert done.code == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("name", ["run.html", "run.gif"])
def test_an_animation_is_made_of_unknown_targets(call, run, name):
    output, film = run / "tracks.csv", run / name
    args = ("track", run / "site.toml", run / "reports.csv", "-o", output)
    done = call(*args, "--every", "3", "--animate", film)
    assert (done.code, done.err) == (0, "")
    assert f"{film}: drawn" in done.out
    assert film.stat().st_size > 5000
    wrong = call(*args, "--animate", run / "run.mp4")
    assert wrong.code == 2
    assert "expected .html or .gif" in wrong.err


def test_groups_track_their_own_regions_if_the_site_says_so(call, run):
    output, place = run / "tracks.csv", run / "grouped.toml"
    groups = "".join(
        f"[[groups]]\nid = '{name}'\nx_m = {x}\ny_m = 20\n" for name, x in (("w", 10), ("e", 30))
    )
    place.write_text(OPEN + "sigma_m = 0.3\n[tracker]\nby_group = true\n" + groups)
    found = call("track", place, run / "reports.csv", "-o", output, "--json").json
    assert found["by_group"]
    assert found["handed_over"] > 0
    assert len({row["track_id"] for row in rows_of(output) if row["status"] == "confirmed"}) >= 4
    place.write_text(OPEN + "[tracker]\nby_group = true\n")
    wrong = call("track", place, run / "reports.csv", "-o", output)
    assert wrong.code == 2
    assert "tracker.by_group = true and 0 of them, expected two or more" in wrong.err


def test_what_is_dropped_is_told(call, run):
    far = [(500.0, 1.0, 1.0)]
    late = [(3.0, 2.0, 2.0)]
    odd = table([*zip(RUN.t_s, *RUN.position[:, :2].T, strict=True), *late, *far, (33.0, 900.0, 1)])
    write_reports(run / "reports.csv", odd)
    text = OPEN + "region = [0, 0, 60, 40]\nstep_s = 0.5\n"
    (run / "site.toml").write_text(text)
    done = call("track", run / "site.toml", run / "reports.csv", "-o", run / "t.csv")
    assert done.code == 0
    assert "dropped 1 row that came later than tracker.window_steps = 10 allows" in done.err
    assert "dropped 1 row that lay outside the region" in done.err
    assert "dropped 1 row that came from far ahead of all others, as of a clock" in done.err


def test_hours_without_a_target_are_a_run_without_rows(call, run):
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0.0, 3600.0, 100))
    write_reports(run / "reports.csv", table(zip(t, *rng.uniform(0, 40, (2, 100)), strict=True)))
    text = (
        OPEN + "region = [0, 0, 60, 40]\nstep_s = 0.5\nfalse_per_scan = 0.02\np_detection = 0.8\n"
    )
    (run / "site.toml").write_text(
        text + "sigma_m = 0.3\n[target]\nbirths_per_s = 0.0001\ninitial_count = 0\n"
    )
    done = call("track", run / "site.toml", run / "reports.csv", "-o", run / "t.csv", "--json")
    assert done.code == 0
    assert done.json["shown"] == 0
    assert done.json["reports"]["steps"] <= 7200
    assert "no track was shown in" in done.err


def test_reports_may_come_through_a_pipe_if_the_site_says_all(call, run):
    pipe = run / "pipe.csv"
    os.mkfifo(pipe)

    def feed():
        pipe.write_text((run / "reports.csv").read_text())

    thread = threading.Thread(target=feed, daemon=True)
    (run / "site.toml").write_text(OPEN + "region = [0, 0, 60, 40]\nstep_s = 0.5\n")
    thread.start()
    done = call("track", run / "site.toml", pipe, "-o", run / "t.csv", "--json")
    thread.join()
    assert done.code == 0
    assert done.json["reports"]["accepted"] == len(RUN)
    (run / "site.toml").write_text(OPEN)
    done = call("track", run / "site.toml", pipe, "-o", run / "t.csv")
    assert done.code == 2
    assert "reports.region: found nothing" in done.err


def test_a_pipe_of_readings_is_what_the_sensors_measure(call, tmp_path):
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    for made in (field_runs.signals, field_runs.detections):
        place, readings, _ = made(steps=4)
        told = replace(place.reports, region=Region(0.0, 0.0, 60.0, 60.0))
        write_site(replace(place, reports=told), tmp_path / "site.toml")
        write_readings(tmp_path / "file.csv", readings)
        text = (tmp_path / "file.csv").read_text()
        thread = threading.Thread(target=pipe.write_text, args=(text,), daemon=True)
        thread.start()
        output = tmp_path / "t.csv"
        found = call("track", tmp_path / "site.toml", pipe, "-o", output, "--json").json
        thread.join()
        assert found["source"] == made.__name__.removesuffix("s")
        assert found["readings"]["accepted"] == len(readings)
    models = (*place.models[1:], SignalModel())
    mixed = replace(place, models=models, model_names=("a",) * 80 + ("b",))
    write_site(mixed, tmp_path / "site.toml")
    done = call("track", tmp_path / "site.toml", pipe, "-o", tmp_path / "t.csv")
    assert done.code == 2
    assert "found a pipe, expected a file, as its sensors are of several kinds" in done.err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--method", "imm"), "--method: found 'imm', expected 'bernoulli', 'jipda', 'mcmcda'"),
        (("--truth", "x.csv"), "--truth: found no --plot"),
        (("--lag", "5000steps"), "a lag of at most 1000 steps"),
    ],
)
def test_options_that_do_not_fit_are_refused(call, run, options, said):
    done = call("track", run / "site.toml", run / "reports.csv", "-o", run / "t.csv", *options)
    assert done.code == 2
    assert said in done.err
    assert not (run / "t.csv").exists()


def test_data_that_do_not_fit_the_site_are_refused(call, run, tmp_path):
    _, readings, _ = field_runs.detections(steps=3)
    write_readings(run / "measurements.csv", readings)
    done = call("track", run / "site.toml", run / "measurements.csv", "-o", run / "t.csv")
    assert done.code == 2
    assert "sensor_id: found" in done.err
    tagged = cli_runs.write_run(tmp_path / "tagged")
    (tagged / "measurements.csv").write_text("t_s,sensor_id,kind,value\n0,A,signal,3\n")
    done = call("track", tagged / "site.toml", tagged / "measurements.csv", "-o", run / "t.csv")
    assert done.code == 2
    assert "found kind 'signal', expected 'range'" in done.err
    with pytest.raises(ConfigurationError, match="found sensor 's000' of kind 'detection'"):
        trackfield.Tracker(field_runs.detections(steps=1)[0])


def test_check_looks_at_reports(call, run):
    done = call("check", run / "site.toml", run / "reports.csv")
    assert done.code == 0
    assert "no sensors, for data that are positions" in done.out
    assert f"{len(RUN)} reports over 29.5 s, 0 outside the region" in done.out
    lines = {line.split()[0]: line.split()[1:] for line in done.out.splitlines() if line.split()}
    assert lines["reports.step_s"] == ["0.5", "derived"]
    assert lines["reports.sigma_m"] == ["-", "learned"]
    assert lines["target.births_per_s"] == ["-", "learned"]
    late = table([(0.5 * k, 5.0, 5.0, 0.5 * k + 0.2) for k in range(9)])
    write_reports(run / "late.csv", late)
    found = call("check", run / "site.toml", run / "late.csv", "--json").json
    assert found["data"]["mean_delay_s"] == pytest.approx(0.2)
    assert found["data"]["reports_a_step"] == 1.0
    assert found["settings"]["reports.step_s"] == {"value": 0.5, "source": "derived"}
    (run / "site.toml").write_text(OPEN + "[network]\n")
    done = call("check", run / "site.toml", run / "reports.csv")
    assert done.code == 1
    assert "network: found no sensors" in done.out


def test_check_looks_at_fields(call, tmp_path):
    place, readings, _ = field_runs.detections(steps=10)
    write_site(replace(place, reports=replace(place.reports, step_s=None)), tmp_path / "site.toml")
    write_readings(tmp_path / "measurements.csv", readings)
    done = call("check", tmp_path / "site.toml", tmp_path / "measurements.csv", "--json")
    assert done.code == 0
    assert done.json["data"]["median_range_m"] is None
    assert done.json["settings"]["reports.step_s"]["value"] == 1.0
    assert done.json["settings"]["reports.region"]["source"] == "derived"
    assert "81 sensors on a field of" in call("check", tmp_path / "site.toml").out


def test_calibrate_learns_binary_sensors(call, tmp_path):
    place, readings, truth = field_runs.detections(steps=40, says_zero=True)
    guess = tuple(replace(model, p_detection=0.5, radius_m=6.0) for model in place.models)
    write_site(replace(place, models=guess), tmp_path / "site.toml")
    write_readings(tmp_path / "measurements.csv", readings)
    write_truth(tmp_path / "truth.csv", truth)
    inputs = [tmp_path / name for name in ("site.toml", "measurements.csv", "truth.csv")]
    done = call("calibrate", *inputs, "-o", tmp_path / "c.toml")
    assert (done.code, done.err) == (0, "")
    assert "radius [m]" in done.out
    learned = load_site(tmp_path / "c.toml").models
    assert learned[40].radius_m == pytest.approx(7.62, abs=0.5)
    assert learned[40].p_detection == pytest.approx(0.7, abs=0.1)
    found = call("calibrate", *inputs, "-o", tmp_path / "c.toml", "--json").json
    assert len(found["sensors"]) == 81
    assert found["pooled"]["p_false"] == pytest.approx(0.05, abs=0.02)
    done = call("calibrate", *inputs, "-o", tmp_path / "c.toml", "--method", "weighted")
    assert done.code == 2
    assert "which is for ranges" in done.err
    by_python = trackfield.calibrate(inputs[0], *inputs[1:])
    assert by_python.site.models[40].radius_m == pytest.approx(learned[40].radius_m)


def test_calibrate_learns_signals(call, tmp_path):
    place, readings, truth = field_runs.signals(steps=40)
    guess = tuple(replace(model, amplitude=300.0) for model in place.models)
    write_site(replace(place, models=guess), tmp_path / "site.toml")
    write_readings(tmp_path / "measurements.csv", readings)
    write_truth(tmp_path / "truth.csv", truth)
    inputs = [tmp_path / name for name in ("site.toml", "measurements.csv", "truth.csv")]
    done = call("calibrate", *inputs, "-o", tmp_path / "c.toml")
    assert (done.code, done.err) == (0, "")
    assert "spread of gains" in done.out
    found = call("calibrate", *inputs, "-o", tmp_path / "c.toml", "--json").json
    pooled = found["pooled"]
    strength = pooled["amplitude"] / (1.0 + pooled["falloff"] * 5.0 ** pooled["exponent"])
    assert strength == pytest.approx(400.0 / 26.0, rel=0.1)
    assert len(found["sensors"]) == 144
    by_python = trackfield.calibrate(inputs[0], *inputs[1:])
    assert by_python.calibration.pooled.amplitude == pytest.approx(pooled["amplitude"])
    kinds = (*place.models[1:], field_runs.DetectionModel())
    mixed = replace(place, models=kinds, model_names=("a",) * 143 + ("b",))
    write_site(mixed, tmp_path / "site.toml")
    done = call("calibrate", *inputs, "-o", tmp_path / "c.toml")
    assert done.code == 2
    assert "found sensors of kinds detection, signal, expected one kind" in done.err


@pytest.mark.parametrize(
    ("times", "step"),
    [
        ([0.0, 0.4, 0.8, 0.8, 2.4], 0.4),
        ([5.0], 1.0),
        ([0.0, 0.101, 0.199, 0.3, 0.6], 0.1),
        (np.arange(0.0, 100.0, 1 / 3), 0.333333333),
    ],
)
def test_the_usual_step_is_that_of_most_gaps(times, step):
    assert usual_step(np.array(times)) == pytest.approx(step, rel=1e-9)


def test_a_region_is_spanned_but_for_the_wildest():
    rng = np.random.default_rng(0)
    places = rng.uniform((0, 10), (50, 30), (3000, 2))
    places[5] = (1e6, -1e6)
    region = spanned(places)
    assert region == pytest.approx((-2.5, 9.0, 52.5, 31.0), abs=0.3)
    assert spanned(np.array([[1.0, 2.0], [4.0, 2.0]])) == pytest.approx((0.0, 1.0, 5.0, 3.0))


def test_a_site_that_says_all_is_handed_back_and_a_run_without_rows_refused():
    place = site()
    assert settled(place, iter(())) is place
    open_site = replace(place, reports=replace(place.reports, step_s=None))
    with pytest.raises(InputError, match="found no rows"):
        settled(open_site, [table([])])
    assert settled(open_site, [RUN]).reports.step_s == 0.5


def test_a_long_run_is_settled_by_a_sample():
    rng = np.random.default_rng(1)
    chunks = [
        table(zip(np.arange(i, i + 40_000.0), *rng.uniform(0, 9, (2, 40_000)), strict=True))
        for i in range(0, 200_000, 40_000)
    ]
    open_site = replace(site(), reports=replace(site().reports, step_s=None, region=None))
    found = settled(open_site, chunks).reports
    assert found.step_s == 1.0
    assert found.region == pytest.approx((-1.0, -1.0, 10.0, 10.0), abs=0.1)


def test_reports_of_nothing_are_read_back_by_the_reader(run):
    assert len(read_reports(run / "reports.csv")) == len(RUN)


def test_a_fault_in_a_file_names_it_once(call, run):
    (run / "reports.csv").write_text("t_s,x_m,y_m\n0,1,2\n1,nan,3\n")
    done = call("track", run / "site.toml", run / "reports.csv", "-o", run / "t.csv")
    assert done.code == 2
    where = f"{run / 'reports.csv'}, line 3: x_m"
    assert done.err == f"error: {where}: found 'nan', expected a finite number\n"
