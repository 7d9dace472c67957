"""Closed loops on the command line: `simulate` with [scheduling], `track --commands`."""

from __future__ import annotations

import numpy as np
import pytest

import cli_runs
from conftest import ROOT
from trackfield.io.commands import read_commands
from trackfield.io.measurements import read_readings
from trackfield.network.site_file import load_site
from trackfield.types import Mode

SCENARIO = ROOT / "examples" / "scenarios" / "closed_loop.toml"
SHORT = SCENARIO.read_text().replace("duration_s = 120.0", "duration_s = 30")


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def folder(call, tmp_path):
    (tmp_path / "s.toml").write_text(SHORT)
    call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out")
    return tmp_path / "out"


def test_a_scheduled_scenario_writes_who_was_awake_and_what_that_cost(call, tmp_path):
    (tmp_path / "s.toml").write_text(SHORT)
    done = call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out", "--json")
    again = call("simulate", tmp_path / "s.toml", "-o", tmp_path / "again", "--json")
    assert (done.code, done.err) == (0, "")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        *("measurements.csv", "commands.csv", "energy.csv"),
        *("truth.csv", "sensors.csv", "site.toml"),
    }
    for name in names - {"site.toml"}:
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    numbers = done.json["closed_loop"]
    assert numbers == again.json["closed_loop"]
    site = load_site(tmp_path / "out" / "site.toml")
    assert site.scheduling.interval_s == 0.5
    assert site.energy.battery_j == 1000.0
    commands = read_commands(tmp_path / "out" / "commands.csv", sensor_ids=site.sensor_ids)
    assert len(commands) == numbers["commands"]
    spent = np.genfromtxt(tmp_path / "out" / "energy.csv", delimiter=",", skip_header=1)
    assert np.nansum(spent[:, 1:7]) == pytest.approx(numbers["spent_j"])
    assert sum(numbers["nodes"].values()) == pytest.approx(441)
    assert 0 < numbers["tracked_s"] <= 30
    readings = read_readings(tmp_path / "out" / "measurements.csv", sensor_ids=site.sensor_ids)
    modes = np.zeros(441, int)
    for t_s in np.unique(np.concatenate([commands.t_s, readings.t_s])):
        now = commands.t_s == t_s
        modes[commands.sensor[now]] = commands.mode[now]
        assert (modes[readings.sensor[readings.t_s == t_s]] >= Mode.SENSING).all()


def test_a_closed_loop_is_told_in_words(call, tmp_path):
    (tmp_path / "s.toml").write_text(SHORT)
    done = call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out")
    assert done.code == 0
    assert "commands.csv: " in done.out
    assert "J of it above sleep" in done.out


def test_means_of_bursts_are_written_with_their_sigma(call, tmp_path):
    text = SHORT.replace("sensors = 4\n", "sensors = 4\nburst = 4\n")
    (tmp_path / "s.toml").write_text(text)
    call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out")
    readings = read_readings(tmp_path / "out" / "measurements.csv")
    np.testing.assert_allclose(readings.sigma, 0.1)


def test_an_output_that_cannot_be_written_is_refused_before_the_run(call, tmp_path):
    (tmp_path / "s.toml").write_text(SHORT)
    (tmp_path / "out" / "commands.csv").mkdir(parents=True)
    done = call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out")
    assert done.code == 2
    assert "commands.csv" in done.err
