"""Reports from files: every value comes back, and a fault is told with its place."""

from __future__ import annotations

import csv
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.io import lines
from trackfield.io.reports import (
    read_reports,
    reports_from_columns,
    stream_reports,
    write_reports,
)
from trackfield.types import Reports, join_rows

HEADER = "t_s,arrival_s,x_m,y_m,z_m,sigma_m,confidence"
NAMES = HEADER.split(",")
EXPECTED = "t_s,x_m,y_m[,arrival_s][,z_m][,sigma_m][,confidence]"

finite = st.floats(allow_nan=False, allow_infinity=False)
rows = st.lists(
    st.tuples(
        finite,
        st.none() | finite,
        finite,
        finite,
        st.none() | finite,
        st.none() | st.floats(1e-150, 1e150),
        st.none() | st.floats(0.0, 1.0),
    ),
    min_size=1,
    max_size=30,
)


def as_rows(reports: Reports) -> list[tuple[float | None, ...]]:
    columns = reports.to_numpy()
    return [
        tuple(None if math.isnan(cell) else cell for cell in row)
        for row in zip(*(columns[name].tolist() for name in NAMES), strict=True)
    ]


def from_rows(listed: list[tuple[float | None, ...]]) -> Reports:
    return reports_from_columns(dict(zip(NAMES, zip(*listed, strict=True), strict=True)))


@given(listed=rows)
def test_columns_keep_every_value(listed):
    assert as_rows(from_rows(listed)) == listed


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
@settings(max_examples=40)
@given(listed=rows)
def test_what_is_written_is_read_exactly(tmp_path_factory, suffix, listed):
    path = tmp_path_factory.getbasetemp() / f"reports.{suffix}"
    write_reports(path, from_rows(listed))
    assert as_rows(read_reports(path)) == listed


def test_a_file_says_what_a_plain_reader_finds(tmp_path):
    path = tmp_path / "reports.csv"
    text = "y_m,t_s,sigma_m,x_m\n2,0.5,0.4,1\n\n-3,1.5,,2.5\n"
    path.write_text(text)
    found = read_reports(path)
    header, *listed = [row for row in csv.reader(text.splitlines()) if row]
    plain = [dict(zip(header, row, strict=True)) for row in listed]
    for name, column in (("t_s", found.t_s), ("x_m", found.position[:, 0])):
        assert column.tolist() == [float(row[name]) for row in plain]
    assert found.position[:, 1].tolist() == [2.0, -3.0]
    assert np.isnan(found.position[:, 2]).all()
    assert np.isnan(found.arrival_s).all()
    assert np.isnan(found.confidence).all()
    np.testing.assert_array_equal(found.covariance, [[0.4**2, 0.0, 0.4**2], [np.nan] * 3])


def test_a_covariance_is_written_as_its_mean_sigma(tmp_path):
    one = from_rows([(0.0, None, 1.0, 2.0, None, 1.0, None)])
    wide = Reports(
        one.t_s, one.arrival_s, one.position, np.array([[0.25, 0.1, 0.75]]), one.confidence
    )
    write_reports(tmp_path / "r.csv", wide)
    np.testing.assert_allclose(read_reports(tmp_path / "r.csv").covariance, [[0.5, 0.0, 0.5]])


@pytest.mark.parametrize("block", [60, 400])
def test_chunks_say_what_the_whole_says(tmp_path, monkeypatch, block):
    listed = [(float(i), None, i / 7, -i / 3, None, 0.5, None) for i in range(200)]
    path = tmp_path / "reports.csv"
    write_reports(path, from_rows(listed))
    monkeypatch.setattr(lines, "BLOCK_BYTES", block)
    told: list[float] = []
    chunks = list(stream_reports(path, progress=told.append))
    assert len(chunks) > 3
    assert as_rows(join_rows(chunks)) == listed
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)


def test_memory_does_not_grow_with_the_file(tmp_path):
    path = tmp_path / "long.csv"
    with path.open("w") as file:
        file.write("t_s,x_m,y_m\n")
        file.writelines(f"{i}.25,{i % 97}.5,{i % 89}.125\n" for i in range(400_000))
    stream = stream_reports(path)
    next(stream)
    tracemalloc.start()
    assert sum(len(chunk) for chunk in stream) < 400_000
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert path.stat().st_size > 6e6
    assert peak < 40e6


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("x,,1,2,,,", "t_s: found 'x', expected a finite number"),
        ("0,inf,1,2,,,", "arrival_s: found 'inf', expected a finite number or nothing"),
        ("0,,,2,,,", "x_m: found nothing, expected a finite number"),
        ("0,,1,nan,,,", "y_m: found 'nan', expected a finite number"),
        ("0,,1,2,up,,", "z_m: found 'up', expected a finite number or nothing"),
        ("0,,1,2,,0,", "sigma_m: found '0', expected a number above 0 or nothing"),
        ("0,,1,2,,-1,", "sigma_m: found '-1', expected a number above 0 or nothing"),
        ("0,,1,2,,1e200,", "sigma_m: found '1e200', expected a number above 0 or nothing"),
        ("0,,1,2,,1e-200,", "sigma_m: found '1e-200', expected a number above 0 or nothing"),
        ("0,,1,2,,,1.5", "confidence: found '1.5', expected a probability from 0 to 1 or nothing"),
        ("0,,1,2,,,-0.1", "confidence: found '-0.1', expected a probability from 0 to 1 or"),
        ("0,,1,2", "found 4 cells, expected 7"),
    ],
)
def test_a_fault_is_told_with_file_line_and_column(tmp_path, row, said):
    path = tmp_path / "reports.csv"
    path.write_text(f"{HEADER}\n0,,1,2,,,\n{row}\n")
    with pytest.raises(InputError) as caught:
        read_reports(path)
    assert str(caught.value).startswith(f"{path}, line 3: {said}")


def test_columns_that_are_wrong_or_missing_are_told(tmp_path):
    path = tmp_path / "reports.csv"
    path.write_text("t_s,x_m,sigma\n0,1,1\n")
    with pytest.raises(InputError) as caught:
        read_reports(path)
    assert str(caught.value) == (
        f"{path}, line 1: found an unknown column 'sigma' (nearest valid one: sigma_m), "
        f"found no column 'y_m', expected {EXPECTED}"
    )
    path.write_text("t_s,x_m,y_m\n")
    with pytest.raises(InputError, match="found no rows, expected at least one of t_s,x_m,y_m"):
        read_reports(path)
    with pytest.raises(InputError, match="reports, row index 1: x_m: found nothing"):
        reports_from_columns({"t_s": [0, 1], "x_m": [0.5, None], "y_m": [1, 1]})
    with pytest.raises(InputError, match="reports: found no rows"):
        reports_from_columns({"t_s": [], "x_m": [], "y_m": []})
