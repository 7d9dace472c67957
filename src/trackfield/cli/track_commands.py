"""What the scheduler tells sensor nodes while tracks are shown: `track --commands`."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.pipeline.commands import Commander
    from trackfield.types import Commands, Tracks


class Orders(NamedTuple):
    """What is told to nodes in a run: nothing, if nobody asked for it."""

    path: Path | None
    commander: Commander | None
    parts: list[Commands]

    def take(self, tracks: Tracks) -> None:
        """Take rows as they are shown."""
        if self.commander is not None:
            self.parts.append(self.commander.process(tracks))

    @property
    def numbers(self) -> dict[str, Any]:
        """Where it is written, and counts, for `--json`."""
        if self.commander is None:
            return {}
        return {"commands": str(self.path), "scheduling": self.commander.counts}

    @property
    def told(self) -> list[str]:
        """The same in words."""
        if self.commander is None:
            return []
        counts = self.commander.counts
        return [
            f"{self.path}: {counts['commands']} changes of modes in {counts['intervals']} "
            f"intervals, {counts['handovers']} hand-overs of masters, {counts['lost']} tracks "
            "given up"
        ]


@contextmanager
def orders_into(path: Path | None, site: Site) -> Generator[Orders]:
    """Command the nodes of a site by the tracks of a run; written only if the run is good."""
    from trackfield.io.commands import write_commands
    from trackfield.pipeline.commands import Commander
    from trackfield.types import join_rows

    if path is None:
        yield Orders(None, None, [])
        return
    commander = Commander(site)
    orders = Orders(path, commander, [])
    yield orders
    write_commands(path, join_rows(orders.parts))
