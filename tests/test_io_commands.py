"""Commands to files and back, exactly; what nodes spent, as a plain reader finds it."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.io.commands import commands_from_columns, read_commands, write_commands
from trackfield.io.energy import COLUMNS, energy_columns, write_energy
from trackfield.network import meter
from trackfield.network.energy import Energy
from trackfield.types import MODE_WORDS, Commands, Mode

NAMES = ("n1", 'a "b"', "c, d", "Ünïcode")
finite = st.floats(allow_nan=False, allow_infinity=False)
rows = st.lists(st.tuples(finite, st.sampled_from(NAMES), st.sampled_from(MODE_WORDS)), max_size=9)


def as_rows(commands):
    return list(zip(*(column.tolist() for column in commands.to_numpy().values()), strict=True))


def table(listed):
    t = np.array([row[0] for row in listed], float)
    sensor = np.array([NAMES.index(row[1]) for row in listed], np.int32)
    mode = np.array([MODE_WORDS.index(row[2]) for row in listed], np.int32)
    return Commands(t, sensor, mode, NAMES)


@pytest.mark.parametrize("suffix", ["csv", "ndjson", "parquet"])
@given(listed=rows)
@settings(max_examples=30)
def test_what_is_written_is_read_exactly(tmp_path_factory, suffix, listed):
    path = tmp_path_factory.getbasetemp() / f"commands.{suffix}"
    write_commands(path, table(listed))
    found = read_commands(path)
    assert as_rows(found) == listed
    assert set(found.sensor_ids) == {row[1] for row in listed}
    named = read_commands(path, sensor_ids=NAMES)
    assert as_rows(named) == listed
    assert named.sensor_ids == NAMES
    np.testing.assert_array_equal(named.sensor, table(listed).sensor)


def test_a_file_says_what_a_plain_reader_finds(tmp_path):
    path = tmp_path / "c.csv"
    write_commands(path, table([(0.5, "n1", "master"), (2.0, "c, d", "sleeping")]))
    lines = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    assert lines == [
        ["t_s", "sensor_id", "mode"],
        ["0.5", "n1", "master"],
        ["2.0", "c, d", "sleeping"],
    ]


@given(listed=rows)
def test_columns_keep_every_value(listed):
    names = ("t_s", "sensor_id", "mode")
    columns = dict(zip(names, ([row[i] for row in listed] for i in range(3)), strict=True))
    assert as_rows(commands_from_columns(columns)) == listed


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,n1,asleep\n", "line 2: mode: found 'asleep', expected a mode; nearest valid one: sl"),
        ("0,n1,sensing\n1,,active\n", "line 3: sensor_id: found nothing, expected a name"),
        ("x,n1,sensing\n", "line 2: t_s: found 'x', expected a finite number"),
        ("0,n9,sensing\n", "line 2: sensor_id: found 'n9', expected a sensor of the site"),
    ],
)
def test_a_fault_is_told_with_its_place(tmp_path, text, said):
    path = tmp_path / "c.csv"
    path.write_text("t_s,sensor_id,mode\n" + text)
    with pytest.raises(InputError, match=said):
        read_commands(path, sensor_ids=None if "n9" not in text else NAMES)


def test_a_file_of_what_was_spent_adds_up(tmp_path):
    start = meter.init(Energy(), ("a", "b"), battery_j=np.array([100.0, 1.0]))
    told = Commands(
        np.array([1.0, 1.0]),
        np.array([0, 1], np.int32),
        np.array([Mode.MASTER, Mode.SENSING], np.int32),
        ("a", "b"),
    )
    found, _ = meter.step(start, 5.0, commands=told)
    write_energy(tmp_path / "e.csv", found)
    first, second = csv.DictReader((tmp_path / "e.csv").read_text().splitlines())
    assert tuple(first) == COLUMNS
    spent = {name: float(first[name]) for name in COLUMNS[1:7]}
    assert math.fsum(spent.values()) + float(first["residual_j"]) == pytest.approx(100.0)
    assert spent["sleeping_j"] == pytest.approx(0.13)
    assert first["exhausted_s"] == ""
    assert float(second["exhausted_s"]) == pytest.approx(1.0 + 0.87 / 3.33)
    assert float(second["residual_j"]) == 0.0
    write_energy(tmp_path / "e.ndjson", found)
    line = json.loads((tmp_path / "e.ndjson").read_text().splitlines()[0])
    assert line["master_j"] == pytest.approx(spent["master_j"])
    assert line["exhausted_s"] is None
    assert set(energy_columns(found)) == set(COLUMNS)
