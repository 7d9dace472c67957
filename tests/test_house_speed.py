"""How long a person waits: measured in processor time, so that a busy machine does not matter."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.speed
HELP_S = 0.3
FIRST_TRACK_S = 2.0


def processor_time(arguments: list[str]) -> float:
    """Least processor time [s] of three runs of `trackfield`, its start included."""
    times = []
    for _ in range(3):
        before = os.times()
        command = [sys.executable, "-m", "trackfield.cli", *arguments]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = os.times()
        used = after.children_user + after.children_system
        times.append(used - before.children_user - before.children_system)
    return min(times)


def test_help_comes_at_once() -> None:
    assert processor_time(["--help"]) < HELP_S


def test_the_first_track_from_a_cold_start(tmp_path: Path) -> None:
    """Half a minute of a recorded run: loading the program is most of it."""
    assert processor_time(["data", "plaza2", "-o", str(tmp_path)])
    lines = (tmp_path / "measurements.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    few = tmp_path / "few.csv"
    few.write_text("".join(lines[:400]), encoding="utf-8")
    site, tracks = str(tmp_path / "site.toml"), str(tmp_path / "tracks.csv")
    assert processor_time(["track", site, str(few), "-o", tracks]) < FIRST_TRACK_S
    assert Path(tracks).stat().st_size > 1000
