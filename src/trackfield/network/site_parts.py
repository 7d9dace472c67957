"""What is wrong with the parts of a site's file that are no sensors and no models."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from trackfield.network.faults import nearest
from trackfield.network.fingerprints import Fingerprints, fingerprints_from_csv
from trackfield.network.rooms import room_faults
from trackfield.network.sensors_file import Sensor, read_text
from trackfield.network.site import Room

_Table = Mapping[str, Any]


def survey_of(
    document: _Table, sensors: list[Sensor], folder: Path, name: str
) -> tuple[tuple[Fingerprints, Path] | None, list[str]]:
    """Read the fingerprints that the site names, and where they stand; None if it names none."""
    file = document.get("site", {}).get("survey_file")
    if file is None or not sensors:  # without sensors every one in it would seem to be unknown
        return None, []
    text, problems = read_text(folder / file)
    if problems:
        return None, [f"{name}: survey_file: {problem}" for problem in problems]
    ids = tuple(sensor.sensor_id for sensor in sensors)
    survey, problems = fingerprints_from_csv(text, str(folder / file), ids)
    return (survey, folder / file), problems


def group_problems(sensors: list[Sensor], groups: list[_Table], name: str) -> Iterator[str]:
    """Tell of groups that come twice, and of sensors of groups that are not there."""
    ids = [group["id"] for group in groups]
    for number, group_id in enumerate(ids):
        if group_id in ids[:number]:
            yield f"{name}: groups[{number + 1}].id: found {group_id!r} a second time"
    for sensor in sensors:
        if sensor.group is not None and sensor.group not in ids:
            yield (
                f"{sensor.where}: group: found {sensor.group!r}, expected a group of {name}; "
                f"{nearest(sensor.group, ids)}"
            )


def target_problems(sensors: list[Sensor], target: _Table, name: str) -> Iterator[str]:
    """Tell what a target cannot be among these sensors."""
    flat = [s.sensor_id for s in sensors if math.isnan(s.position[2])]
    volume = target.get("dimensions") == 3
    if volume and flat:
        some = ", ".join(flat[:5]) + (", ..." if len(flat) > 5 else "")
        yield f"{name}: target.dimensions: found 3, expected a z_m of every sensor; none for {some}"
    if "height_m" in target and volume:
        yield f"{name}: target.height_m: found with dimensions = 3, expected with 2 only"
    elif "height_m" in target and sensors and len(flat) == len(sensors):
        yield f"{name}: target.height_m: found {target['height_m']}, expected sensors with z_m"


def region_problems(reports: _Table, name: str) -> Iterator[str]:
    """Tell of a region that is none."""
    region = reports.get("region")
    if region is not None and not (region[0] < region[2] and region[1] < region[3]):
        yield (
            f"{name}: reports.region: found {region}, "
            "expected [x_min, y_min, x_max, y_max] in metres, min below max"
        )


def obstacle_problems(obstacles: list[_Table], name: str) -> Iterator[str]:
    """Tell of obstacles that are no polygon."""
    for number, obstacle in enumerate(obstacles, 1):
        corners = obstacle["polygon"]
        if len(corners) < 3:
            yield (
                f"{name}: obstacles[{number}].polygon: found {len(corners)} corners, "
                "expected 3 or more"
            )


def room_problems(rooms: list[_Table], name: str) -> Iterator[str]:
    """Tell of rooms that are no polygon, come twice or overlap."""
    listed = [Room(room["id"], tuple((x, y) for x, y in room["polygon"])) for room in rooms]
    for number, fault in room_faults(listed):
        yield f"{name}: rooms[{number + 1}].{fault}"
