"""The shape of a site's file, derived from the dataclasses.

Names, types and defaults of keys are those of the sensors' kinds (`KINDS`), `Target`,
`TrackerSettings`, `ReportSettings`, `Channel`, `SchedulingSettings`, `Energy`, `Origin` and
`Group`: a field added there is a key here. Only the bounds of values are said elsewhere, in
`bounds`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, Union, cast, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model

from trackfield.network.bounds import FARTHEST_M, bound
from trackfield.network.channel import Channel
from trackfield.network.energy import Energy
from trackfield.network.kinds import KINDS, Kind
from trackfield.network.site import (
    Group,
    Obstacle,
    Origin,
    ReportSettings,
    Robot,
    Room,
    SchedulingSettings,
    Target,
    TrackerSettings,
)
from trackfield.raster import Region

_Place = Annotated[float, Field(allow_inf_nan=False, ge=-FARTHEST_M, le=FARTHEST_M)]
_Name = Annotated[str, Field(min_length=1)]
_Pair = Annotated[list[_Place], Field(min_length=2, max_length=2)]
_LISTS: Mapping[object, Any] = {  # how a file writes what is a tuple inside
    Region | None: list[_Place] | None,
    tuple[tuple[float, float], ...]: list[_Pair],
}


def _section(name: str, keys: Mapping[str, tuple[Any, Any]]) -> type[BaseModel]:
    """Define a table that holds these keys, (type, default or Field), and no other."""
    definitions: dict[str, Any] = dict(keys)
    return create_model(name, __config__=ConfigDict(strict=True, extra="forbid"), **definitions)


def _keys_of(cls: type, usual: object = None, section: str = "") -> dict[str, tuple[Any, Any]]:
    """Keys of a table for the fields of dataclass `cls`, with bounds; defaults are of `usual`."""
    hints = get_type_hints(cls)
    keys: dict[str, tuple[Any, Any]] = {}
    for field in fields(cls):
        hint, options = hints[field.name], dict[str, Any]()
        limits = bound(section, field.name)
        if limits is not None:
            options |= limits.limits
        if field.default is not MISSING:
            options["default"] = getattr(usual, field.name, field.default)
        if hint in (float, float | None):
            # Only a limit that is off by default may be infinite; NaN fails every bound.
            options["allow_inf_nan"] = field.default == math.inf
        elif hint in _LISTS:
            hint = _LISTS[hint]
            if field.default is not MISSING:
                options["default"] = None if field.default is None else []
        keys[field.name] = (hint, Field(**options))
    return keys


def _model_of(name: str, kind: Kind) -> type[BaseModel]:
    """Table of a model: parameters of all its sensors, of single ones, and of pairs with a tag."""
    title = name.title().replace("_", "")
    parameters = _keys_of(kind.parameters, kind.usual, "models")
    own: dict[str, tuple[Any, Any]] = {
        "sensors": (dict[str, _section(f"{title}Parameters", parameters)], {})
    }
    keys: dict[str, tuple[Any, Any]] = {"kind": (Literal[name], ...), **parameters, **own}
    if kind.tagged:
        keys["targets"] = (dict[str, _section(f"{title}Target", {**parameters, **own})], {})
    return _section(f"{title}Model", keys)


MODELS: Mapping[str, type[BaseModel]] = {
    name: _model_of(name, kind) for name, kind in KINDS.items()
}
_ANY_MODEL = Annotated[Union[tuple(MODELS.values())], Field(discriminator="kind")]  # noqa: UP007 - of a table
SENSOR = _section(
    "Sensor",
    {
        "sensor_id": (_Name, ...),
        "x_m": (_Place, ...),
        "y_m": (_Place, ...),
        "z_m": (_Place | None, None),
        "model": (_Name | None, None),
        "group": (_Name | None, None),
    },
)
_SITE = _section(
    "Site",
    {
        "name": (_Name | None, None),
        "frame": (Literal["local"], "local"),
        "origin": (_section("Origin", _keys_of(Origin)) | None, None),
        "sensors_file": (_Name | None, None),
        "survey_file": (_Name | None, None),
    },
)
SITE_FILE = _section(
    "SiteFile",
    {
        "site": (_SITE, {}),
        "sensors_file": (_Name | None, None),
        "sensors": (list[SENSOR], []),
        "models": (dict[str, _ANY_MODEL], {}),
        "groups": (list[_section("Group", _keys_of(Group))], []),
        "target": (_section("Target", _keys_of(Target)), {}),
        "tracker": (_section("Tracker", _keys_of(TrackerSettings)), {}),
        "reports": (_section("Reports", _keys_of(ReportSettings, section="reports")), {}),
        "network": (_section("Network", _keys_of(Channel)), {}),
        "scheduling": (
            _section("Scheduling", _keys_of(SchedulingSettings, section="scheduling")),
            {},
        ),
        "energy": (_section("Energy", _keys_of(Energy, section="energy")), {}),
        "robot": (_section("Robot", _keys_of(Robot, section="robot")), {}),
        "obstacles": (list[_section("Obstacle", _keys_of(Obstacle))], []),
        "rooms": (list[_section("Room", _keys_of(Room))], []),
    },
)


def site_schema() -> dict[str, Any]:
    """JSON Schema of a site's file."""
    schema = _without_infinities(SITE_FILE.model_json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _without_infinities(table: dict[str, Any]) -> dict[str, Any]:
    """Leave out defaults that are infinite: JSON cannot say them."""
    return {
        key: _without_infinities(cast("dict[str, Any]", value))
        if isinstance(value, dict)
        else value
        for key, value in table.items()
        if value != math.inf
    }
