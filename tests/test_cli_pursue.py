"""`trackfield pursue`."""

from __future__ import annotations

import pytest

import cli_runs
from conftest import ROOT

SCENARIO = ROOT / "examples" / "scenarios" / "pursuit.toml"
SMALL = """
duration_s = 20.0
region = [0, 0, 40, 40]
[reports]
sigma_m = 0.3
[[targets]]
count = 1
border = "bounce"
speed_m_s = [0.5, 0.5]
[pursuit]
capture_m = 1.5
[[pursuers]]
at = [20, 20]
[[obstacles]]
corners = [[5, 5], [8, 5], [8, 8]]
"""


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(SMALL)
    return path


def test_the_shipped_scenario_ends_in_captures(call, tmp_path):
    done = call("pursue", SCENARIO, "--json")
    assert done.code == 0
    numbers = done.json
    assert numbers["captured"] == numbers["evaders"] == 2
    assert numbers["collisions"] == 0
    assert numbers["apart_m"] >= 1.0
    assert numbers["clear_m"] >= 0.5
    for fate in numbers["fates"]:
        assert fate["from_s"] < fate["chased_s"] < fate["captured_s"] < fate["to_s"]
    assert call("pursue", SCENARIO, "--json").out == done.out
    assert call("pursue", SCENARIO, "--json", "--seed", "9").json["seed"] == 9


def test_a_pursuit_is_told_and_drawn(call, small, tmp_path):
    plot, film = tmp_path / "p.png", tmp_path / "p.html"
    done = call("pursue", small, "--plot", plot, "--animate", film)
    assert (done.code, done.err) == (0, "")
    assert "s: 1 of 1 captured by 1" in done.out
    assert "least distance between pursuers -" in done.out
    assert plot.read_bytes()[:4] == b"\x89PNG"
    assert '"tracks":[[[1,20.0,20.0,' in film.read_text()


def test_what_nobody_captures_is_told_without_a_number(call, small):
    small.write_text(SMALL.replace("at = [20, 20]", "at = [2, 2]").replace("20.0", "4.0"))
    done = call("pursue", small, "--json")
    assert done.code == 0
    assert done.json["captured"] == 0
    assert done.json["fates"][0]["captured_s"] is None
    assert done.json["apart_m"] is None
    assert "-" in call("pursue", small).out


def test_troubles_are_warned_of_a_few_at_a_time(call, small):
    small.write_text(SMALL.replace("capture_m = 1.5", "capture_m = 1.5\nmost_sigma_m = 0.01"))
    done = call("pursue", small)
    assert done.code == 0
    assert done.err.count("and not chased") == 5
    assert "more of the kind" in done.err


def test_all_faults_are_told_at_once(call, small, tmp_path):
    small.write_text(SMALL.replace("[20, 20]", "[6.9, 6]").replace("capture_m = 1.5", "margin = 1"))
    done = call("pursue", small)
    assert done.code == 2
    assert "pursuit.margin: found 1, expected a number below 1" in done.err
    small.write_text(
        SMALL.replace("[20, 20]", "[6.9, 6]").replace("count", "evade_m_s2 = 1\ncount")
    )
    assert "pursuer 0 at [6.9, 6.0]: found it too near" in call("pursue", small).err
    small.write_text(SMALL.split("[pursuit]")[0])
    done = call("pursue", small)
    assert done.code == 2
    assert "pursuit: found nothing, expected [pursuit] and [[pursuers]]" in done.err
    assert call("pursue", SCENARIO, "--plot", tmp_path / "p.abc").code == 2
    assert call("pursue", SCENARIO, "--animate", tmp_path / "p.abc").code == 2
    assert call("pursue", SCENARIO, "--plot", SCENARIO).code == 2


def test_more_steps_than_can_be_taken_are_refused_at_once(call, tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(SCENARIO.read_text().replace("\nstep_s = 1.0", "\nstep_s = 1e-9"))
    done = call("pursue", path)
    assert done.code == 2
    assert "step_s: found 75000000000 steps, expected at most 10000000" in done.err
