"""`trackfield track`: what it writes, what it says, and what it refuses."""

import csv
import os
import signal
import subprocess
import sys
import time

import pytest

import cli_runs
from trackfield.cli.runs import Lag, parse_lag
from trackfield.errors import ConfigurationError


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def run(tmp_path):
    return cli_runs.write_run(tmp_path / "run")


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def test_tracks_are_written_as_the_contract_says(call, run, tmp_path):
    output = tmp_path / "tracks.csv"
    done = call("track", run / "site.toml", run / "measurements.csv", "-o", output)
    assert (done.code, done.err) == (0, "")
    assert f"{output}: " in done.out
    rows = list(csv.DictReader(output.read_text().splitlines()))
    columns = "t_s track_id x_m y_m z_m vx_m_s vy_m_s vz_m_s cov_xx cov_xy cov_yy status target_id"
    assert list(rows[0]) == columns.split()
    assert {row["target_id"] for row in rows} == {"tag"}
    assert {row["status"] for row in rows[20:]} == {"confirmed"}
    last = rows[-1]
    assert abs(float(last["x_m"]) - 15.94) < 1.0
    assert abs(float(last["y_m"]) - 6.5) < 1.0


def test_json_is_one_object_and_counts_readings(call, run, tmp_path):
    output = tmp_path / "tracks.csv"
    done = call("track", run / "site.toml", run / "measurements.csv", "-o", output, "--json")
    assert done.code == 0
    found = done.json
    assert found["tracks"] == str(output)
    assert found["targets"] == ["tag"]
    assert found["readings"]["accepted"] == 400
    assert found["readings"]["duplicate"] == 0
    assert found["rows"] == len(output.read_text().splitlines()) - 1
    assert found["warnings"] == []


def test_a_lag_makes_better_tracks_and_rows_may_be_thinned(call, run, tmp_path):
    site = run / "site.toml"
    site.write_text(site.read_text() + f"bias_m = {cli_runs.BIAS_M}\nsigma_m = 0.1\n")
    scores = []
    for i, option in enumerate(([], ["--lag", "2"], ["--lag", "2s"], ["--lag", "20steps"])):
        output = tmp_path / f"{i}.csv"
        assert (
            call("track", run / "site.toml", run / "measurements.csv", "-o", output, *option).code
            == 0
        )
        scores.append(call("score", run / "truth.csv", output, "--json").json["rmse_m"])
    assert scores[1] < 0.8 * scores[0]
    assert scores[2] == scores[1]
    assert scores[3] < 0.8 * scores[0]
    thin = tmp_path / "thin.csv"
    call("track", run / "site.toml", run / "measurements.csv", "-o", thin, "--every", "1")
    assert 30 < len(thin.read_text().splitlines()) < 60


def test_method_takes_the_place_of_the_sites_motion(call, run, tmp_path):
    texts = []
    for method in ("imm", "cv"):
        output = tmp_path / f"{method}.csv"
        arguments = ("-o", output, "--method", method)
        assert call("track", run / "site.toml", run / "measurements.csv", *arguments).code == 0
        texts.append(output.read_text())
    assert texts[0] != texts[1]


def test_a_picture_is_drawn_with_and_without_truth(call, run, tmp_path):
    pytest.importorskip("matplotlib")
    for more in ([], ["--truth", run / "truth.csv"]):
        picture = tmp_path / "tracks.png"
        done = call(
            "track", run / "site.toml", run / "measurements.csv", "-o", tmp_path / "t.csv",
            "--plot", picture, *more,
        )  # fmt: skip
        assert done.code == 0
        assert picture.read_bytes().startswith(b"\x89PNG")
        picture.unlink()


def test_repeated_and_late_readings_are_dropped_and_counted(call, run, tmp_path):
    data = run / "measurements.csv"
    lines = data.read_text().splitlines(keepends=True)
    lines += [lines[-1], lines[-1], lines[5]]
    data.write_text("".join(lines))
    done = call("track", run / "site.toml", data, "-o", tmp_path / "t.csv", "--json")
    assert done.code == 0
    assert done.json["readings"]["duplicate"] == 2
    assert done.json["readings"]["late"] == 1
    assert f"warning: {data}: 2 readings came again and were dropped\n" in done.err
    assert f"{data}: 1 readings came later than tracker.window_s = 1 allows" in done.err
    assert done.json["warnings"] == [line[len("warning: ") :] for line in done.err.splitlines()]


def test_readings_beyond_the_greatest_range_are_told(call, run, tmp_path):
    site = run / "site.toml"
    site.write_text(site.read_text() + "max_range_m = 12.0\n")
    data = run / "measurements.csv"
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    count = done.json["readings"]["out_of_range"]
    assert count > 0
    assert (
        done.err == f"warning: {data}: {count} readings were beyond max_range_m and were dropped\n"
    )


def test_a_run_that_starts_no_track_names_its_file(call, run, tmp_path):
    data = run / "measurements.csv"
    data.write_text("".join(data.read_text().splitlines(keepends=True)[:5]))
    done = call("track", run / "site.toml", data, "-o", tmp_path / "t.csv")
    assert done.code == 2
    assert done.err.startswith(f"error: {data}: found 4 usable readings")


def test_ranges_in_millimetres_are_warned_of(call, run, tmp_path):
    data = run / "measurements.csv"
    rows = list(csv.reader(data.read_text().splitlines()))
    for row in rows[1:]:
        row[3] = str(1000 * float(row[3]))
    data.write_text("".join(",".join(row) + "\n" for row in rows))
    done = call("track", run / "site.toml", data, "-o", tmp_path / "t.csv")
    assert done.code in (0, 1)
    assert "are both in metres?" in done.err
    assert "Traceback" not in done.err


def change(line, old, new):
    def apply(folder):
        data = folder / "measurements.csv"
        lines = data.read_text().splitlines(keepends=True)
        assert old in lines[line - 1]
        lines[line - 1] = lines[line - 1].replace(old, new)
        data.write_text("".join(lines))

    return apply


def write(name, content):
    def apply(folder):
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    return apply


def only(*sensors):
    def apply(folder):
        data = folder / "measurements.csv"
        lines = data.read_text().splitlines(keepends=True)
        kept = [line for line in lines[1:] if line.split(",")[1] in sensors]
        data.write_text("".join([lines[0], *kept]))

    return apply


HEAD = "sensor_id,x_m,y_m\n"
BAD = {
    "missing column": (change(1, "value", "valeur"), ["measurements.csv, line 1", "'value'"]),
    "unknown sensor": (change(4, ",C,", ",Z,"), ["measurements.csv, line 4", "'Z'", "A, B, C, D"]),
    "no number": (change(3, "range,", "range,x"), ["measurements.csv, line 3: value: found 'x"]),
    "NaN": (write("measurements.csv", "t_s,sensor_id,kind,value\n0,A,range,nan\n"), ["line 2"]),
    "infinite": (write("measurements.csv", "t_s,sensor_id,kind,value\n0,A,range,inf\n"), ["'inf'"]),
    "negative": (change(5, "range,", "range,-"), ["line 5: value: found '-", "0 or more"]),
    "unknown kind": (change(5, "range", "rage"), ["line 5: kind: found 'rage'", "range"]),
    "empty": (write("measurements.csv", ""), ["measurements.csv: found an empty file"]),
    "only a header": (
        write("measurements.csv", "t_s,sensor_id,kind,value\n"),
        ["measurements.csv: found no rows"],
    ),
    "binary": (write("measurements.csv", b"\x00\xff\x13" * 99), ["measurements.csv", "binary"]),
    "two at one place": (
        write("sensors.csv", HEAD + "A,0,0\nB,20,0\nC,20,0\nD,0,15\n"),
        ["sensors.csv, line 4: found 'C' at (20, 0) m, the place of 'B'"],
    ),
    "on a line": (
        write("sensors.csv", HEAD + "A,0,0\nB,1,1\nC,2,2\nD,3,3\n"),
        ["site.toml: found all 4 sensors (A, B, C, D) on a line"],
    ),
    "two sensors": (
        write("sensors.csv", HEAD + "A,0,0\nB,20,0\n"),
        ["site.toml: found 2 sensors (A, B), expected at least 3"],
    ),
    "two speak": (only("A", "C"), ["measurements.csv: of the sensors", "found 2 sensors (A, C)"]),
    "no site": (lambda folder: (folder / "site.toml").unlink(), ["site.toml: found no such file"]),
    "bad site": (write("site.toml", "[site"), ["site.toml: not TOML"]),
    "no data": (
        lambda folder: (folder / "measurements.csv").unlink(),
        ["measurements.csv: cannot be read"],
    ),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_one_message_and_leaves_no_file(call, run, tmp_path, fault):
    spoil, parts = BAD[fault]
    spoil(run)
    before = files(tmp_path)
    output = tmp_path / "tracks.csv"
    done = call("track", run / "site.toml", run / "measurements.csv", "-o", output, "--json")
    assert done.code == 2
    assert done.out == ""
    (message,) = done.err.splitlines()
    assert message.startswith("error: ")
    for part in parts:
        assert part in message
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "DIR/absent/t.csv"], "cannot be written: found no folder"),
        (["-o", "DIR"], "cannot be written: found a folder, expected a file"),
        (["-o", "DIR/tracks"], "found no suffix"),
        (["-o", "DIR/t.xls"], "found suffix '.xls', expected one of .csv"),
        (["-o", "DIR/t.csv", "--lag", "soon"], "--lag: found 'soon', expected seconds (2 or 2s)"),
        (["-o", "DIR/t.csv", "--lag", "-1"], "--lag: found '-1', expected"),
        (["-o", "DIR/t.csv", "--method", "magic"], "--method: found 'magic', expected 'imm' or"),
        (["-o", "DIR/t.csv", "--plot", "DIR/t.xyz"], "found suffix '.xyz', expected one of"),
        (
            ["-o", "DIR/t.csv", "--plot", "DIR/t.png", "--truth", "DIR/none.csv"],
            "none.csv: cannot be read",
        ),
        (["-o", "DIR/t.csv", "--truth", "DIR/run/truth.csv"], "--truth: found no --plot"),
        (["-o", "DIR/t.csv", "--plot", "DIR/absent/t.png"], "t.png: cannot be written: found no"),
        (["-o", "DIR/t.geojson"], "origin"),
        (["-o", "DIR/run/measurements.csv"], "measurements.csv: found an input, expected another"),
        (["-o", "DIR/t.csv", "--every", "-1"], "Invalid value for '--every'"),
        ([], "Missing option '-o'"),
    ],
)
def test_wrong_options_are_told_before_the_work(call, run, tmp_path, options, message):
    given = [option.replace("DIR", str(tmp_path)) for option in options]
    done = call("track", run / "site.toml", run / "measurements.csv", *given)
    assert done.code == 2
    assert message in done.err
    assert "Traceback" not in done.err
    assert files(tmp_path) == ["run"]


def test_a_run_that_confirms_nothing_fails(call, run, tmp_path):
    data = run / "measurements.csv"
    data.write_text("".join(data.read_text().splitlines(keepends=True)[:8]))
    done = call("track", run / "site.toml", data, "-o", tmp_path / "t.csv")
    assert done.code in (1, 2)
    assert done.err.startswith("error: ")
    assert files(tmp_path) == ["run"]


def opened_for_writing(pipe, process):
    """The end of `pipe` that feeds `process`, once that has opened the other one."""
    while process.poll() is None:
        try:
            return os.fdopen(os.open(pipe, os.O_WRONLY | os.O_NONBLOCK), "w")
        except OSError:  # nobody reads yet
            time.sleep(0.02)
    pytest.fail(f"the program ended early: {process.stderr.read()}")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_an_interrupt_leaves_no_file_and_exits_130(run, tmp_path):
    pipe, output = tmp_path / "pipe.csv", tmp_path / "out"
    output.mkdir()
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "trackfield.cli", "track", run / "site.toml", pipe]
    with (
        subprocess.Popen(
            [*command, "-o", output / "tracks.csv"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as process,
        opened_for_writing(pipe, process) as feed,
    ):
        feed.write((run / "measurements.csv").read_text())
        feed.flush()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=300)
    assert process.returncode == 130
    assert (out, err) == (b"", b"interrupted\n")
    assert files(output) == []


def test_lags_are_seconds_or_updates():
    assert parse_lag("2") == parse_lag("2s") == parse_lag("2.0") == Lag(seconds=2.0)
    assert parse_lag("10steps") == Lag(steps=10)
    assert parse_lag("0") == Lag()
    for text in ("", "s", "steps", "1.5steps", "-2steps", "nan", "inf", "2m"):
        with pytest.raises(ConfigurationError, match="--lag: found"):
            parse_lag(text)


def test_one_target_needs_no_name(call, run):
    """What the pages say: leave `target_id` out if there is only one."""
    data = run / "measurements.csv"
    named = call("track", run / "site.toml", data, "-o", run / "named.csv")
    data.write_text("\n".join(line.rpartition(",")[0] for line in data.read_text().splitlines()))
    done = call("track", run / "site.toml", data, "-o", run / "tracks.csv", "--json")
    assert (named.code, done.code) == (0, 0)
    assert done.json["targets"] == []
    rows = (run / "tracks.csv").read_text()
    assert rows == (run / "named.csv").read_text().replace(",tag\n", ",\n")
