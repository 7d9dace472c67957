"""Rows of a run on their way to what was asked for: files, orders to nodes, a picture."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackfield.cli.runs import Wanted
from trackfield.cli.track_commands import Orders, orders_into
from trackfield.cli.track_rooms import RoomSink, rooms_into

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.types import Tracks


class RowSink:
    """Takes rows as they are settled; counts them, and those that are shown."""

    def __init__(
        self, write: Callable[[Tracks], None], orders: Orders, *, rooms: RoomSink, keep: bool
    ) -> None:
        self._orders, self._rooms = orders, rooms
        self.rows = self.shown = 0
        self.kept: list[Tracks] = []
        self._write, self._keep = write, keep

    def put(self, tracks: Tracks) -> None:
        """Pass rows on."""
        from trackfield.metrics.error import shown

        self.rows += len(tracks)
        self.shown += int(shown(tracks).sum())
        self._write(tracks)
        self._orders.take(tracks)
        self._rooms.take(tracks)
        if self._keep:
            self.kept.append(tracks)

    @property
    def numbers(self) -> dict[str, Any]:
        """What orders and rooms came to, for `--json`."""
        return {**self._orders.numbers, **self._rooms.numbers}

    @property
    def told(self) -> list[str]:
        """The same in words."""
        return [*self._orders.told, *self._rooms.told]


@contextmanager
def rows_into(output: Path, site: Site, wanted: Wanted) -> Generator[RowSink]:
    """Take the rows of a run; files appear only if the run is good."""
    from trackfield.io.tracks import open_tracks

    with (
        open_tracks(output, origin=site.origin) as write,
        orders_into(wanted.commands, site) as orders,
        rooms_into(wanted.rooms, site) as rooms,
    ):
        yield RowSink(write, orders, rooms=rooms, keep=wanted.keep)
