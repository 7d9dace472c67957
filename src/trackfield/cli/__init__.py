"""Verbs; no logic."""

import sys
from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `trackfield` with these arguments, or with those of the process; the exit code."""
    try:
        from trackfield.cli.app import (
            main as run,
        )  # takes its time, in which a person may interrupt
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return 130
    return run(arguments)
