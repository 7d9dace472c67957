"""Readings from files: equal to a plain reader of the standard library, in bounded memory."""

from __future__ import annotations

import csv
import json
import math
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.io import decimals, lines
from trackfield.io.measurements import (
    read_readings,
    readings_from_columns,
    stream_readings,
    write_readings,
)
from trackfield.types import Readings

HEADER = "t_s,sensor_id,kind,value,sigma,target_id,arrival_s"

finite = st.floats(allow_nan=False, allow_infinity=False)
printable = st.characters(exclude_categories=["C", "Z"]) | st.sampled_from(" ,\"'\\")
names = st.text(printable, min_size=1, max_size=70).map(str.strip).filter(bool)
rows = st.lists(
    st.tuples(
        finite,
        names,
        st.floats(0, 1e300),
        st.none() | st.floats(1e-300, 1e300),
        st.none() | names,
        st.none() | finite,
    ),
    min_size=1,
    max_size=30,
)


def as_rows(readings: Readings) -> list[tuple[object, ...]]:
    """Rows with names and None, as a person would list them."""
    columns = readings.to_numpy()
    assert set(columns.pop("kind")) <= {"range"}
    return [
        tuple(None if isinstance(c, float) and math.isnan(c) else c for c in row)
        for row in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def from_rows(listed: list[tuple[object, ...]]) -> Readings:
    t_s, sensor, value, sigma, target, arrival = zip(*listed, strict=True)
    return readings_from_columns(
        {
            "t_s": t_s,
            "sensor_id": sensor,
            "kind": ["range"] * len(t_s),
            "value": value,
            "sigma": sigma,
            "target_id": target,
            "arrival_s": arrival,
        }
    )


def assert_same(left: Readings, right: Readings) -> None:
    for name, column in left.to_numpy().items():
        np.testing.assert_array_equal(column, right.to_numpy()[name], err_msg=name)


@given(listed=rows)
def test_columns_keep_every_value(listed):
    assert as_rows(from_rows(listed)) == listed


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
@settings(max_examples=40)
@given(listed=rows)
def test_what_is_written_is_read_exactly(tmp_path_factory, suffix, listed):
    path = tmp_path_factory.getbasetemp() / f"round.{suffix}"
    write_readings(path, from_rows(listed))
    assert as_rows(read_readings(path)) == listed


@pytest.mark.parametrize("suffix", ["CSV", "jsonl"])
def test_a_suffix_may_be_written_otherwise(tmp_path, suffix):
    path = tmp_path / f"file.{suffix}"
    listed = [(0.0, "A", 1.5, None, None, None)]
    write_readings(path, from_rows(listed))
    assert as_rows(read_readings(path)) == listed


numerals = st.one_of(
    finite.map(repr),
    st.from_regex(r"-?[0-9]{0,25}(\.[0-9]{0,25})?", fullmatch=True),
    st.from_regex(r" ?[+-]?[0-9]{1,3}\.?[0-9]{0,20}([eE][+-]?[0-9]{1,2})? ?", fullmatch=True),
    st.from_regex(r"[0-9]{14,18}\.[0-9]{1,4}", fullmatch=True),
    st.sampled_from(["", " ", "-", ".", "-.", "nan", "-inf", "1_0", "1e", "1..2", "0x1", "--1"]),
)


def plain_number(text: str) -> float | None:
    """Say what a cell means, as the standard library has it."""
    try:
        return math.nan if not text.strip() else None if "_" in text else float(text)
    except ValueError:
        return None


@given(texts=st.lists(numerals, min_size=1, max_size=40))
def test_numbers_are_those_of_float_to_the_bit(texts):
    joined = ",".join(texts).encode()
    buffer = np.frombuffer(joined + bytes(decimals.PADDING), np.uint8)
    ends = np.cumsum([len(text) + 1 for text in texts]) - 1
    starts = ends - [len(text) for text in texts]
    values, wrong = decimals.parse_numbers(buffer, starts, ends)

    expected = [plain_number(text) for text in texts]
    assert wrong == (expected.index(None) if None in expected else None)
    if wrong is None:
        bits = np.array(expected).view(np.int64)
        number = ~np.isnan(values)
        assert (values.view(np.int64)[number] == bits[number]).all()
        assert (np.isnan(values) == np.isnan(np.array(expected))).all()


@pytest.mark.parametrize("keys", ["mixed", "all alike"])
@given(texts=st.lists(st.text(max_size=40) | st.sampled_from("AB"), min_size=1, max_size=40))
def test_distinct_cells_are_those_of_a_dictionary(keys, texts):
    cells = [text.replace("\0", "").encode() for text in texts]
    buffer = np.frombuffer(b"".join(cells) + bytes(decimals.PADDING), np.uint8)
    ends = np.cumsum([len(cell) for cell in cells])
    starts = ends - [len(cell) for cell in cells]
    with pytest.MonkeyPatch.context() as patch:
        if keys == "all alike":  # as if all names had the same key
            patch.setattr(decimals, "_MIXERS", np.zeros_like(decimals._MIXERS))
        first, which = decimals.distinct(buffer, starts, ends)

    table = list(dict.fromkeys(cells))
    assert [cells[row] for row in first] == table
    assert [table[place] for place in which] == cells


def plain_rows(text: str) -> list[tuple[object, ...]]:
    """Read a file row by row with the standard library."""
    header, *listed = [row for row in csv.reader(text.splitlines()) if row]
    header = [name.strip() for name in header]

    def cell(name: str, row: list[str]) -> object:
        value = row[header.index(name)].strip() if name in header else ""
        return value or None if name.endswith("_id") else float(value) if value else None

    wanted = ("t_s", "sensor_id", "value", "sigma", "target_id", "arrival_s")
    return [tuple(cell(name, row) for name in wanted) for row in listed]


@pytest.mark.parametrize(
    "text",
    [
        "t_s,sensor_id,kind,value\n0,A,range,1\n1,B,range,2.5\n",
        "t_s,sensor_id,kind,value\n0,A,range,1\n1,B,range,2.5",  # no line feed at the end
        "t_s,sensor_id,kind,value\r\n0,A,range,1\r\n1,B,range,2.5\r\n",
        "value,kind,target_id,sensor_id,t_s\n3,range,,A,0\n4,range,tag,A,1\n",
        "t_s,sensor_id,kind,value\n\n0,A,range,1\n\n\n1,B,range,2.5\n\n",
        ' t_s , sensor_id,kind ,value\n 0 , A,range , 1 \n1,"B",range,2.5\n',
        '"t_s","sensor_id","kind","value"\n0,"A","range",1\n1,"A","range","2.5"\n',
        't_s,sensor_id,kind,value\n0,"A, left",range,1\n1,"the ""B""",range,2.5\n',
        't_s,sensor_id,kind,value\n0,5" pipe,range,1\n',
        "t_s,sensor_id,kind,value,sigma,arrival_s\n0,Ä,range,1,,\n1,名前,range,2.5,.1,1e-3\n",
    ],
)
def test_csv_is_read_as_by_the_standard_library(tmp_path, text):
    path = tmp_path / "measurements.csv"
    path.write_bytes(text.encode())
    expected = plain_rows(text)
    assert as_rows(read_readings(path)) == expected
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())  # as Excel marks UTF-8
    assert as_rows(read_readings(path)) == expected


def test_json_may_leave_out_what_is_empty_and_number_its_sensors(tmp_path):
    path = tmp_path / "measurements.ndjson"
    first = {"t_s": 1, "sensor_id": 7, "kind": "range", "value": 2}
    second = {**first, "sigma": None, "target_id": "tag", "arrival_s": 1.5}
    path.write_text(f"{json.dumps(first)}\n\n{json.dumps(second)}")
    assert as_rows(read_readings(path)) == [
        (1.0, "7", 2.0, None, None, None),
        (1.0, "7", 2.0, None, "tag", 1.5),
    ]


def long_text(count: int, *, quote: str = "") -> str:
    q = quote
    body = (
        f"{i * 0.01:.4f},{q}anchor {i % 5}{q},range,{i % 7}.25,,{q}tag{i // 9}{q},\n"
        for i in range(count)
    )
    return f"{HEADER}\n{''.join(body)}"


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("block", [64, 100, 1000, 1 << 20])
def test_blocks_do_not_show(tmp_path, monkeypatch, block, quote):
    path = tmp_path / "measurements.csv"
    path.write_text(long_text(200, quote=quote))
    monkeypatch.setattr(lines, "BLOCK_BYTES", block)
    assert as_rows(read_readings(path)) == plain_rows(long_text(200))


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
def test_chunks_share_their_names(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"measurements.{suffix}"
    (tmp_path / "all.csv").write_text(long_text(300))
    whole = read_readings(tmp_path / "all.csv")
    write_readings(path, whole)
    monkeypatch.setattr(lines, "BLOCK_BYTES", 500)
    monkeypatch.setattr("trackfield.io.arrow._BATCH_ROWS", 20)
    told: list[float] = []
    chunks = list(stream_readings(path, progress=told.append))

    assert len(chunks) > 10
    for chunk, later in pairwise(chunks):
        assert later.target_ids[: len(chunk.target_ids)] == chunk.target_ids
        assert later.sensor_ids[: len(chunk.sensor_ids)] == chunk.sensor_ids
    assert chunks[-1].target_ids == whole.target_ids
    np.testing.assert_array_equal(np.concatenate([c.target for c in chunks]), whole.target)
    np.testing.assert_array_equal(np.concatenate([c.t_s for c in chunks]), whole.t_s)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_sensors_are_numbered_as_in_the_site(tmp_path):
    path = tmp_path / "measurements.csv"
    path.write_text("t_s,sensor_id,kind,value\n0,B,range,1\n0,A,range,2\n")
    readings = read_readings(path, sensor_ids=("A", "B", "C"))
    assert readings.sensor_ids == ("A", "B", "C")
    assert readings.sensor.tolist() == [1, 0]


def test_doubled_and_late_readings_are_left_as_they_are(tmp_path):
    path = tmp_path / "measurements.csv"
    path.write_text("t_s,sensor_id,kind,value\n5,A,range,1\n5,A,range,1\n2,A,range,2\n")
    assert read_readings(path).t_s.tolist() == [5, 5, 2]


def peak_bytes(path: Path) -> tuple[int, int]:
    """Rows of a file, and the most memory that streaming it took at once."""
    tracemalloc.start()
    try:
        count = sum(len(chunk) for chunk in stream_readings(path))
        return count, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_the_file(tmp_path):
    block = long_text(10_000).removeprefix(f"{HEADER}\n").encode()
    small, large = tmp_path / "small.csv", tmp_path / "large.csv"
    for path, times in ((small, 10), (large, 150)):
        with path.open("wb") as file:
            file.write(f"{HEADER}\n".encode())
            for _ in range(times):
                file.write(block)

    few, little = peak_bytes(small)
    many, peak = peak_bytes(large)
    large.unlink()
    assert (few, many) == (100_000, 1_500_000)
    assert peak < 1.1 * little
    assert peak < 25e6  # a tenth of the rows as Python objects would be more
