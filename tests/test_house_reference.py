"""Everything public is documented: modules, names, keys of the site's file, columns of files."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pages import DOCS, ROOT

SOURCE = ROOT / "src"
REFERENCE = DOCS / "reference"


def public_modules() -> list[str]:
    """Modules whose names have no underscore; the command line is documented as commands."""
    found = []
    for path in sorted((SOURCE / "trackfield").rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        if path.name == "__init__.py":
            parts = parts[:-1]
        if not any(part.startswith("_") for part in parts) and parts[1:2] != ("cli",):
            found.append((".".join(parts), path.name == "__init__.py"))
    return [name for name, package in found if not package or name == "trackfield"]


def documented_modules() -> list[str]:
    text = (REFERENCE / "python.md").read_text(encoding="utf-8")
    return re.findall(r"^\.\. automodule:: (\S+)$", text, re.MULTILINE)


def test_every_public_module_is_documented_once() -> None:
    assert sorted(documented_modules()) == sorted(public_modules())


@pytest.mark.parametrize("module", public_modules())
def test_every_public_name_has_a_docstring(module: str) -> None:
    imported = importlib.import_module(module)
    names = getattr(imported, "__all__", None) or [n for n in vars(imported) if n[0] != "_"]
    own = [
        value
        for value in (getattr(imported, name) for name in names)
        if callable(value) and getattr(value, "__module__", "").startswith("trackfield")
    ]
    assert not [value for value in own if not (value.__doc__ or "").strip()]


def rows(page: Path) -> Iterator[list[str]]:
    """Rows of the tables of a page whose first cell is code."""
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("| `"):
            yield [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def keys_of(schema: dict, table: dict) -> Iterator[tuple[str, object]]:
    """Keys of a table of the schema and of all tables in it, as `name` and default."""
    for name, value in table.get("properties", {}).items():
        yield name, value.get("default")
        choices = [value, *value.get("anyOf", [])]
        for choice in choices:
            for inner in (choice, choice.get("items", {}), choice.get("additionalProperties", {})):
                if isinstance(inner, dict) and "$ref" in inner:
                    yield from keys_of(schema, schema["$defs"][inner["$ref"].split("/")[-1]])


def test_every_key_of_the_site_is_documented_with_its_default() -> None:
    from trackfield.network.site_schema import site_schema

    schema = site_schema()
    documented = {cells[0].strip("`"): cells[2].strip("`") for cells in rows(REFERENCE / "site.md")}
    keys = dict(keys_of(schema, schema))
    assert len(keys) > 30
    assert set(keys) == set(documented)
    for name, default in keys.items():
        if default is not None and not isinstance(default, dict | list):
            assert documented[name] == json.dumps(default).strip('"'), name


def test_every_column_of_a_file_is_documented() -> None:
    from trackfield.io import measurements, tracks, truth
    from trackfield.network import sensors_file

    documented = {cells[0].strip("`") for cells in rows(REFERENCE / "files.md")}
    columns = {*sensors_file.COLUMNS}
    for module in (measurements, truth, tracks):
        columns |= {*module.SCHEMA.required, *module.SCHEMA.optional}
    assert columns <= documented
