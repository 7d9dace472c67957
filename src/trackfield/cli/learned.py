"""What a calibration comes to on the command line, of whatever kind the sensors are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from trackfield.network.site import Site


class Learned(NamedTuple):
    """A calibrated site, and what was learned: numbers for `--json`, and how to tell and draw it.

    `show` takes the whole result of `--json`; `draw` takes a title and a file, None where there is
    no figure.
    """

    site: Site
    numbers: dict[str, Any]
    show: Callable[[Mapping[str, Any]], None]
    warnings: list[str]
    draw: Callable[[str, Path], None] | None = None
