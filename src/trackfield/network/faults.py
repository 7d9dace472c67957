"""What is wrong with a value beside its schema, one line a fault."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any, NamedTuple, cast, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from trackfield.network.bounds import bound
from trackfield.network.kinds import KINDS

Path = tuple[str | int, ...]  # of a key: names of tables, places in lists


class Fault(NamedTuple):
    """One thing wrong with a value: where, and a sentence that says what was expected."""

    path: Path
    sentence: str


_LISTED = 16  # names, at most, that a message lists
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


def find_faults(schema: type[BaseModel], value: object) -> list[Fault]:
    """Every fault of `value` against `schema`, in the order of the keys; none if it fits."""
    try:
        schema.model_validate(value)
    except ValidationError as error:
        found = [_fault(schema, e["loc"], e["type"], dict(e)) for e in error.errors()]
        return list(dict.fromkeys(found))  # the numbers of a list are told as one
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


def _fault(schema: type[BaseModel], loc: Path, kind: str, error: Mapping[str, Any]) -> Fault:
    """Say what was found at `loc` of the schema and what was expected, from pydantic's `error`."""
    if kind.startswith("union_tag"):
        return _kind_fault(loc, error["input"])
    of_model = loc[:1] == ("models",)
    path = loc[:2] + loc[3:] if of_model else loc  # pydantic puts the kind between
    if kind == "extra_forbidden":
        keys = _table_at(schema, loc[:-1]).model_fields
        return Fault(path, f"found an unknown key; {nearest(str(path[-1]), keys)}")
    if kind == "missing":
        return Fault(path, "found nothing, expected a value")
    names = [key for key in path if isinstance(key, str)]
    limits = bound(names[0], names[-1]) if names else None
    if limits and isinstance(path[-1], int):  # a number in a list that is told as one
        while isinstance(path[-1], int):
            path = path[:-1]
        return Fault(path, f"found a list, expected {limits.expected}")
    if kind == "literal_error":
        expected = str(error["ctx"]["expected"])
    elif limits and not kind.endswith("_type"):
        expected = limits.expected
    else:
        expected = _EXPECTED.get(kind, str(error["msg"]))
    return Fault(path, f"found {_describe(error['input'])}, expected {expected}")


def _kind_fault(loc: Path, table: object) -> Fault:
    """Say that a model has no kind, or none that is known."""
    if not isinstance(table, Mapping):
        return Fault(loc, f"found {_describe(table)}, expected a table")
    *most, last = (repr(kind) for kind in KINDS)
    said = cast("Mapping[str, object]", table)
    found = _describe(said["kind"]) if "kind" in said else "nothing"
    return Fault((*loc, "kind"), f"found {found}, expected {', '.join(most)} or {last}")


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
        elif isinstance(get_args(here)[-1], FieldInfo):  # one of several kinds of models
            here = next(one for one in get_args(get_args(here)[0]) if _says(one, str(key)))
        else:  # an entry of a list or of a table of tables
            here = get_args(here)[-1]
        if type(None) in get_args(here):
            here = get_args(here)[0]
    return here


def _says(table: type[BaseModel], kind: str) -> bool:
    return kind in get_args(table.model_fields["kind"].annotation)
