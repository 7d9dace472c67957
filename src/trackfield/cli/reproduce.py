"""`trackfield reproduce`: tables and figures of a paper, beside ours."""

from __future__ import annotations


def reproduce() -> None:
    """Reproduce."""
