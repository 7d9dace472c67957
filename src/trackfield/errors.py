"""The few errors a caller can act on."""

from __future__ import annotations


class TrackfieldError(Exception):
    """What went wrong, in one sentence that a person can act on."""


class InputError(TrackfieldError):
    """Data that cannot be used: names file, line or column, what was found, what was expected."""


class ConfigurationError(TrackfieldError):
    """A site or scenario that cannot be used; `problems` holds every fault found, one line each."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


class StateError(TrackfieldError):
    """A snapshot that this version cannot restore."""
