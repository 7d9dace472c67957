"""The shape of a site's file, derived from the dataclasses, and its faults as one line each.

Names, types and defaults of keys are those of `UNCALIBRATED`, `Target`, `TrackerSettings`, `Origin`
and `Group`: a field added there is a key here. Only the bounds of numbers are said in this module.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from difflib import get_close_matches
from typing import Annotated, Any, Literal, NamedTuple, cast, get_args, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from trackfield.network.site import Group, Origin, Target, TrackerSettings
from trackfield.sensing.range import UNCALIBRATED, RangeModel

Path = tuple[str | int, ...]  # of a key: names of tables, places in lists


class Bound(NamedTuple):
    """What a number must be, and what to tell who wrote another one."""

    limits: dict[str, float]
    expected: str


class Fault(NamedTuple):
    """One thing wrong with a value: where, and a sentence that says what was expected."""

    path: Path
    sentence: str


_POSITIVE = Bound({"gt": 0.0}, "a number above 0")
_NOT_NEGATIVE = Bound({"ge": 0.0}, "a finite number, 0 or more")
_BOUNDS = {
    "scale": Bound(
        {"gt": -0.5, "lt": 0.5},
        "a number between -0.5 and 0.5: what is added to a factor of 1 "
        "(a factor of 1.02 is written 0.02)",
    ),
    "lat": Bound({"ge": -90.0, "le": 90.0}, "degrees from -90 to 90"),
    "lon": Bound({"ge": -180.0, "le": 360.0}, "degrees from -180 to 360"),
    "max_range_m": _POSITIVE,
    "correlation_length_m": _POSITIVE,
    "max_speed_m_s": _POSITIVE,
    "accel_sigma_m_s2": _POSITIVE,
    "drop_s": _POSITIVE,
    "window_s": _NOT_NEGATIVE,
}

_LISTED = 16  # names, at most, that a message lists
_Number = Annotated[float, Field(allow_inf_nan=False)]
_Name = Annotated[str, Field(min_length=1)]


def _bound(key: object) -> Bound | None:
    """Bound of a key: its own, or that of any standard deviation."""
    return _BOUNDS.get(str(key)) or (_NOT_NEGATIVE if "sigma" in str(key) else None)


def _section(name: str, keys: Mapping[str, tuple[Any, Any]]) -> type[BaseModel]:
    """Define a table that holds these keys, (type, default or Field), and no other."""
    definitions: dict[str, Any] = dict(keys)
    return create_model(name, __config__=ConfigDict(strict=True, extra="forbid"), **definitions)


def _keys_of(cls: type, usual: object = None) -> dict[str, tuple[Any, Any]]:
    """Keys of a table for the fields of dataclass `cls`, with bounds; defaults are of `usual`."""
    hints = get_type_hints(cls)
    keys: dict[str, tuple[Any, Any]] = {}
    for field in fields(cls):
        options: dict[str, Any] = {}
        if field.default is not MISSING:
            options["default"] = getattr(usual, field.name, field.default)
        if hints[field.name] in (float, float | None):
            bound = _bound(field.name)
            # Only a limit that is off by default may be infinite; NaN fails every bound.
            options |= {
                **(bound.limits if bound else {}),
                "allow_inf_nan": field.default == math.inf,
            }
        keys[field.name] = (hints[field.name], Field(**options))
    return keys


_PARAMETERS = _keys_of(RangeModel, UNCALIBRATED)
RANGE_PARAMETERS = _section("RangeParameters", _PARAMETERS)
_OF_SENSORS: dict[str, tuple[Any, Any]] = {"sensors": (dict[str, RANGE_PARAMETERS], {})}
_OF_TARGET = _section("RangeTarget", {**_PARAMETERS, **_OF_SENSORS})
_OF_TARGETS: dict[str, tuple[Any, Any]] = {"targets": (dict[str, _OF_TARGET], {})}
RANGE_MODEL = _section(
    "RangeModel",
    {"kind": (Literal["range"], ...), **_PARAMETERS, **_OF_SENSORS, **_OF_TARGETS},
)
SENSOR = _section(
    "Sensor",
    {
        "sensor_id": (_Name, ...),
        "x_m": (_Number, ...),
        "y_m": (_Number, ...),
        "z_m": (_Number | None, None),
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
    },
)
SITE_FILE = _section(
    "SiteFile",
    {
        "site": (_SITE, {}),
        "sensors_file": (_Name | None, None),
        "sensors": (list[SENSOR], []),
        "models": (dict[str, RANGE_MODEL], {}),
        "groups": (list[_section("Group", _keys_of(Group))], []),
        "target": (_section("Target", _keys_of(Target)), {}),
        "tracker": (_section("Tracker", _keys_of(TrackerSettings)), {}),
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


def find_faults(schema: type[BaseModel], value: object) -> list[Fault]:
    """Every fault of `value` against `schema`, in the order of the keys; none if it fits."""
    try:
        schema.model_validate(value)
    except ValidationError as error:
        return [
            Fault(e["loc"], _sentence(schema, e["type"], e["loc"], dict(e))) for e in error.errors()
        ]
    return []


def path_text(path: Path) -> str:
    """Path of a key as a person writes it; entries of lists count from 1."""
    text = ""
    for key in path:
        text += f"[{key + 1}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def nearest(name: str, known: Iterable[str]) -> str:
    """Say which of the `known` names was perhaps meant, and what they all are."""
    known = list(known)
    close = get_close_matches(name, known, n=1, cutoff=0.5)
    meant = f"nearest valid one: {close[0]}; " if close else ""
    more = ", ..." if len(known) > _LISTED else ""
    return f"{meant}valid ones: {', '.join(known[:_LISTED]) or 'none'}{more}"


_EXPECTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "string_too_short": "text that is not empty",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "list_type": "a list",
}


def _sentence(schema: type[BaseModel], kind: str, path: Path, error: Mapping[str, Any]) -> str:
    """Say what was found at `path` and what was expected, from pydantic's `error`."""
    if kind == "extra_forbidden":
        keys = _table_at(schema, path[:-1]).model_fields
        return f"found an unknown key; {nearest(str(path[-1]), keys)}"
    if kind == "missing":
        expected = "'range'" if path[-1] == "kind" else "a value"
        return f"found nothing, expected {expected}"
    bound = _bound(path[-1])
    if kind == "literal_error":
        expected = str(error["ctx"]["expected"])
    elif bound and not kind.endswith("_type"):
        expected = bound.expected
    else:
        expected = _EXPECTED.get(kind, str(error["msg"]))
    return f"found {_describe(error['input'])}, expected {expected}"


def _describe(value: object) -> str:
    """Write a value as a person wrote it."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return repr(value)
        case Mapping():
            return "a table"
        case list():
            return "a list"
        case _:
            return str(value)


def _table_at(schema: type[BaseModel], path: Path) -> type[BaseModel]:
    """Find the schema of the table that stands at `path` of a value of `schema`."""
    here: Any = schema
    for key in path:
        if hasattr(here, "model_fields"):
            here = here.model_fields[key].annotation
        else:  # an entry of a list or of a table of tables
            here = get_args(here)[-1]
        if type(None) in get_args(here):
            here = get_args(here)[0]
    return here
