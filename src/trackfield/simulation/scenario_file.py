"""A scenario's TOML file: read with every fault listed at once."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, cast, get_args, get_type_hints

from pydantic import TypeAdapter, ValidationError

from trackfield.errors import ConfigurationError
from trackfield.network.faults import nearest, path_text
from trackfield.network.sensors_file import read_text
from trackfield.simulation.scenario import Scenario
from trackfield.simulation.scenario_checks import borrowed_faults, contradictions

_ADAPTER = TypeAdapter(Scenario)
_EXPECTED = {
    "missing": "a value",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "string_too_short": "text that is not empty",
    "dataclass_type": "a table",
    "tuple_type": "a list",
}
_BOUNDS = {  # by the kind of fault: how its bound is told
    "greater_than": ("gt", "a number above {:g}"),
    "greater_than_equal": ("ge", "{:g} or more"),
    "less_than": ("lt", "a number below {:g}"),
    "less_than_equal": ("le", "at most {:g}"),
}
_Path = tuple[str | int, ...]


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario's file; `ConfigurationError` lists all faults."""
    path = Path(path)
    text, problems = read_text(path)
    if problems:
        raise ConfigurationError(problems)
    return scenario_from_toml(text, str(path))


def scenario_from_toml(text: str, name: str = "scenario.toml") -> Scenario:
    """Read the scenario that `text` says; `name` is what messages call the file.

    `ConfigurationError` lists all faults: of single keys, and of keys that contradict each other.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError([f"{name}: not TOML: {error}"]) from None
    document.setdefault("name", Path(name).stem)
    faults = dict(borrowed_faults(document))
    sound = {
        key: _without(value, {path[1:] for path in faults if path[0] == key})
        for key, value in document.items()
    }
    try:
        # As JSON: there, lists may be tuples and whole numbers floats, even for strict types.
        scenario = _ADAPTER.validate_json(json.dumps(sound, default=str))
    except ValidationError as error:
        for one in error.errors():
            path, sentence = _fault(one["type"], one["loc"], dict(one))
            faults.setdefault(path, sentence)
        scenario = None
    problems = [f"{name}: {path_text(path)}: {sentence}" for path, sentence in faults.items()]
    if scenario is not None:
        problems += [f"{name}: {problem}" for problem in contradictions(scenario)]
    if problems or scenario is None:
        raise ConfigurationError(problems)
    return scenario


def scenario_schema() -> dict[str, Any]:
    """JSON Schema of a scenario's file."""
    schema = cast("dict[str, Any]", _without_infinities(_ADAPTER.json_schema()))
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _without(section: object, faulty: set[_Path]) -> object:
    """Leave out keys of a section that are told already; its class would only refuse them again."""
    if not isinstance(section, Mapping):
        return section
    table = cast("Mapping[str, object]", section)
    return {key: value for key, value in table.items() if (key,) not in faulty}


def _without_infinities(value: object) -> object:
    """Leave out defaults that are infinite: JSON cannot say them."""
    if isinstance(value, Mapping):
        table = cast("Mapping[str, object]", value)
        return {k: _without_infinities(v) for k, v in table.items() if v != math.inf}
    return value


def _fault(kind: str, path: _Path, error: Mapping[str, Any]) -> tuple[_Path, str]:
    """Say what was found at `path` and what was expected, from pydantic's `error`."""
    key, found = path[-1], error["input"]
    if kind == "unexpected_keyword_argument":
        return path, f"found an unknown key; {nearest(str(key), _keys_at(path[:-1]))}"
    if kind in {"missing", "unexpected_positional_argument", "too_long"} and isinstance(key, int):
        path, kind = path[:-1], "too_long"  # told of the list, not of what it lacks
    if kind == "too_long":
        return path, f"found {_described(found)}, expected {_places_at(path)} values"
    if kind == "missing":
        return path, "found nothing, expected a value"
    if kind == "literal_error":
        expected = str(error["ctx"]["expected"])
    elif kind in _BOUNDS and str(key).startswith("p_"):
        expected = "a probability from 0 to 1"
    elif kind in _BOUNDS:
        limit, words = _BOUNDS[kind]
        expected = words.format(error["ctx"][limit])
    else:
        expected = _EXPECTED.get(kind, str(error["msg"]))
    return path, f"found {_described(found)}, expected {expected}"


def _described(value: object) -> str:
    """Write a value as a person wrote it."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return repr(value)
        case Mapping():
            return "a table"
        case _:
            return str(value)


def _keys_at(path: _Path) -> list[str]:
    """Names of the keys of the table that stands at `path`."""
    return [field.name for field in fields(_type_at(path))]


def _places_at(path: _Path) -> int:
    return len(get_args(_type_at(path)))


def _type_at(path: _Path) -> Any:  # noqa: ANN401  a type, or a tuple of types
    """Type of the value that stands at `path`."""
    here: Any = Scenario
    for key in path:
        here = get_type_hints(here)[key] if isinstance(key, str) else get_args(here)[0]
        here = next((one for one in _choices(here) if one is not NoneType), here)
    return here


def _choices(hint: Any) -> Iterator[Any]:  # noqa: ANN401  types
    """Types of a union; of another type, none."""
    if not is_dataclass(hint) and NoneType in get_args(hint):
        yield from get_args(hint)
