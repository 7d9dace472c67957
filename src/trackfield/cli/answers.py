"""What `trackfield plan` answers a question with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackfield.experiments.results import Table


class Answer(NamedTuple):
    """An object for `--json`; lines, tables and doubts for people; a picture; and if it failed."""

    numbers: dict[str, Any]
    lines: Sequence[str]
    tables: Sequence[Table] = ()
    doubts: Sequence[str] = ()
    figure: Callable[[], Figure] | None = None
    failed: bool = False
