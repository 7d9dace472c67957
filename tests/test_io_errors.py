"""Bad input: one clear message that names the place, what was found and what was expected."""

from __future__ import annotations

import builtins
import importlib
import json
import re
from datetime import datetime

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.io import lines
from trackfield.io.measurements import read_readings, readings_from_columns
from trackfield.io.tracks import read_tracks, write_tracks
from trackfield.io.truth import read_truth

HEADER = "t_s,sensor_id,kind,value,sigma,target_id"
GOOD = "0,A0,range,1,,tag"
EXPECTED = "expected t_s,sensor_id,kind,value[,sigma][,target_id][,arrival_s]"
ROWS = EXPECTED.replace("expected", "expected at least one of")

ROW_FAULTS = {
    "0,A0,range,1,": f"line 3: found 5 cells, expected 6: {HEADER}",
    "0,A0,range,1,,tag,": f"line 3: found 7 cells, expected 6: {HEADER}",
    "0,A0,range,abc,,": "line 3: value: found 'abc', expected a finite number",
    "0,A0,range,1_0,,": "line 3: value: found '1_0', expected a finite number, not text",
    "0,A0,range,inf,,": "line 3: value: found 'inf', expected a finite number",
    "0,A0,range,1e999,,": "line 3: value: found '1e999', expected a finite number",
    "0,A0,range,NaN,,": "line 3: value: found 'NaN', expected a finite number",
    "0,A0,range,,,": "line 3: value: found nothing, expected a finite number",
    "nan,A0,range,1,,": "line 3: t_s: found 'nan', expected a finite number",
    "x,A0,range,1,,": "line 3: t_s: found 'x', expected a finite number",
    "0,A0,range,-0.5,,": "line 3: value: found '-0.5', expected a range of 0 or more",
    "0,A0,range,1,-2,": "line 3: sigma: found '-2', expected a number above 0 or nothing",
    "0,A0,range,1,0,": "line 3: sigma: found '0', expected a number above 0 or nothing",
    "0,A0,range,1,inf,": "line 3: sigma: found 'inf', expected a number above 0 or nothing",
    "0,A0,range,1,big,": "line 3: sigma: found 'big', expected a number above 0 or nothing",
    "0,A0,rang,1,,": "line 3: kind: found 'rang', expected a kind of reading; "
    "nearest valid one: range; valid ones: range, signal, detection, bearing, angular_rate, "
    "motion, rssi, amplitude, energy_message",
    "0,A0,detection,0.5,,": "line 3: value: found '0.5', expected 0 or 1",
    "0,A0,detection,-1,,": "line 3: value: found '-1', expected 0 or 1",
    "0,A0,bearing,45,,": "line 3: value: found '45', expected an angle in radians, -2 pi to 2 pi",
    "0,A0,bearing,-6.3,,": "line 3: value: found '-6.3', "
    "expected an angle in radians, -2 pi to 2 pi",
    "0,A0,signal,inf,,": "line 3: value: found 'inf', expected a finite number",
    "0,A0,,1,,": "line 3: kind: found nothing, expected a name",
    "0,,range,1,,": "line 3: sensor_id: found nothing, expected a name",
    "0,A9,range,1,,": "line 3: sensor_id: found 'A9', expected a sensor of the site; "
    "nearest valid one: A1; valid ones: A0, A1",
    "0,A0,range,1,,\a": r"line 3: target_id: found '\x07', expected a name",
    '0,"A0,range,1,,': "line 3: found a cell that cannot be read (unexpected end of data), "
    "expected comma-separated values",
    '0,"A\n0",range,1,,': "line 3: found a line feed in a quoted cell, expected one row a line",
    # Neither do cells too many make up for cells too few, nor two halves of a quoted cell for two.
    "0,A0,range,1,\n0,A0,range,1,,,": f"line 3: found 5 cells, expected 6: {HEADER}",
    '0,A0,range,1,,"a\n0",A0,range,1,,b': "line 3: found a line feed in a quoted cell, "
    "expected one row a line",
    # The first fault is told, by row and not by column.
    "0,A0,range,1,-1,\nx,A0,range,1,,": "line 3: sigma: found '-1', "
    "expected a number above 0 or nothing",
    f"{GOOD}\n\n{GOOD}\n\n0,A0,range,-1,,": "line 7: value: found '-1', "
    "expected a range of 0 or more",
    f'{GOOD}\n0,"A0",range,-1,,\n0,A0': "line 4: value: found '-1', expected a range of 0 or more",
}

FILE_FAULTS = {
    b"": f": found an empty file, {EXPECTED}",
    HEADER.encode(): f": found no rows, {ROWS}",
    f"{HEADER}\n\n\n".encode(): f": found no rows, {ROWS}",
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR": ", line 1: found binary data, expected text in UTF-8",
    HEADER.encode("utf-16"): ", line 1: found binary data, expected text in UTF-8",
    f"{HEADER}\n{GOOD}\n".encode() + b"0,\xe4,range,1,,\n": (
        ", line 3: found binary data, expected text in UTF-8"
    ),
    f"{HEADER}\n{GOOD}\n".encode() + b"0,\0,range,1,,\xff\n": (
        ", line 3: found binary data, expected text in UTF-8"
    ),
    b"t_s;sensor_id;kind;value\n0;A0;range;1\n": (
        ", line 1: found 't_s;sensor_id;kind;value', expected commas between columns"
    ),
    b"t_s,sensor_id,kind\n0,A0,range\n": f", line 1: found no column 'value', {EXPECTED}",
    b"t_s,sensor_id,kind,valeu\n0,A0,range,1\n": (
        ", line 1: found an unknown column 'valeu' (nearest valid one: value), "
        f"found no column 'value', {EXPECTED}"
    ),
    b"t_s,sensor_id,kind,value,value\n": f", line 1: found column 'value' twice, {EXPECTED}",
}


def message(call, *arguments, **named) -> str:
    with pytest.raises(InputError) as caught:
        call(*arguments, **named)
    return str(caught.value)


@pytest.mark.parametrize("row", ROW_FAULTS)
def test_a_faulty_row_of_csv(tmp_path, row):
    path = tmp_path / "measurements.csv"
    path.write_text(f"{HEADER}\n{GOOD}\n{row}\n")
    assert message(read_readings, path, sensor_ids=("A0", "A1")) == f"{path}, {ROW_FAULTS[row]}"


@pytest.mark.parametrize("content", FILE_FAULTS)
def test_a_faulty_file_of_csv(tmp_path, content):
    path = tmp_path / "measurements.csv"
    path.write_bytes(content)
    assert message(read_readings, path) == f"{path}{FILE_FAULTS[content]}"


@pytest.mark.parametrize("block", [70, 1000])
def test_lines_are_counted_over_blocks(tmp_path, monkeypatch, block):
    path = tmp_path / "measurements.csv"
    path.write_text(f"{HEADER}\n" + f"{GOOD}\n" * 100 + "0,A0,range,-1,,\n" + f"{GOOD}\n" * 100)
    monkeypatch.setattr(lines, "BLOCK_BYTES", block)
    assert ", line 102: value: found '-1'" in message(read_readings, path)


def test_a_line_without_end(tmp_path):
    path = tmp_path / "measurements.csv"
    path.write_bytes(b"a" * 3_000_000)
    assert message(read_readings, path) == (
        f"{path}: found a line of over 1048576 bytes, expected short ones"
    )


GOOD_JSON = {"t_s": 0, "sensor_id": "A0", "kind": "range", "value": 1}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("[1]", "found '[1]', expected a JSON object"),
        ('{"t_s": 0', "found '{\"t_s\": 0', expected a JSON object"),
        ("[" * 10_000, f"found '{'[' * 60}', expected a JSON object"),
        ({"value": "1"}, "value: found '1', expected a finite number, not text"),
        ({"value": True}, "value: found 'True', expected a finite number"),
        ({"value": None}, "value: found nothing, expected a finite number"),
        ({"value": -1}, "value: found '-1', expected a range of 0 or more"),
        ({"value": 10**400}, f"value: found '{'1' + '0' * 59}', expected a finite number"),
        ({"sensor_id": ["A0"]}, "sensor_id: found \"['A0']\", expected a name"),
        ({"sensor_id": True}, "sensor_id: found 'True', expected a name"),
        (
            {"sigm": 1},
            f"found an unknown column 'sigm' (nearest valid one: sigma), {EXPECTED}",
        ),
    ],
)
def test_a_faulty_line_of_json(tmp_path, line, said):
    path = tmp_path / "measurements.ndjson"
    text = line if isinstance(line, str) else json.dumps(GOOD_JSON | line)
    path.write_text(f"{json.dumps(GOOD_JSON)}\n\n{text}\n")
    assert message(read_readings, path) == f"{path}, line 3: {said}"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"value": [1, "2"]},
            ", row index 1: value: found '2', expected a finite number, not text",
        ),
        ({"value": [1, -2]}, ", row index 1: value: found '-2', expected a range of 0 or more"),
        ({"value": [1, np.nan]}, ", row index 1: value: found 'nan', expected a finite number"),
        ({"value": [True, False]}, ", row index 0: value: found 'True', expected a finite number"),
        (
            {"t_s": np.array([datetime(2024, 1, 1)] * 2, "M8[ns]")},  # noqa: DTZ001  no zone meant
            ", row index 0: t_s: found '2024-01-01T00:00:00.000000000', expected a finite number",
        ),
        (
            {"sensor_id": np.array(["2024-01-01"] * 2, "M8[s]")},
            ", row index 0: sensor_id: found '2024-01-01T00:00:00', expected a name",
        ),
        ({"sensor_id": ["A", 0.5]}, ", row index 1: sensor_id: found '0.5', expected a name"),
        (
            {"value": [1]},
            ": value: found shape (1,), expected one number of rows everywhere, "
            "as in t_s with shape (2,)",
        ),
        (
            {"t_s": 0},
            ": t_s: found shape (), expected one number of rows everywhere, "
            "as in t_s with shape ()",
        ),
        (
            {"valu": [1, 2]},
            f": found an unknown column 'valu' (nearest valid one: value), {EXPECTED}",
        ),
    ],
)
def test_faulty_columns(change, said):
    good = {"t_s": [0, 1], "sensor_id": ["A", "B"], "kind": ["range"] * 2, "value": [1, 2]}
    assert message(readings_from_columns, good | change) == f"readings{said}"


def test_columns_that_are_none_or_empty():
    assert message(readings_from_columns, 5) == (
        f"readings: found int, expected a mapping of columns: {EXPECTED.split(' ')[1]}"
    )
    empty = {"t_s": [], "sensor_id": [], "kind": [], "value": []}
    assert message(readings_from_columns, empty) == f"readings: found no rows, {ROWS}"


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
@pytest.mark.parametrize("read", [read_readings, read_truth, read_tracks])
def test_a_file_that_cannot_be_opened(tmp_path, suffix, read):
    path = tmp_path / f"none.{suffix}"
    assert message(read, path) == f"{path}: cannot be read: No such file or directory"
    path.mkdir()
    assert message(read, path) == f"{path}: cannot be read: Is a directory"


@pytest.mark.parametrize(("name", "found"), [("a.xls", "suffix '.xls'"), ("a", "no suffix")])
def test_a_file_of_unknown_kind(tmp_path, name, found):
    path = tmp_path / name
    kinds = ".csv, .ndjson, .jsonl, .parquet"
    assert message(read_readings, path) == f"{path}: found {found}, expected one of {kinds}"
    assert message(read_tracks, path) == f"{path}: found {found}, expected one of {kinds}, .geojson"


def test_a_file_that_is_not_parquet(tmp_path):
    path = tmp_path / "measurements.parquet"
    path.write_bytes(b"something else, but long enough")
    assert re.match(
        rf"{re.escape(str(path))}: .*, expected a Parquet file", message(read_readings, path)
    )


def test_parquet_without_pyarrow(tmp_path, monkeypatch):
    def import_module(name):
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return builtins.__import__(name)

    monkeypatch.setattr(importlib, "import_module", import_module)
    path = tmp_path / "file.parquet"
    said = f'{path}: Parquet needs pyarrow, found none: pip install "trackfield[data]"'
    assert message(read_readings, path) == said
    assert message(write_tracks, path, None) == said
    assert not list(tmp_path.iterdir())


TRUTH = "t_s,target_id,x_m,y_m,z_m\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", ": found an empty file, expected t_s,target_id,x_m,y_m[,z_m]"),
        (TRUTH, ": found no rows, expected at least one of t_s,target_id,x_m,y_m[,z_m]"),
        (f"{TRUTH}0,,1,2,\n", ", line 2: target_id: found nothing, expected a name"),
        (f"{TRUTH}0,a,1,,\n", ", line 2: y_m: found nothing, expected a finite number"),
        (f"{TRUTH}0,a,1,2,up\n", ", line 2: z_m: found 'up', expected a finite number or nothing"),
        (
            f"{TRUTH}0,a,1,2,inf\n",
            ", line 2: z_m: found 'inf', expected a finite number or nothing",
        ),
    ],
)
def test_faulty_truth(tmp_path, content, said):
    path = tmp_path / "truth.csv"
    path.write_text(content)
    assert message(read_truth, path) == f"{path}{said}"


TRACKS = "t_s,track_id,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,cov_xx,cov_xy,cov_yy,status\n"


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("0,1.5,0,0,,0,0,,1,0,1,ended", "track_id: found '1.5', expected a whole number from 0 to"),
        ("0,-1,0,0,,0,0,,1,0,1,ended", "track_id: found '-1', expected a whole number from 0 to"),
        ("0,3e9,0,0,,0,0,,1,0,1,ended", "track_id: found '3e9', expected a whole number from 0 to"),
        ("0,1,0,0,,0,,,1,0,1,ended", "vy_m_s: found nothing, expected a finite number"),
        ("0,1,0,0,,0,0,,-1,0,1,ended", "cov_xx: found '-1', expected a finite number, 0 or more"),
        (
            "0,1,0,0,,0,0,,1,0,1,endd",
            "status: found 'endd', expected a status; nearest valid one: ended; valid ones: "
            "tentative, confirmed, coasting, ended",
        ),
    ],
)
def test_faulty_tracks(tmp_path, row, said):
    path = tmp_path / "tracks.csv"
    path.write_text(f"{TRACKS}{row}\n")
    assert message(read_tracks, path).startswith(f"{path}, line 2: {said}")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"features": }', ", line 1: Expecting value, expected a GeoJSON object"),
        ("[]", ": found no list of features, expected a FeatureCollection"),
        ('{"features": 5}', ": found no list of features, expected a FeatureCollection"),
        ('{"features": [{}]}', ", feature index 0: found no properties, expected t_s,track_id"),
        (
            '{"features": [{"properties": {"t_s": 0}}]}',
            ", feature index 0: track_id: found nothing, expected a whole number",
        ),
    ],
)
def test_faulty_geojson(tmp_path, content, said):
    path = tmp_path / "tracks.geojson"
    path.write_text(content)
    assert message(read_tracks, path).startswith(f"{path}{said}")
