"""Everything public is documented: modules, names, keys of the site's file, columns of files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

import pytest

import trackfield
from pages import DOCS, ROOT
from trackfield.io import commands, energy, measurements, reports, rooms, tracks, truth
from trackfield.network.kinds import KINDS
from trackfield.network.site_schema import SENSOR, site_schema
from trackfield.scheduling.accuracy import AccuracyMap

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
    modules = re.findall(r"^\.\. automodule:: (\S+)$", text, re.MULTILINE)
    return ["trackfield", *modules]  # its names stand in a table of their own


def test_every_public_module_is_documented_once() -> None:
    assert sorted(documented_modules()) == sorted(public_modules())


def test_every_name_of_the_package_itself_is_documented() -> None:
    text = (REFERENCE / "python.md").read_text(encoding="utf-8")
    names = re.findall(r"^\| \{py:obj\}`(\w+) <.*>` \| \S", text, re.MULTILINE)
    assert names == [name for name in trackfield.__all__ if not name.startswith("_")]


def rows(text: str) -> Iterator[list[str]]:
    """Rows of the tables of a page whose first cell is code."""
    for line in text.splitlines():
        if line.startswith("| `"):
            yield [cell.strip().strip("`") for cell in line.split("|")[1:-1]]


SECTIONS = {  # of the page, by the names that the tables have in the schema
    "Site": "[site]",
    "Origin": "[site.origin]",
    "Sensor": "[[sensors]]",
    "RangeModel": "[models.NAME], kind = range",
    "SignalModel": "[models.NAME], kind = signal",
    "DetectionModel": "[models.NAME], kind = detection",
    "BearingModel": "[models.NAME], kind = bearing",
    "AngularRateModel": "[models.NAME], kind = angular_rate",
    "MotionModel": "[models.NAME], kind = motion",
    "RssiModel": "[models.NAME], kind = rssi",
    "AmplitudeModel": "[models.NAME], kind = amplitude",
    "EnergyMessageModel": "[models.NAME], kind = energy_message",
    "Group": "[[groups]]",
    "Target": "[target]",
    "Tracker": "[tracker]",
    "Reports": "[reports]",
    "Network": "[network]",
    "Scheduling": "[scheduling]",
    "Energy": "[energy]",
    "Robot": "[robot]",
    "Obstacle": "[[obstacles]]",
    "Room": "[[rooms]]",
}
# Documented by the keys of the model itself.
TITLES = {kind: kind.title().replace("_", "") for kind in KINDS}
PARTS_OF_MODELS = {f"{title}Parameters": f"{title}Model" for title in TITLES.values()}
PARTS_OF_MODELS |= {
    f"{title}Target": f"{title}Model" for kind, title in TITLES.items() if KINDS[kind].tagged
}


def test_every_table_of_the_site_is_documented() -> None:
    schema = site_schema()
    assert {*schema["$defs"]} == {*SECTIONS, *PARTS_OF_MODELS}
    for part, model in PARTS_OF_MODELS.items():
        assert {*schema["$defs"][part]["properties"]} <= {*schema["$defs"][model]["properties"]}
    page = (REFERENCE / "site.md").read_text(encoding="utf-8")
    assert all(re.search(rf"`\[?\[?{key}\b", page) for key in schema["properties"])


@pytest.mark.parametrize("table", SECTIONS)
def test_every_key_of_the_site_is_documented_with_its_default(table: str) -> None:
    page = (REFERENCE / "site.md").read_text(encoding="utf-8")
    _, found, section = page.partition(f"\n## `{SECTIONS[table]}`\n")
    assert found
    documented = {cells[0]: cells[2] for cells in rows(section.partition("\n## ")[0])}
    keys = site_schema()["$defs"][table]["properties"]
    defaults = {key: value.get("default") for key, value in keys.items()}
    assert documented == {
        key: "" if value is None else json.dumps(value).strip('"')
        for key, value in defaults.items()
    }


def test_every_column_of_a_file_is_documented() -> None:
    documented = {cells[0] for cells in rows((REFERENCE / "files.md").read_text(encoding="utf-8"))}
    columns = {*SENSOR.model_fields, *energy.COLUMNS, *rooms.COLUMNS}
    for module in (commands, measurements, reports, truth, tracks):
        columns |= {*module.SCHEMA.required, *module.SCHEMA.optional}
    columns |= {*AccuracyMap._fields}
    assert columns <= documented
