"""`trackfield plan SITE --map FILE`: how well a target can be located, place by place."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.output import check_figure, check_output
from trackfield.errors import ConfigurationError
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.raster import Region
    from trackfield.scheduling.accuracy import AccuracyMap

DATA = (".csv", ".ndjson", ".parquet", ".geojson")
_CELLS = 120  # along the longer side, if nobody asks for a size


def check_map(path: Path, inputs: list[Path]) -> None:
    """Refuse, before the work, a map that could not be written after it."""
    if path.suffix.lower() not in DATA:
        check_figure(path)
    check_output(path, inputs)


def answer(site: Site, path: Path | None, *, sensors: int | None, cell_m: float | None) -> Answer:
    """Map the bound over the site's region, of all sensors in reach or of the best `sensors`."""
    from trackfield.plotting.plans import plot_map
    from trackfield.scheduling.accuracy import accuracy_map, summary
    from trackfield.scheduling.selection import select

    area = region_of(site)
    cell = max(area.x_max - area.x_min, area.y_max - area.y_min) / _CELLS if not cell_m else cell_m
    choose = None if sensors is None else lambda gains: select(gains, sensors).sensors  # pyright: ignore
    found = accuracy_map(site, area, cell_m=cell, choose=choose)
    who = "all sensors in reach" if sensors is None else f"the best {sensors} in reach"
    if path is not None and path.suffix.lower() in DATA:
        _write(path, found, site)
    told = summary(found)
    rms = told.rms_m
    numbers = {
        "region_m": list(area),
        "cell_m": cell,
        "readings_of": "all" if sensors is None else sensors,
        "undetermined": told.undetermined,
        "rms_m": None if rms is None else dict(zip(("median", "q95", "worst"), rms, strict=True)),
        "covered": dict(zip(("least", "mean", "most"), told.covered, strict=True)),
    }
    lines = [
        f"{area.x_max - area.x_min:g} x {area.y_max - area.y_min:g} m, one reading each of {who}:"
    ]
    if rms is not None:
        lines.append(f"  rms error: median {rms[0]:.3g} m, 95 % below {rms[1]:.3g} m")
    lines.append(
        f"  sensors in reach: {told.covered[1]:.1f} on average, {told.covered[0]} to "
        f"{told.covered[2]}"
    )
    doubts = []
    if told.undetermined:
        doubts.append(f"no position follows in {100 * told.undetermined:.3g} % of the region")
    title = f"{site.name}: rms error of one reading each of {who}"
    return Answer(
        numbers,
        lines,
        doubts=doubts,
        figure=lambda: plot_map(
            found, site.positions[:, :2], names=site.sensor_ids, title=title
        ),
    )
