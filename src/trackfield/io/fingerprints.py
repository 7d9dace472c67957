"""Surveys of signal strength from files: `fingerprints.csv`."""

from __future__ import annotations

from pathlib import Path

from trackfield.errors import InputError
from trackfield.network.fingerprints import Fingerprints, fingerprints_from_csv, is_fingerprints
from trackfield.network.sensors_file import read_text

_TOLD = 5  # problems, at most, in one message


def read_fingerprints(path: str | Path, *, sensor_ids: tuple[str, ...]) -> Fingerprints:
    """Read how strongly the sensors of a site heard a beacon at known places.

    `InputError` names file, lines, columns, what was found and what was expected.
    """
    text, problems = read_text(Path(path))
    if not problems:
        found, problems = fingerprints_from_csv(text, str(path), sensor_ids)
        if not problems:
            return found
    more = [f"and {len(problems) - _TOLD} more"] if len(problems) > _TOLD else []
    raise InputError("\n".join([*problems[:_TOLD], *more]))


def holds_fingerprints(path: str | Path) -> bool:
    """Tell by its header whether a file is a survey; a file that cannot be read is none."""
    try:
        with Path(path).open(encoding="utf-8-sig") as file:
            return is_fingerprints(file.readline(10_000))
    except (OSError, UnicodeDecodeError):
        return False
