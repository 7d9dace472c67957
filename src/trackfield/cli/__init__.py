"""Verbs; no logic."""

from trackfield.cli.app import main

__all__ = ["main"]
