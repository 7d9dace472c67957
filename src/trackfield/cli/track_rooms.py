"""The rooms that targets are in while they are tracked: `track --rooms`."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.filtering.rooms import Beliefs, RoomRows
    from trackfield.network.site import Site
    from trackfield.types import Tracks


class RoomSink:
    """Follows the rooms of a run's targets; does nothing if nobody asked for them."""

    def __init__(self, path: Path | None, site: Site) -> None:
        if path is not None and not site.rooms:
            found = f"--rooms: found no rooms in site {site.name}, expected [[rooms]]"
            raise ConfigurationError([found])
        self.parts: list[RoomRows] = []
        self._path, self._rooms = path, site.rooms
        self._beliefs: Beliefs = {}

    def take(self, tracks: Tracks) -> None:
        """Take rows as they are shown."""
        from trackfield.filtering.rooms import follow_rooms

        if self._path is not None:
            rows, self._beliefs = follow_rooms(self._rooms, tracks, self._beliefs)
            self.parts.append(rows)

    @property
    def numbers(self) -> dict[str, Any]:
        """Where rooms are written, and how often they changed, for `--json`."""
        if self._path is None:
            return {}
        return {"rooms": str(self._path), "room_changes": self._changes}

    @property
    def told(self) -> list[str]:
        """The same in words."""
        if self._path is None:
            return []
        rows = sum(map(len, self.parts))
        return [f"{self._path}: {rows} rows, {self._changes} changes of rooms"]

    @property
    def _changes(self) -> int:
        """Count how often a track was told to be in another room than before."""
        last: dict[int, int] = {}
        changes = 0
        for part in self.parts:
            for track, room in zip(part.track.tolist(), part.room.tolist(), strict=True):
                changes += last.setdefault(track, room) != room
                last[track] = room
        return changes


@contextmanager
def rooms_into(path: Path | None, site: Site) -> Generator[RoomSink]:
    """Follow the rooms of a run's targets; written only if the run is good."""
    from trackfield.io.writing import write_tables

    sink = RoomSink(path, site)
    yield sink
    if path is not None:
        write_tables(path, (part.columns() for part in sink.parts))
