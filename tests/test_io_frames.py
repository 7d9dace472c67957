"""Tables to and from NumPy, pandas and Arrow."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from trackfield.io.measurements import read_readings, readings_from_columns
from trackfield.types import Commands, Mode, Readings, Status, Tracks, Truth

pandas = pytest.importorskip("pandas")
arrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

NAN = float("nan")
READINGS = Readings(
    t_s=np.array([0.0, 1.0, 2.0]),
    sensor=np.array([1, 0, 1], np.int32),
    value=np.array([1.5, 2.5, 3.5]),
    target=np.array([0, -1, 1], np.int32),
    kind=np.zeros(3, np.int32),
    sigma=np.array([0.1, NAN, 0.2]),
    arrival_s=np.full(3, NAN),
    sensor_ids=("A", "B"),
    target_ids=("tag", "other"),
    kinds=("range",),
)


def assert_same(left: Readings, right: Readings) -> None:
    for name, column in left.to_numpy().items():
        np.testing.assert_array_equal(column, right.to_numpy()[name], err_msg=name)


@pytest.mark.parametrize("form", ["to_numpy", "to_pandas", "to_arrow"])
def test_readings_come_back_from_every_form(form):
    assert_same(readings_from_columns(getattr(READINGS, form)()), READINGS)


@pytest.mark.parametrize(
    "dtypes",
    [
        {"target_id": "str", "sensor_id": object},
        {"target_id": "string", "sigma": "Float64", "arrival_s": "Float64"},
        {"target_id": "category", "value": "float32", "t_s": "int64"},
        {"t_s": "Int64", "sigma": object, "value": object},
    ],
)
def test_pandas_has_many_ways_to_say_nothing(dtypes):
    frame = READINGS.to_pandas().astype(object).astype(dtypes)
    assert_same(readings_from_columns(frame), READINGS)


def test_arrow_has_many_types(tmp_path):
    table = READINGS.to_arrow()
    plain = table.cast(
        arrow.schema(
            [
                ("t_s", arrow.int64()),
                ("sensor_id", arrow.large_string()),
                ("kind", arrow.string()),
                ("value", arrow.float32()),
                ("sigma", arrow.float64()),
                ("target_id", arrow.string()),
                ("arrival_s", arrow.int32()),
            ]
        )
    )
    for given in (table, plain):
        assert_same(readings_from_columns(given), READINGS)
        parquet.write_table(given, tmp_path / "measurements.parquet")
        assert_same(read_readings(tmp_path / "measurements.parquet"), READINGS)


def test_frames_have_the_columns_of_files():
    frame = READINGS.to_pandas()
    assert frame["sensor_id"].tolist() == ["B", "A", "B"]
    assert frame["target_id"].isna().tolist() == [False, True, False]
    table = READINGS.to_arrow()
    assert table.column_names == list(frame.columns) == list(READINGS.columns())
    assert table["sigma"].to_pylist() == [0.1, None, 0.2]
    assert table["target_id"].to_pylist() == ["tag", None, "other"]

    truth = Truth(np.zeros(1), np.zeros(1, np.int32), np.array([[1.0, 2.0, NAN]]), ("a",))
    assert truth.to_arrow().to_pylist() == [
        {"t_s": 0.0, "target_id": "a", "x_m": 1.0, "y_m": 2.0, "z_m": None}
    ]
    assert truth.to_pandas().loc[0, "y_m"] == 2.0

    tracks = Tracks(
        t_s=np.zeros(1),
        track=np.array([4], np.int32),
        position=np.array([[1.0, 2.0, 3.0]]),
        velocity=np.array([[4.0, 5.0, 6.0]]),
        covariance=np.array([[7.0, 8.0, 9.0]]),
        status=np.array([Status.COASTING], np.int32),
        target=np.array([-1], np.int32),
        nis=np.array([0.5]),
        target_ids=(),
    )
    row = tracks.to_arrow().to_pylist()[0]
    assert list(row.values()) == [
        0.0, 4, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, "coasting", None, 0.5,
    ]  # fmt: skip
    assert tracks.to_pandas()["status"].tolist() == ["coasting"]
    assert tracks.to_numpy()["target_id"].tolist() == [None]


@pytest.mark.parametrize("form", ["to_pandas", "to_arrow"])
def test_without_the_extra_it_is_said_how_to_get_it(monkeypatch, form):
    def import_module(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", import_module)
    with pytest.raises(ImportError, match=r'is missing: pip install "trackfield\[data\]"'):
        getattr(READINGS, form)()


def test_commands_say_modes_in_words():
    commands = Commands(
        t_s=np.array([0.0, 0.5]),
        sensor=np.array([1, 0], np.int32),
        mode=np.array([Mode.SENSING, Mode.MASTER], np.int32),
        sensor_ids=("A", "B"),
    )
    assert len(commands) == 2
    assert commands.to_numpy()["mode"].tolist() == ["sensing", "master"]
    assert commands.to_pandas()["sensor_id"].tolist() == ["B", "A"]
    assert commands.to_arrow().column_names == ["t_s", "sensor_id", "mode"]
