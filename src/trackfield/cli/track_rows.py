"""Rows of a run on their way to what was asked for: a file, orders to nodes, a picture."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from trackfield.cli.runs import Wanted
from trackfield.cli.track_commands import Orders, orders_into

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.types import Tracks


class RowSink:
    """Takes rows as they are settled; counts them, and those that are shown."""

    def __init__(self, write: Callable[[Tracks], None], orders: Orders, *, keep: bool) -> None:
        self.orders = orders
        self.rows = self.shown = 0
        self.kept: list[Tracks] = []
        self._write, self._keep = write, keep

    def put(self, tracks: Tracks) -> None:
        """Pass rows on."""
        from trackfield.metrics.error import shown

        self.rows += len(tracks)
        self.shown += int(shown(tracks).sum())
        self._write(tracks)
        self.orders.take(tracks)
        if self._keep:
            self.kept.append(tracks)


@contextmanager
def rows_into(output: Path, site: Site, wanted: Wanted) -> Generator[RowSink]:
    """Take the rows of a run; files appear only if the run is good."""
    from trackfield.io.tracks import open_tracks

    with (
        open_tracks(output, origin=site.origin) as write,
        orders_into(wanted.commands, site) as orders,
    ):
        yield RowSink(write, orders, keep=wanted.keep)
