"""Tracks and truth to files and back, complete or not at all."""

from __future__ import annotations

import csv
import json
import os
import stat
import threading
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.io.cells import fixed_cells, packed
from trackfield.io.geodesy import to_geographic
from trackfield.io.measurements import write_readings
from trackfield.io.tracks import join_tracks, open_tracks, read_tracks, write_tracks
from trackfield.io.truth import read_truth, write_truth
from trackfield.network.site import Origin
from trackfield.types import Readings, Tracks, Truth

ORIGIN = Origin(lat=48.1, lon=11.6, alt=520.0, rotation_deg=30.0)
SUFFIXES = ["csv", "ndjson", "parquet", "geojson"]
TARGETS = ("tag", 'a "b"', "c, d", "Ünïcode", "\\")


def make(count: int, *, dimensions: int = 2, seed: int = 0) -> Tracks:
    rng = np.random.default_rng(seed)
    position, velocity = rng.normal(0, 100, (2, count, 3))
    if dimensions == 2:
        position[:, 2] = velocity[:, 2] = np.nan
    return Tracks(
        t_s=1.7e9 + np.arange(count) * 0.1,
        track=rng.integers(0, 2**31 - 1, count, dtype=np.int32),
        position=position,
        velocity=velocity,
        covariance=rng.normal(0, 1, (count, 3)) ** 2,
        status=rng.integers(0, 4, count, dtype=np.int32),
        target=rng.integers(-1, len(TARGETS), count, dtype=np.int32),
        nis=np.full(count, np.nan),
        target_ids=TARGETS,
    )


def assert_same(left: Tracks, right: Tracks, *, digits: float = 5.001e-7) -> None:
    assert len(left) == len(right)
    for name, column in left.to_numpy().items():
        other = right.to_numpy()[name]
        assert column.dtype == other.dtype
        if column.dtype.kind == "f":
            np.testing.assert_allclose(column, other, rtol=0, atol=digits, err_msg=name)
        else:
            assert column.tolist() == other.tolist()


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("count", [1, 8192, 10_000])  # 8192: whole chunks, nothing left over
def test_tracks_come_back_to_a_millionth(tmp_path, suffix, dimensions, count):
    tracks = make(count, dimensions=dimensions)
    path = tmp_path / f"tracks.{suffix}"
    write_tracks(path, tracks, origin=ORIGIN)
    assert_same(read_tracks(path), tracks)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_tracker_that_showed_nothing(tmp_path, suffix):
    path = tmp_path / f"tracks.{suffix}"
    with open_tracks(path, origin=ORIGIN):
        pass
    assert len(read_tracks(path)) == 0
    if suffix == "geojson":
        assert json.loads(path.read_text()) == {"type": "FeatureCollection", "features": []}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_rows_may_come_in_any_pieces(tmp_path, suffix):
    whole = make(9000)
    pieces, at = [], 0
    for length in (1, 0, 1, 5000, 30, 3000, 968):
        rows = slice(at, at := at + length)
        columns = {
            field.name: getattr(whole, field.name)[rows]
            for field in fields(whole)
            if field.name != "target_ids"
        }
        pieces.append(replace(whole, **columns))
    with open_tracks(tmp_path / f"pieces.{suffix}", origin=ORIGIN) as append:
        for piece in pieces:
            append(piece)
    write_tracks(tmp_path / f"whole.{suffix}", whole, origin=ORIGIN)
    assert_same(read_tracks(tmp_path / f"pieces.{suffix}"), whole)
    if suffix != "parquet":  # where the pieces are row groups
        files = [tmp_path / f"{name}.{suffix}" for name in ("pieces", "whole")]
        assert files[0].read_bytes() == files[1].read_bytes()


def test_csv_has_the_columns_and_words_of_the_contract(tmp_path):
    tracks = replace(
        make(2),
        t_s=np.array([0.25, 1.5]),
        track=np.array([3, 4], np.int32),
        position=np.array([[1.0, -2.5, np.nan], [0.0, -1e-9, 3.0]]),
        velocity=np.array([[0.1, 0.2, np.nan], [0.3, 12345.678901, 0.5]]),
        covariance=np.array([[0.01, -0.001, 0.04], [1e-9, 0.0, 1234.5]]),
        status=np.array([0, 2], np.int32),
        target=np.array([2, -1], np.int32),
    )
    path = tmp_path / "tracks.csv"
    write_tracks(path, tracks)
    assert path.read_text() == (
        "t_s,track_id,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,cov_xx,cov_xy,cov_yy,status,target_id\n"
        "0.250000,3,1.000000,-2.500000,,0.100000,0.200000,,0.010000000,-0.001000000,0.040000000,"
        'tentative,"c, d"\n'
        "1.500000,4,0.000000,0.000000,3.000000,0.300000,12345.678901,0.500000,0.000000001,"
        "0.000000000,1234.500000000,coasting,\n"
    )


def test_target_id_may_be_absent(tmp_path):
    path = tmp_path / "tracks.csv"
    write_tracks(path, make(50))
    with path.open() as file:
        rows = [row[:-1] for row in csv.reader(file)]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    assert set(read_tracks(path).target.tolist()) == {-1}


@pytest.mark.parametrize("dimensions", [2, 3])
def test_geojson_says_where_on_earth_each_row_is(tmp_path, dimensions):
    tracks = make(20, dimensions=dimensions)
    path = tmp_path / "tracks.geojson"
    write_tracks(path, tracks, origin=ORIGIN)
    document = json.loads(path.read_text())
    assert document["type"] == "FeatureCollection"
    for feature, place, row in zip(
        document["features"],
        to_geographic(tracks.position, ORIGIN),
        tracks.to_numpy()["target_id"],
        strict=True,
    ):
        assert feature["type"] == "Feature"
        assert feature["geometry"]["type"] == "Point"
        found = feature["geometry"]["coordinates"]
        assert len(found) == dimensions
        np.testing.assert_allclose(found[:2], place[:2], rtol=0, atol=5.1e-10)
        assert dimensions == 2 or abs(found[2] - place[2]) <= 5.1e-4
        assert feature["properties"]["target_id"] == row


@pytest.mark.parametrize("decimals", [3, 6, 9])
@given(values=st.lists(st.floats(-1e15, 1e15) | st.just(np.nan), min_size=1, max_size=20))
def test_numbers_are_written_to_the_nearest(decimals, values):
    cells = fixed_cells(np.array(values), decimals, blank=b"null")
    texts = packed([cells, b"\n"], len(values)).decode().splitlines()
    for value, text in zip(values, texts, strict=True):
        if np.isnan(value):
            assert text == "null"
        else:
            sign, whole, part = text.partition(".")[0][:1], *text.lstrip("-").split(".")
            assert len(part) == decimals
            assert whole == str(int(whole))
            assert abs(float(text) - value) <= 0.5001 * 10.0**-decimals + abs(value) * 2.3e-16
            assert (sign == "-") <= (value < 0)


def test_names_are_joined_by_what_they_say():
    left, right = make(40, seed=1), replace(make(30, seed=2), target_ids=TARGETS[::-1])
    joined = join_tracks([left, right])
    both = [*left.to_numpy()["target_id"], *right.to_numpy()["target_id"]]
    assert joined.to_numpy()["target_id"].tolist() == both
    assert len(set(joined.target_ids)) == len(joined.target_ids)


positions = st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e3, 1e3))


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
@settings(max_examples=40)
@given(listed=st.lists(positions, min_size=1, max_size=20), flat=st.booleans())
def test_truth_comes_back_exactly(tmp_path_factory, suffix, listed, flat):
    position = np.array(listed)
    if flat:
        position[::2, 2] = np.nan
    truth = Truth(
        t_s=position[:, 0] / 3,
        target=np.arange(len(listed), dtype=np.int32) % 2,
        position=position,
        target_ids=("a", "b")[: len(listed)],
    )
    path = tmp_path_factory.getbasetemp() / f"truth.{suffix}"
    write_truth(path, truth)
    found = read_truth(path)
    for name, column in truth.to_numpy().items():
        np.testing.assert_array_equal(found.to_numpy()[name], column)


# Files that are complete or not there


def fail(path, error):
    with open_tracks(path, origin=ORIGIN) as append:
        append(make(10_000))
        assert not path.exists() or path.read_text() == "before"
        assert len(list(path.parent.glob(".trackfield-*.tmp"))) == 1
        raise error


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("x"), OSError(5, "own")])
@pytest.mark.parametrize("before", [None, "before"])
def test_a_run_that_is_cut_short_leaves_nothing(tmp_path, suffix, error, before):
    path = tmp_path / f"tracks.{suffix}"
    if before:
        path.write_text(before)
    with pytest.raises(type(error)) as caught:
        fail(path, error)
    assert caught.value is error
    assert [entry.read_text() for entry in tmp_path.iterdir()] == ([before] if before else [])


def test_an_old_file_is_replaced_and_a_link_stays_one(tmp_path):
    path, link = tmp_path / "tracks.csv", tmp_path / "link.csv"
    path.write_text("before")
    link.symlink_to(path)
    write_tracks(link, make(3))
    assert link.is_symlink()
    assert len(read_tracks(path)) == 3
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_a_pipe_is_written_directly(tmp_path):
    path = tmp_path / "tracks.csv"
    os.mkfifo(path)
    texts = []
    reader = threading.Thread(target=lambda: texts.append(path.read_text()))
    reader.start()
    write_tracks(path, make(3))
    reader.join()
    assert len(texts[0].splitlines()) == 4
    assert path.is_fifo()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_place_that_cannot_be_written_is_told_before_the_work(tmp_path, suffix):
    cases = {
        tmp_path
        / "none"
        / f"a.{suffix}": f"cannot be written: found no folder {tmp_path / 'none'}",
        tmp_path / f"folder.{suffix}": "cannot be written: found a folder, expected a file",
        tmp_path / "file" / f"a.{suffix}": "cannot be written: Not a directory",
        tmp_path / f"{'a' * 300}.{suffix}": "cannot be written: File name too long",
    }
    (tmp_path / f"folder.{suffix}").mkdir()
    (tmp_path / "file").touch()
    for path, said in cases.items():
        started = False
        with pytest.raises(InputError) as caught, open_tracks(path, origin=ORIGIN):
            started = True
        assert str(caught.value) == f"{path}: {said}"
        assert not started


def test_a_file_that_may_not_be_written_is_kept(tmp_path, monkeypatch):
    path = tmp_path / "tracks.csv"
    path.write_text("before")
    plain = Path.open

    def refusing(self, mode="r", **named):  # a mode of 0444 does not stop root
        if self == path and mode != "r":
            raise PermissionError(13, "Permission denied")
        return plain(self, mode, **named)

    monkeypatch.setattr(Path, "open", refusing)
    with pytest.raises(InputError) as caught:
        write_tracks(path, make(1))
    assert str(caught.value) == f"{path}: cannot be written: Permission denied"
    assert [entry.read_text() for entry in tmp_path.iterdir()] == ["before"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_full_disk_is_told(tmp_path, suffix):
    path = tmp_path / f"tracks.{suffix}"
    path.symlink_to("/dev/full")
    with pytest.raises(InputError) as caught:
        write_tracks(path, make(20_000), origin=ORIGIN)
    assert str(caught.value).startswith(f"{path}: cannot be written: ")
    assert "No space left" in str(caught.value)


def test_geojson_needs_an_origin(tmp_path):
    path = tmp_path / "tracks.geojson"
    with pytest.raises(InputError) as caught, open_tracks(path):
        pass
    assert str(caught.value) == (
        f"{path}: found a site without origin, "
        "expected [site] origin = {lat, lon} to write GeoJSON"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_number_that_is_not_finite_is_never_written(tmp_path, suffix):
    tracks = make(3)
    tracks.position[1, 0] = np.nan
    path = tmp_path / f"tracks.{suffix}"
    with pytest.raises(InputError, match=rf"found a number .* of track {tracks.track[1]} at 17000"):
        write_tracks(path, tracks, origin=ORIGIN)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", " a", "a\n", "\ud800"])
def test_a_name_that_no_reader_takes_is_never_written(tmp_path, name):
    tracks = replace(make(1), target=np.zeros(1, np.int32), target_ids=(name,))
    with pytest.raises(InputError, match="found the name"):
        write_tracks(tmp_path / "tracks.csv", tracks)
    assert not list(tmp_path.iterdir())


def test_an_infinite_reading_is_never_written(tmp_path):
    none, place = np.full(1, np.nan), np.zeros(1, np.int32)
    readings = Readings(
        none, place, none + np.inf, place, place, none, none, ("A",), ("t",), ("r",)
    )
    with pytest.raises(InputError, match="found an infinite number"):
        write_readings(tmp_path / "a.csv", replace(readings, value=np.array([np.inf])))
    assert not list(tmp_path.iterdir())
