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
BLIND = SHORT.replace("sensors = 4\n", "sensors = 4\nenergy_weight = 0\n").replace(
    "battery_j = 1000", "battery_j = 1e12"
)


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def folder(call, tmp_path):
    (tmp_path / "s.toml").write_text(BLIND)
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


def test_track_tells_what_nodes_would_have_been_told(call, folder):
    made = folder / "told.csv"
    done = call(
        "track", folder / "site.toml", folder / "measurements.csv",
        "-o", folder / "tracks.csv", "--commands", made, "--json",
    )  # fmt: skip
    assert (done.code, done.err) == (0, "")
    assert done.json["commands"] == str(made)
    site = load_site(folder / "site.toml")
    told = read_commands(made, sensor_ids=site.sensor_ids)
    assert len(told) == done.json["scheduling"]["commands"]
    # Where energies do not count, those who were told in the loop would have been told again.
    looped = read_commands(folder / "commands.csv", sensor_ids=site.sensor_ids)
    for name in ("t_s", "sensor", "mode"):
        np.testing.assert_array_equal(getattr(told, name), getattr(looped, name))
    words = call(
        "track", folder / "site.toml", folder / "measurements.csv",
        "-o", folder / "tracks.csv", "--commands", made,
    )  # fmt: skip
    assert "changes of modes in" in words.out


def test_commands_need_what_is_known_in_time_and_sensors(call, folder, tmp_path):
    parts = ("track", folder / "site.toml", folder / "measurements.csv", "-o", folder / "t.csv")
    late = call(*parts, "--commands", folder / "c.csv", "--lag", "2")
    assert late.code == 2
    assert "--commands: found with --lag" in late.err
    assert not (folder / "c.csv").exists()
    same = call(*parts, "--commands", folder / "t.csv")
    assert same.code == 2
    (tmp_path / "r.toml").write_text(
        "duration_s = 20\nregion = [0, 0, 30, 30]\n[reports]\n[[targets]]\ncount = 1\n"
    )
    call("simulate", tmp_path / "r.toml", "-o", tmp_path / "r")
    none = call(
        "track", tmp_path / "r" / "site.toml", tmp_path / "r" / "reports.csv",
        "-o", folder / "t.csv", "--commands", folder / "c.csv",
    )  # fmt: skip
    assert none.code == 2
    assert "no sensors that could be scheduled" in none.err


def test_commands_of_unknown_targets(call, tmp_path):
    (tmp_path / "s.toml").write_text(
        "duration_s = 30\nregion = [0, 0, 30, 30]\n[sensors]\nspacing_m = 3\n[signal]\n"
        "[[targets]]\ncount = 1\nat_start = 1\nspeed_m_s = [0.5, 0.5]\ninset_m = 12\n"
    )
    call("simulate", tmp_path / "s.toml", "-o", tmp_path / "o")
    done = call(
        "track", tmp_path / "o" / "site.toml", tmp_path / "o" / "measurements.csv",
        "-o", tmp_path / "t.csv", "--commands", tmp_path / "c.parquet", "--json",
    )  # fmt: skip
    assert done.code == 0
    commands = read_commands(tmp_path / "c.parquet")
    assert done.json["scheduling"]["intervals"] > 25
    assert {int(mode) for mode in commands.mode} == {0, 1, 2, 3}


def test_exhausted_nodes_spend_nothing_and_save_nothing(call, tmp_path):
    (tmp_path / "s.toml").write_text(SHORT.replace("battery_j = 1000", "battery_j = 0.5"))
    done = call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out", "--json")
    told = done.json["closed_loop"]
    assert told["exhausted"] == 441
    assert 0.0 <= told["above_sleep_j"] <= told["spent_j"] == pytest.approx(441 * 0.5)


@pytest.mark.parametrize(("interval_s", "code"), [("1e300", 2), ("1e6", 0)])
def test_an_interval_longer_than_the_run_is_one_interval(call, tmp_path, interval_s, code):
    text = SHORT.replace("interval_s = 0.5", f"interval_s = {interval_s}")
    (tmp_path / "s.toml").write_text(text.replace("duration_s = 30", "duration_s = 1e-4"))
    done = call("simulate", tmp_path / "s.toml", "-o", tmp_path / "out")
    assert done.code == code
    assert code == 0 or "scheduling.interval_s: found 1e+300, expected a number" in done.err
