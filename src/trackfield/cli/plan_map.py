"""`trackfield plan SITE --map FILE`: how well a target can be located, place by place."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.output import check_figure, check_output
from trackfield.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.raster import Region
    from trackfield.scheduling.accuracy import AccuracyMap, Choose

TABLES = (".csv", ".ndjson", ".parquet", ".geojson")
_LINE = 1e-6  # of their length: sensors as narrow as that stand in one line
_CELLS = 120  # along the longer side, if nobody asks for a size


def check_map(path: Path, inputs: Sequence[Path]) -> None:
    """Refuse, before the work, a map that could not be written after it."""
    if path.suffix.lower() not in TABLES:
        try:
            check_figure(path)
        except InputError as error:
            raise ConfigurationError([f"{error}; for a table one of {', '.join(TABLES)}"]) from None
    check_output(path, list(inputs))


def answer(site: Site, path: Path, *, sensors: int | None, cell_m: float | None) -> Answer:
    """Map the bound over the site's region: of all sensors in reach, or of the best `sensors`."""
    found = mapped(site, cell_m=cell_m, choose=_best(sensors))
    who = "all sensors in reach" if sensors is None else f"the best {sensors} in reach"
    told = accuracy_numbers(found)
    if path.suffix.lower() in TABLES:
        _write(path, found, site)
    else:
        from trackfield.plotting.plans import plot_map
        from trackfield.plotting.style import save

        title = f"{site.name}: rms error, one reading of each of {who}"
        save(plot_map(found, site.positions[:, :2], names=site.sensor_ids, title=title), path)
    lines = [f"one reading of each of {who}:", *accuracy_lines(told), f"{path}: written"]
    numbers = {**told, "readings_of": sensors or "all", "file": str(path)}
    return Answer(numbers, lines, doubts=[*accuracy_doubts(told), *mirror_doubts(site)])


def mapped(
    site: Site, *, cell_m: float | None, choose: Choose | None = None, cells: int = _CELLS
) -> AccuracyMap:
    """Map the bound over the site's region, in `cells` along its longer side, or of `cell_m`."""
    from trackfield.scheduling.accuracy import accuracy_map

    in_plane(site)
    area = region_of(site)
    side = max(area.x_max - area.x_min, area.y_max - area.y_min)
    return accuracy_map(site, area, cell_m=cell_m or side / cells, choose=choose)


def mirror_doubts(site: Site) -> list[str]:
    """Say that sensors stand in one line, where their readings are alike on both sides of it."""
    from trackfield.sensing.range import RangeModel
    from trackfield.sensing.signal import SignalModel

    alike = all(isinstance(model, RangeModel | SignalModel) for model in site.models)
    places = site.positions[:, :2]
    if site.target.dimensions == 3 or not alike or len(places) < 2:
        return []
    offsets = places - places.mean(axis=0)
    spread = np.linalg.svd(offsets, compute_uv=False)
    if spread[1] > _LINE * spread[0]:
        return []
    return [
        "all sensors stand in one line: no reading tells a place from its mirror image across it; "
        "errors are those of who knows the side"
    ]


def region_of(site: Site) -> Region:
    """Region that a site tells, or that its sensors span."""
    from trackfield.pipeline.scene import watched

    area = watched(site)
    if area is None:
        problem = (
            f"site {site.name}: reports.region: found nothing and no sensors that span a region, "
            "expected [x_min, y_min, x_max, y_max] in metres"
        )
        raise ConfigurationError([problem])
    return area


def in_plane(site: Site) -> None:
    """Refuse a site whose targets have heights: what is asked has an answer in the plane only."""
    if site.target.dimensions == 3:
        problem = (
            f"site {site.name}: target.dimensions: found 3, expected 2: only --at, --lifetime and "
            "--robot plan for targets in space"
        )
        raise ConfigurationError([problem])


def accuracy_numbers(found: AccuracyMap) -> dict[str, Any]:
    """Put a map into a few numbers, as they are told in JSON."""
    from trackfield.scheduling.accuracy import summary

    told = summary(found)
    rms = told.rms_m
    return {
        "region_m": list(found.rms_m.region),
        "cells": list(found.rms_m.values.shape),
        "undetermined": told.undetermined,
        "rms_m": None if rms is None else dict(zip(("median", "q95", "worst"), rms, strict=True)),
        "in_reach": dict(zip(("least", "mean", "most"), told.covered, strict=True)),
    }


def accuracy_lines(told: dict[str, Any]) -> list[str]:
    """Say such numbers."""
    reach, rms = told["in_reach"], told["rms_m"]
    lines = [
        f"  in reach of a place: {reach['mean']:.1f} sensors on average, {reach['least']} to "
        f"{reach['most']}"
    ]
    if rms is not None:
        middle, most = rms["median"], rms["q95"]
        lines.append(f"  rms error: median {middle:.3g} m, 95 % of the region below {most:.3g} m")
    return lines


def accuracy_doubts(told: dict[str, Any]) -> list[str]:
    """Say where no position follows."""
    free = told["undetermined"]
    few = told["in_reach"]["most"] < 2
    why = (
        "too few sensors in reach"
        if few
        else "too few sensors in reach, all in line, or readings that do not change with the place"
    )
    return [f"no position follows in {100.0 * free:.3g} % of the region: {why}"] if free else []


def _best(sensors: int | None) -> Choose | None:
    if sensors is None:
        return None
    from trackfield.scheduling.selection import select

    return lambda gains: select(gains, sensors).sensors


def _write(path: Path, found: AccuracyMap, site: Site) -> None:
    from trackfield.io.rasters import write_rasters
    from trackfield.scheduling.accuracy import by_name

    write_rasters(path, by_name(found), origin=site.origin)
